#include "server/analysis/surface_distance.h"

#include <algorithm>
#include <functional>
#include <iterator>
#include <limits>
#include <queue>
#include <utility>

namespace rustle::analysis {

using sheet::kNone;
using sheet::Triangle;
using sheet::Vec2d;
using sheet::Vec3f;

SurfaceDistance::SurfaceDistance(std::shared_ptr<const sheet::Topology> topology, std::span<const Vec3f> positions_m,
                                 double least_m, double edges)
    : topology_(std::move(topology)), least_m_(least_m) {
  const auto triangles = topology_->triangles();
  const auto material = topology_->material_coordinates_m();
  const auto rest = topology_->rest_positions_m().empty() ? positions_m : topology_->rest_positions_m();
  const auto length_m = [&](std::uint32_t a, std::uint32_t b) -> double {
    return static_cast<double>(material.empty() ? (rest[a] - rest[b]).norm() : (material[a] - material[b]).norm());
  };
  exclusion_m_.resize(triangles.size());
  for (std::size_t t = 0; t < triangles.size(); ++t) {
    const Triangle& v = triangles[t];
    const double mean_m = (length_m(v[0], v[1]) + length_m(v[1], v[2]) + length_m(v[2], v[0])) / 3;
    exclusion_m_[t] = std::max(least_m, edges * mean_m);
  }
  if (!material.empty()) {
    patches_.resize(triangles.size());
    for (std::size_t t = 0; t < triangles.size(); ++t) {
      Eigen::AlignedBox2f box;
      for (const std::uint32_t v : triangles[t]) box.extend(material[v]);
      patches_[t] = {box.center().array(), 0.5f * box.sizes().array(), static_cast<float>(exclusion_m_[t])};
    }
    return;
  }
  vertices_around_.resize(topology_->vertex_count());
  triangles_around_.resize(triangles.size());
  marks_.assign(triangles.size(), kNone);
  vertex_exclusion_m_.assign(topology_->vertex_count(), 0.0);
  triangle_start_.assign(topology_->vertex_count() + 1, 0);
  for (std::size_t t = 0; t < triangles.size(); ++t) {
    for (const std::uint32_t v : triangles[t]) {
      vertex_exclusion_m_[v] = std::max(vertex_exclusion_m_[v], exclusion_m_[t]);
      ++triangle_start_[v + 1];
    }
  }
  for (std::size_t v = 0; v < topology_->vertex_count(); ++v) triangle_start_[v + 1] += triangle_start_[v];
  triangles_of_vertex_.resize(triangle_start_.back());
  std::vector<std::uint32_t> next_triangle(triangle_start_.begin(), triangle_start_.end() - 1);
  for (std::uint32_t t = 0; t < triangles.size(); ++t) {
    for (const std::uint32_t v : triangles[t]) triangles_of_vertex_[next_triangle[v]++] = t;
  }
  link_start_.assign(topology_->vertex_count() + 1, 0);
  const auto each_edge = [&](auto&& visit) {
    for (const auto& edge : topology_->interior_edges()) visit(edge.start, edge.end);
    for (const auto& edge : topology_->border_edges()) visit(edge.start, edge.end);
  };
  each_edge([&](std::uint32_t a, std::uint32_t b) { ++link_start_[a + 1], ++link_start_[b + 1]; });
  for (std::size_t v = 0; v < topology_->vertex_count(); ++v) link_start_[v + 1] += link_start_[v];
  links_.resize(link_start_.back());
  std::vector<std::uint32_t> next(link_start_.begin(), link_start_.end() - 1);
  each_edge([&](std::uint32_t a, std::uint32_t b) {
    const double length = length_m(a, b);
    links_[next[a]++] = {b, length};
    links_[next[b]++] = {a, length};
  });
}

Vec2d SurfaceDistance::material_at(const SheetSpot& spot) const {
  const auto material = topology_->material_coordinates_m();
  const Triangle& v = topology_->triangles()[spot.triangle];
  Vec2d sum = Vec2d::Zero();
  for (std::size_t k = 0; k < 3; ++k) sum += spot.barycentric[static_cast<int>(k)] * material[v[k]].cast<double>();
  return sum;
}

bool SurfaceDistance::neighbours(const SheetSpot& a, const SheetSpot& b) {
  const double within_m = std::max(exclusion_m_[a.triangle], exclusion_m_[b.triangle]);
  if (by_material()) return (material_at(a) - material_at(b)).squaredNorm() < within_m * within_m;
  const auto corner = [&](const SheetSpot& spot) {
    int nearest = 0;
    spot.barycentric.maxCoeff(&nearest);
    return topology_->triangles()[spot.triangle][static_cast<std::size_t>(nearest)];
  };
  const auto& around = vertices_around(corner(a));
  return std::binary_search(around.begin(), around.end(), corner(b));
}

void SurfaceDistance::approach(std::uint32_t triangle) {
  approached_ = triangle;
  if (by_material()) return;
  for (const std::uint32_t t : triangles_around(triangle)) marks_[t] = triangle;
}

bool SurfaceDistance::wholly_neighbours(std::uint32_t other) const {
  return by_material() ? wholly_neighbours(approached_, other) : marks_[other] == approached_;
}

std::vector<SurfaceDistance::Patch> SurfaceDistance::patches_of(const SheetTree& tree) const {
  const auto nodes = tree.nodes();
  const auto material = topology_->material_coordinates_m();
  std::vector<Patch> patches(nodes.size());
  std::vector<Eigen::AlignedBox2f> boxes(nodes.size());
  for (std::size_t n = nodes.size(); n-- > 0;) {
    const SheetTree::Node& node = nodes[n];
    float exclusion_m = std::numeric_limits<float>::infinity();
    if (node.count == 0) {
      boxes[n] = boxes[node.first].merged(boxes[node.first + 1]);
      exclusion_m = std::min(patches[node.first].exclusion_m, patches[node.first + 1].exclusion_m);
    } else {
      for (const std::uint32_t t : tree.triangles().subspan(node.first, node.count)) {
        exclusion_m = std::min(exclusion_m, patches_[t].exclusion_m);
        for (const std::uint32_t v : topology_->triangles()[t]) boxes[n].extend(material[v]);
      }
    }
    patches[n] = {boxes[n].center().array(), 0.5f * boxes[n].sizes().array(), exclusion_m};
  }
  return patches;
}

const std::vector<std::uint32_t>& SurfaceDistance::vertices_around(std::uint32_t vertex) {
  std::vector<std::uint32_t>& around = vertices_around_[vertex];
  if (!around.empty()) return around;
  constexpr double kDetour = 1.15;  // a way along edges is longer than the straight one
  using Reached = std::pair<double, std::uint32_t>;
  std::priority_queue<Reached, std::vector<Reached>, std::greater<>> open;
  open.push({0.0, vertex});
  while (!open.empty()) {
    const auto [distance_m, v] = open.top();
    open.pop();
    const auto place = std::lower_bound(around.begin(), around.end(), v);
    if (place != around.end() && *place == v) continue;
    around.insert(place, v);
    for (std::uint32_t k = link_start_[v]; k < link_start_[v + 1]; ++k) {
      const double next_m = distance_m + links_[k].length_m;
      if (next_m <= kDetour * vertex_exclusion_m_[vertex]) open.push({next_m, links_[k].vertex});
    }
  }
  return around;
}

const std::vector<std::uint32_t>& SurfaceDistance::triangles_around(std::uint32_t triangle) {
  std::vector<std::uint32_t>& around = triangles_around_[triangle];
  if (!around.empty()) return around;
  const Triangle& corners = topology_->triangles()[triangle];
  std::vector<std::uint32_t> shared = vertices_around(corners[0]);
  for (const std::uint32_t c : {corners[1], corners[2]}) {
    const auto& other = vertices_around(c);
    std::vector<std::uint32_t> both;
    std::set_intersection(shared.begin(), shared.end(), other.begin(), other.end(), std::back_inserter(both));
    shared = std::move(both);
  }
  for (const std::uint32_t v : shared) {
    for (std::uint32_t k = triangle_start_[v]; k < triangle_start_[v + 1]; ++k) {
      const std::uint32_t t = triangles_of_vertex_[k];
      const Triangle& w = topology_->triangles()[t];
      const bool first = v == std::min({w[0], w[1], w[2]});
      if (first && std::all_of(w.begin(), w.end(),
                               [&](std::uint32_t c) { return std::binary_search(shared.begin(), shared.end(), c); })) {
        around.push_back(t);
      }
    }
  }
  if (around.empty()) around.push_back(triangle);
  return around;
}

}  // namespace rustle::analysis
