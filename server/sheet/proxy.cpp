#include "server/sheet/proxy.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <numeric>

#include "client_sdk/sheets/delaunay.h"
#include "server/sheet/point_grid.h"

namespace rustle::sheet {
namespace {

constexpr double kMostDistortion = 0.02;
constexpr double kFaithfulArea = 0.03;
constexpr double kFaithfulBorder = 0.05;
constexpr double kFoldedShare = 1e-3;

double cross(const Vec2d& a, const Vec2d& b) {
  return a.x() * b.y() - a.y() * b.x();
}

double signed_area(const Triangle& v, const std::vector<Vec2d>& x) {
  return cross(x[v[1]] - x[v[0]], x[v[2]] - x[v[0]]) / 2;
}

/// The vertices of each border loop in order. A vertex where several loops meet belongs to each.
std::vector<std::vector<std::uint32_t>> border_loops(const Topology& topology) {
  std::vector<BorderEdge> edges(topology.border_edges().begin(), topology.border_edges().end());
  std::sort(edges.begin(), edges.end(), [](const BorderEdge& a, const BorderEdge& b) {
    return std::pair{a.start, a.end} < std::pair{b.start, b.end};
  });
  std::vector<bool> seen(edges.size(), false);
  std::vector<std::vector<std::uint32_t>> loops;
  for (std::size_t first = 0; first < edges.size(); ++first) {
    if (seen[first]) continue;
    loops.emplace_back();
    for (std::size_t at = first; at < edges.size();) {
      seen[at] = true;
      loops.back().push_back(edges[at].start);
      const std::uint32_t end = edges[at].end;
      at = static_cast<std::size_t>(std::lower_bound(edges.begin(), edges.end(), end,
                                                     [](const BorderEdge& e, std::uint32_t v) { return e.start < v; }) -
                                    edges.begin());
      while (at < edges.size() && edges[at].start == end && seen[at]) ++at;
      if (at < edges.size() && edges[at].start != end) break;
    }
  }
  return loops;
}

double border_length(const Topology& topology, const std::vector<Vec2d>& x) {
  double length = 0;
  for (const BorderEdge& e : topology.border_edges()) length += (x[e.start] - x[e.end]).norm();
  return length;
}

/// Corners of the loop, and between them one vertex per spacing.
void keep_along(const std::vector<std::uint32_t>& loop, const std::vector<Vec2d>& x, double spacing,
                std::vector<std::uint32_t>& kept) {
  const std::size_t n = loop.size();
  const auto step = [&](std::size_t i) { return Vec2d(x[loop[(i + 1) % n]] - x[loop[i % n]]); };
  std::vector<bool> corner(n);
  for (std::size_t i = 0; i < n; ++i) {
    const Vec2d before = step(i + n - 1), after = step(i);
    corner[i] = before.dot(after) < 0.8 * before.norm() * after.norm();
  }
  const auto first = static_cast<std::size_t>(std::find(corner.begin(), corner.end(), true) - corner.begin()) % n;
  double run = spacing;
  for (std::size_t k = 0; k < n; ++k) {
    const std::size_t i = (first + k) % n;
    if (corner[i] || run >= 0.999 * spacing) {
      kept.push_back(loop[i]);
      run = 0;
    }
    run += step(i).norm();
  }
}

}  // namespace

std::optional<Proxy> coarse_proxy(const Topology& fine, const RestPlane& plane, std::size_t triangles_wanted) {
  const std::vector<Vec2d>& x = plane.coordinates_m;
  if (plane.distortion > kMostDistortion || fine.triangle_count() == 0) return std::nullopt;
  double area = 0, folded = 0;
  std::uint32_t piece = plane.component[fine.triangles()[0][0]];
  std::vector<bool> used(fine.vertex_count(), false);
  for (const Triangle& v : fine.triangles()) {
    if (plane.component[v[0]] != piece) return std::nullopt;
    const double a = signed_area(v, x);
    (a > 0 ? area : folded) += std::fabs(a);
    for (std::uint32_t i : v) used[i] = true;
  }
  if (!(area > 0) || folded > kFoldedShare * area) return std::nullopt;
  const double spacing = std::sqrt(2 * area / static_cast<double>(triangles_wanted));

  Proxy proxy;
  for (const auto& loop : border_loops(fine)) keep_along(loop, x, spacing, proxy.vertices);
  std::sort(proxy.vertices.begin(), proxy.vertices.end());
  proxy.vertices.erase(std::unique(proxy.vertices.begin(), proxy.vertices.end()), proxy.vertices.end());
  std::vector<bool> border(fine.vertex_count(), false);
  for (const BorderEdge& e : fine.border_edges()) border[e.start] = border[e.end] = true;
  std::vector<Vec2d> kept;
  for (std::uint32_t i : proxy.vertices) kept.push_back(x[i]);
  const PointGrid<2> kept_grid(kept, spacing);

  Vec2d low = x[fine.triangles()[0][0]];
  for (std::uint32_t i = 0; i < fine.vertex_count(); ++i) {
    if (used[i]) low = low.cwiseMin(x[i]);
  }
  struct Choice {
    std::uint32_t vertex;
    double distance;
  };
  std::map<std::pair<std::int64_t, std::int64_t>, Choice> cells;
  for (std::uint32_t i = 0; i < fine.vertex_count(); ++i) {
    if (!used[i] || border[i]) continue;
    const Vec2d q = (x[i] - low) / (0.93 * spacing);
    const std::pair cell{static_cast<std::int64_t>(q.x()), static_cast<std::int64_t>(q.y())};
    const double distance =
        (q - Vec2d(static_cast<double>(cell.first) + 0.5, static_cast<double>(cell.second) + 0.5)).squaredNorm();
    const auto [at, is_new] = cells.try_emplace(cell, Choice{i, distance});
    if (!is_new && distance < at->second.distance) at->second = {i, distance};
  }
  for (const auto& [cell, choice] : cells) {
    if (kept.empty() || kept_grid.nearest(x[choice.vertex]).squared_distance_m2 > 0.25 * spacing * spacing) {
      proxy.vertices.push_back(choice.vertex);
    }
  }

  std::vector<Vec2d> points;
  std::vector<std::array<double, 2>> places;
  Topology::Input input;
  for (std::uint32_t i : proxy.vertices) {
    points.push_back(x[i]);
    places.push_back({x[i].x(), x[i].y()});
    input.material_coordinates_m.push_back((x[i] - low).cast<float>());
  }
  // Triangles over a notch or a hole have their centre in no fine triangle.
  std::vector<Vec2d> centres;
  for (const Triangle& v : fine.triangles()) centres.push_back((x[v[0]] + x[v[1]] + x[v[2]]) / 3);
  const double fine_spacing = std::sqrt(2 * area / static_cast<double>(fine.triangle_count()));
  const PointGrid<2> centre_grid(centres, fine_spacing);
  const auto covered = [&](const Vec2d& q) {
    const auto holds = [&](std::uint32_t f) {
      const Triangle& v = fine.triangles()[f];
      const double slack = -1e-9 * area;
      return cross(x[v[1]] - x[v[0]], q - x[v[0]]) >= slack && cross(x[v[2]] - x[v[1]], q - x[v[1]]) >= slack &&
             cross(x[v[0]] - x[v[2]], q - x[v[2]]) >= slack;
    };
    const double reach = 3 * std::sqrt(centre_grid.nearest(q).squared_distance_m2) + 2 * fine_spacing;
    bool inside = false;
    centre_grid.within(q, reach, [&](std::uint32_t f, double) { inside = inside || holds(f); });
    return inside;
  };
  double proxy_area = 0;
  for (const Triangle& v : sheets::delaunay(places)) {
    const double a = signed_area(v, points);
    if (2 * a <= 0.02 * spacing * spacing || !covered((points[v[0]] + points[v[1]] + points[v[2]]) / 3)) continue;
    proxy_area += a;
    input.triangles.push_back(v);
  }
  if (std::fabs(proxy_area - area) > kFaithfulArea * area) return std::nullopt;
  input.vertex_count = points.size();
  auto made = Topology::make(std::move(input));
  if (!made) return std::nullopt;
  proxy.topology = *std::move(made);
  const double fine_border = border_length(fine, x);
  if (std::fabs(border_length(*proxy.topology, points) - fine_border) > kFaithfulBorder * fine_border) return std::nullopt;
  const PointGrid<2> grid(points, spacing);
  proxy.nearest.resize(fine.vertex_count());
  for (std::size_t i = 0; i < fine.vertex_count(); ++i) proxy.nearest[i] = grid.nearest(x[i]).index;
  return proxy;
}

}  // namespace rustle::sheet
