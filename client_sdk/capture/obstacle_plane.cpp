#include "client_sdk/capture/obstacle_plane.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <vector>

namespace rustle::capture {
namespace {

using Point3 = std::array<double, 3>;
using Point2 = std::array<double, 2>;

Point3 minus(const Point3& a, const Point3& b) {
  return {a[0] - b[0], a[1] - b[1], a[2] - b[2]};
}
double dot(const Point3& a, const Point3& b) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}
Point3 cross(const Point3& a, const Point3& b) {
  return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}
double cross(const Point2& o, const Point2& a, const Point2& b) {
  return (a[0] - o[0]) * (b[1] - o[1]) - (a[1] - o[1]) * (b[0] - o[0]);
}

Point3 point_at(std::span<const float> points, std::size_t i) {
  return {points[3 * i], points[3 * i + 1], points[3 * i + 2]};
}

/// Counter-clockwise, without the points within its edges (Andrew's monotone chain).
std::vector<Point2> convex_hull(std::vector<Point2> points, double area_tolerance) {
  std::sort(points.begin(), points.end());
  std::vector<Point2> hull;
  const auto chain = [&](auto first, auto last) {
    const std::size_t start = hull.size();
    for (auto point = first; point != last; ++point) {
      while (hull.size() >= start + 2 && cross(hull[hull.size() - 2], hull.back(), *point) <= area_tolerance)
        hull.pop_back();
      hull.push_back(*point);
    }
    hull.pop_back();
  };
  chain(points.begin(), points.end());
  chain(points.rbegin(), points.rend());
  return hull;
}

double area_of(const std::vector<Point2>& polygon) {
  double twice = 0;
  for (std::size_t i = 2; i < polygon.size(); ++i) twice += cross(polygon[0], polygon[i - 1], polygon[i]);
  return twice / 2;
}

}  // namespace

tl::expected<FittedPlane, std::string> reflecting_plane(std::span<const float> vertices,
                                                        std::span<const std::uint32_t> triangles,
                                                        std::span<const float> sheet_positions) {
  const auto refuse = [](const char* why) { return tl::unexpected(std::string(why)); };
  const std::size_t vertex_count = vertices.size() / 3;
  if (vertex_count < 3 || triangles.empty()) return refuse("it has no area");

  // The plane through the largest triangle, seen from the first of its corners.
  Point3 normal{};
  Point3 along{};
  double largest = 0;
  double mesh_area = 0;
  for (std::size_t t = 0; t + 2 < triangles.size(); t += 3) {
    const Point3 corner = point_at(vertices, triangles[t]);
    const Point3 edge = minus(point_at(vertices, triangles[t + 1]), corner);
    const Point3 twice = cross(edge, minus(point_at(vertices, triangles[t + 2]), corner));
    const double length = std::sqrt(dot(twice, twice));
    mesh_area += length / 2;
    if (length > largest) {
      largest = length;
      normal = {twice[0] / length, twice[1] / length, twice[2] / length};
      along = edge;
    }
  }
  if (largest <= 0) return refuse("it has no area");
  const double along_length = std::sqrt(dot(along, along));
  const Point3 u{along[0] / along_length, along[1] / along_length, along[2] / along_length};
  const Point3 v = cross(normal, u);

  Point3 centroid{};
  for (std::size_t i = 0; i < vertex_count; ++i) {
    const Point3 point = point_at(vertices, i);
    for (std::size_t k = 0; k < 3; ++k) centroid[k] += point[k] / static_cast<double>(vertex_count);
  }
  std::vector<Point2> outline(vertex_count);
  double extent = 0;
  double deviation = 0;
  for (std::size_t i = 0; i < vertex_count; ++i) {
    const Point3 offset = minus(point_at(vertices, i), centroid);
    outline[i] = {dot(offset, u), dot(offset, v)};
    extent = std::max({extent, std::abs(outline[i][0]), std::abs(outline[i][1])});
    deviation = std::max(deviation, std::abs(dot(offset, normal)));
  }
  if (deviation > 1e-5 * extent) return refuse("it is not flat");

  const std::vector<Point2> hull = convex_hull(std::move(outline), 1e-7 * extent * extent);
  const double hull_area = area_of(hull);
  if (std::abs(hull_area - mesh_area) > 1e-3 * hull_area) return refuse("its outline is not convex or it has holes");

  double lowest = 0;
  double highest = 0;
  for (std::size_t i = 0; i < sheet_positions.size() / 3; ++i) {
    const Point3 offset = minus(point_at(sheet_positions, i), centroid);
    const double height = dot(offset, normal);
    lowest = std::min(lowest, height);
    highest = std::max(highest, height);
    const Point2 foot{dot(offset, u), dot(offset, v)};
    for (std::size_t k = 0; k < hull.size(); ++k) {
      if (cross(hull[k], hull[(k + 1) % hull.size()], foot) <= 0) return refuse("the sheet passes its border");
    }
  }
  const double tolerance = 1e-3 * extent;
  if (lowest < -tolerance && highest > tolerance) return refuse("the sheet passes from one side of it to the other");
  const double side = highest >= -lowest ? 1.0 : -1.0;
  return FittedPlane{centroid, {side * normal[0], side * normal[1], side * normal[2]}};
}

}  // namespace rustle::capture
