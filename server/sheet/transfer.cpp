#include "server/sheet/transfer.h"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <numeric>

#include "server/sheet/face_geometry.h"
#include "server/sheet/point_grid.h"

namespace rustle::sheet {
namespace {

constexpr double kSameVertexEdges = 1e-3;
constexpr double kSamePlaceEdges = 0.3;

template <class To, class From>
std::vector<To> converted(std::span<const From> points) {
  std::vector<To> out(points.size());
  for (std::size_t i = 0; i < points.size(); ++i) out[i] = points[i].template cast<double>();
  return out;
}

double mean_of_positive(const std::vector<double>& values) {
  double sum = 0;
  std::size_t count = 0;
  for (double v : values) {
    if (v > 0) sum += v, ++count;
  }
  return count > 0 ? sum / static_cast<double>(count) : 0;
}

std::vector<bool> used_vertices(const Topology& topology) {
  std::vector<bool> used(topology.vertex_count(), false);
  for (const Triangle& v : topology.triangles()) {
    for (std::uint32_t i : v) used[i] = true;
  }
  return used;
}

/// Triangles of a topology around each vertex.
struct Stars {
  std::vector<std::uint32_t> start, triangles;

  explicit Stars(const Topology& topology)
      : start(topology.vertex_count() + 1, 0), triangles(3 * topology.triangle_count()) {
    for (const Triangle& v : topology.triangles()) {
      for (std::uint32_t i : v) ++start[i + 1];
    }
    std::partial_sum(start.begin(), start.end(), start.begin());
    std::vector<std::uint32_t> next(start.begin(), start.end() - 1);
    for (std::uint32_t f = 0; f < topology.triangle_count(); ++f) {
      for (std::uint32_t i : topology.triangles()[f]) triangles[next[i]++] = f;
    }
  }
};

/// Barycentric coordinates of q, clamped to the triangle, and the squared distance that clamping left.
std::pair<std::array<double, 3>, double> clamped_barycentric(const Vec2d& a, const Vec2d& b, const Vec2d& c,
                                                             const Vec2d& q) {
  const Vec2d u = b - a, v = c - a, w = q - a;
  const double det = u.x() * v.y() - u.y() * v.x();
  std::array<double, 3> weight{1, 0, 0};
  if (std::fabs(det) > 1e-30) {
    weight[1] = (w.x() * v.y() - w.y() * v.x()) / det;
    weight[2] = (u.x() * w.y() - u.y() * w.x()) / det;
    weight[0] = 1 - weight[1] - weight[2];
    double sum = 0;
    for (double& x : weight) x = std::max(x, 0.0), sum += x;
    for (double& x : weight) x /= sum;
  }
  return {weight, (weight[0] * a + weight[1] * b + weight[2] * c - q).squaredNorm()};
}

}  // namespace

bool same_structure(const Topology& a, const Topology& b) {
  if (&a == &b) return true;
  return a.vertex_count() == b.vertex_count() && std::ranges::equal(a.triangles(), b.triangles()) &&
         std::ranges::equal(a.material_coordinates_m(), b.material_coordinates_m()) &&
         std::ranges::equal(a.rest_positions_m(), b.rest_positions_m());
}

Transfer transfer_by_material(const Topology& from, const Topology& to) {
  assert(!from.material_coordinates_m().empty() && !to.material_coordinates_m().empty());
  const auto old_points = converted<Vec2d>(from.material_coordinates_m());
  const auto new_points = converted<Vec2d>(to.material_coordinates_m());
  const std::vector<double> edge = local_edge_lengths_m<Vec2d>(to, new_points);
  const double typical = mean_of_positive(local_edge_lengths_m<Vec2d>(from, old_points));
  const PointGrid<2> grid(old_points, typical);
  const std::vector<bool> old_used = used_vertices(from);
  const Stars stars(from);

  // A query point is nudged into its own triangles, so that at a crack it falls on its own side.
  std::vector<Vec2d> inside(new_points.size(), Vec2d::Zero());
  std::vector<int> around(new_points.size(), 0);
  for (const Triangle& v : to.triangles()) {
    const Vec2d centre = (new_points[v[0]] + new_points[v[1]] + new_points[v[2]]) / 3;
    for (std::uint32_t i : v) inside[i] += centre, ++around[i];
  }
  Transfer out;
  out.origins.resize(new_points.size());
  out.remade.assign(new_points.size(), false);
  for (std::size_t i = 0; i < new_points.size(); ++i) {
    const Vec2d nudged =
        around[i] > 0 ? Vec2d(new_points[i] + 0.02 * (inside[i] / around[i] - new_points[i])) : new_points[i];
    auto nearest = grid.nearest(nudged, [&](std::uint32_t j) { return old_used[j]; });
    if (nearest.index == kNone) nearest = grid.nearest(nudged);
    out.remade[i] = (old_points[nearest.index] - new_points[i]).norm() > kSameVertexEdges * edge[i];
    std::uint32_t best = kNone;
    double best_distance = std::numeric_limits<double>::infinity();
    const auto consider = [&](std::uint32_t vertex, double) {
      for (std::uint32_t k = stars.start[vertex]; k < stars.start[vertex + 1]; ++k) {
        const Triangle& v = from.triangles()[stars.triangles[k]];
        const double distance = clamped_barycentric(old_points[v[0]], old_points[v[1]], old_points[v[2]], nudged).second;
        if (distance < best_distance || (distance == best_distance && stars.triangles[k] < best)) {
          best_distance = distance;
          best = stars.triangles[k];
        }
      }
    };
    grid.within(nudged, 1.0001 * std::sqrt(nearest.squared_distance_m2) + kSameVertexEdges * edge[i], consider);
    const double negligible = 1e-10 * edge[i] * edge[i];
    if (best_distance > negligible)
      grid.within(nudged, 2 * std::sqrt(nearest.squared_distance_m2) + 1.5 * typical, consider);
    if (best == kNone) {
      out.origins[i] = {{nearest.index, nearest.index, nearest.index}, {1, 0, 0}};
      continue;
    }
    const Triangle& v = from.triangles()[best];
    const auto weight = clamped_barycentric(old_points[v[0]], old_points[v[1]], old_points[v[2]], new_points[i]).first;
    for (int k = 0; k < 3; ++k) {
      out.origins[i].vertices[k] = v[k];
      out.origins[i].weights[k] = static_cast<float>(weight[k]);
    }
  }
  return out;
}

std::optional<Transfer> transfer_by_position(const Topology& from, std::span<const Vec3f> expected_m, const Topology& to,
                                             std::span<const Vec3f> positions_m) {
  if (to.triangle_count() == 0 || from.triangle_count() == 0) return std::nullopt;
  const auto old_points = converted<Vec3d>(expected_m);
  const auto new_points = converted<Vec3d>(positions_m);
  const std::vector<double> edge = local_edge_lengths_m<Vec3d>(to, new_points);
  const PointGrid<3> grid(old_points, mean_of_positive(edge));
  const std::vector<bool> old_used = used_vertices(from);

  // Old vertices at one place (the two sides of a seam) stand for each other until the triangles tell them apart.
  std::vector<std::uint32_t> canonical(old_points.size());
  for (std::uint32_t i = 0; i < old_points.size(); ++i) {
    canonical[i] = i;
    if (old_used[i]) {
      grid.within(old_points[i], 0, [&](std::uint32_t j, double) {
        if (old_used[j]) canonical[i] = std::min(canonical[i], j);
      });
    }
  }
  struct OldTriangle {
    std::array<std::uint32_t, 3> key;
    std::uint32_t index;
    auto operator<=>(const OldTriangle&) const = default;
  };
  const auto key_of = [](std::array<std::uint32_t, 3> v) {
    std::sort(v.begin(), v.end());
    return v;
  };
  std::vector<OldTriangle> old_triangles;
  old_triangles.reserve(from.triangle_count());
  for (std::uint32_t f = 0; f < from.triangle_count(); ++f) {
    const Triangle& v = from.triangles()[f];
    old_triangles.push_back({key_of({canonical[v[0]], canonical[v[1]], canonical[v[2]]}), f});
  }
  std::sort(old_triangles.begin(), old_triangles.end());

  std::vector<std::uint32_t> nearest(new_points.size()), match(new_points.size(), kNone);
  for (std::size_t i = 0; i < new_points.size(); ++i) {
    auto hit = grid.nearest(new_points[i], [&](std::uint32_t j) { return old_used[j]; });
    if (hit.index == kNone) hit = grid.nearest(new_points[i]);
    nearest[i] = hit.index;
    if (std::sqrt(hit.squared_distance_m2) <= kSamePlaceEdges * edge[i]) match[i] = canonical[hit.index];
  }
  std::vector<std::uint32_t> proven(new_points.size(), kNone);
  std::size_t found = 0;
  for (const Triangle& v : to.triangles()) {
    if (match[v[0]] == kNone || match[v[1]] == kNone || match[v[2]] == kNone) continue;
    const auto key = key_of({match[v[0]], match[v[1]], match[v[2]]});
    const auto old = std::lower_bound(old_triangles.begin(), old_triangles.end(), OldTriangle{key, 0});
    if (old == old_triangles.end() || old->key != key) continue;
    ++found;
    for (std::uint32_t i : v) {
      for (std::uint32_t j : from.triangles()[old->index]) {
        if (proven[i] == kNone && canonical[j] == match[i]) proven[i] = j;
      }
    }
  }
  if (2 * found < to.triangle_count()) return std::nullopt;
  Transfer out;
  out.origins.resize(new_points.size());
  out.remade.resize(new_points.size());
  for (std::size_t i = 0; i < new_points.size(); ++i) {
    const std::uint32_t j = proven[i] == kNone ? nearest[i] : proven[i];
    out.origins[i] = {{j, j, j}, {1, 0, 0}};
    out.remade[i] = proven[i] == kNone;
  }
  return out;
}

}  // namespace rustle::sheet
