#include "server/sheet/topology.h"

#include <fmt/format.h>

#include <algorithm>
#include <optional>
#include <tuple>
#include <utility>

namespace rustle::sheet {
namespace {

template <class Point>
std::optional<std::size_t> first_not_finite(const std::vector<Point>& points) {
  for (std::size_t i = 0; i < points.size(); ++i) {
    if (!points[i].allFinite()) return i;
  }
  return std::nullopt;
}

std::string fault(const Topology::Input& input) {
  const auto size_fault = [&](const char* field, std::size_t size) {
    return fmt::format("{}: {} entries for {} vertices; send one per vertex or none", field, size, input.vertex_count);
  };
  if (input.vertex_count >= kNone) return fmt::format("vertex_count: {} is too many for 32-bit indices", input.vertex_count);
  if (input.triangles.size() >= kNone / 3) return fmt::format("triangles: {} are too many", input.triangles.size());
  for (std::size_t t = 0; t < input.triangles.size(); ++t) {
    for (std::uint32_t vertex : input.triangles[t]) {
      if (vertex >= input.vertex_count) {
        return fmt::format("triangles: triangle {} names vertex {}, but the sheet has {} vertices (counted from 0)", t,
                           vertex, input.vertex_count);
      }
    }
  }
  const std::size_t material = input.material_coordinates_m.size(), rest = input.rest_positions_m.size();
  if (material != 0 && material != input.vertex_count) return size_fault("material_coordinates", material);
  if (rest != 0 && rest != input.vertex_count) return size_fault("rest_positions", rest);
  if (const auto i = first_not_finite(input.material_coordinates_m)) {
    return fmt::format("material_coordinates: entry {} is not finite", *i);
  }
  if (const auto i = first_not_finite(input.rest_positions_m)) {
    return fmt::format("rest_positions: entry {} is not finite", *i);
  }
  return {};
}

struct Side {
  std::uint64_t key;  ///< both end vertices, the lower one first
  std::uint32_t triangle;
  std::uint32_t side;
};

}  // namespace

tl::expected<std::shared_ptr<const Topology>, std::string> Topology::make(Input input) {
  if (std::string text = fault(input); !text.empty()) return tl::unexpected(std::move(text));

  auto made = std::shared_ptr<Topology>(new Topology());
  Topology& t = *made;
  t.id_ = input.id;
  t.vertex_count_ = input.vertex_count;
  t.triangles_ = std::move(input.triangles);
  t.material_coordinates_m_ = std::move(input.material_coordinates_m);
  t.rest_positions_m_ = std::move(input.rest_positions_m);
  t.triangle_edges_.assign(t.triangles_.size(), {kNone, kNone, kNone});

  std::vector<Side> sides;
  sides.reserve(3 * t.triangles_.size());
  std::vector<bool> used(t.vertex_count_, false);
  for (std::uint32_t f = 0; f < t.triangles_.size(); ++f) {
    const Triangle& v = t.triangles_[f];
    for (std::uint32_t i : v) used[i] = true;
    if (v[0] == v[1] || v[1] == v[2] || v[2] == v[0]) {
      ++t.flaws_.degenerate_triangles;
      continue;
    }
    for (std::uint32_t k = 0; k < 3; ++k) {
      const std::uint64_t a = v[k], b = v[(k + 1) % 3];
      sides.push_back({std::min(a, b) << 32 | std::max(a, b), f, k});
    }
  }
  t.flaws_.unused_vertices = static_cast<std::size_t>(std::count(used.begin(), used.end(), false));
  std::sort(sides.begin(), sides.end(), [](const Side& x, const Side& y) {
    return std::tie(x.key, x.triangle, x.side) < std::tie(y.key, y.triangle, y.side);
  });

  const auto ends = [&](const Side& s) {
    const Triangle& v = t.triangles_[s.triangle];
    return std::pair{v[s.side], v[(s.side + 1) % 3]};
  };
  for (std::size_t begin = 0, end = 0; begin < sides.size(); begin = end) {
    while (end < sides.size() && sides[end].key == sides[begin].key) ++end;
    const Side& first = sides[begin];
    const auto [a, b] = ends(first);
    if (end - begin == 1) {
      t.border_edges_.push_back({a, b, first.triangle});
    } else if (end - begin == 2) {
      const Side& second = sides[begin + 1];
      const bool consistent = ends(second).second == a;
      if (!consistent) ++t.flaws_.inconsistent_edges;
      const auto index = static_cast<std::uint32_t>(t.interior_edges_.size());
      t.triangle_edges_[first.triangle][first.side] = index;
      t.triangle_edges_[second.triangle][second.side] = index;
      t.interior_edges_.push_back({a, b, first.triangle, second.triangle, consistent});
    } else {
      ++t.flaws_.non_manifold_edges;
    }
  }
  return std::shared_ptr<const Topology>(std::move(made));
}

}  // namespace rustle::sheet
