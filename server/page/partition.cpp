#include "server/page/partition.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <tuple>
#include <utility>

#include "server/analysis/region_mesh.h"
#include "server/analysis/shared_stencils.h"

namespace rustle::page {

using sheet::Vec3f;
using sheet::Vec4f;

/// What depends on the topology alone.
struct Partition::Mesh {
  std::shared_ptr<const analysis::RegionMesh> regions;
  std::vector<sheet::Hinge> hinges;           ///< of the mesh of the partition
  std::vector<std::uint32_t> first_triangle;  ///< [V of that mesh]
  bool coarse = true;                         ///< may be
  /// The sheet's vertex that one of that mesh is.
  std::uint32_t of_sheet(std::uint32_t vertex) const { return regions->proxy ? regions->proxy->vertices[vertex] : vertex; }
};

void Partition::meet(const sheet::MeshFrame& frame) {
  const bool coarse = !(frame.partition && analysis::usable(*frame.partition, *frame.topology));
  if (topology_ == frame.topology && mesh_ && mesh_->coarse == coarse) return;
  const bool known = topology_ && topology_->vertex_count() == frame.topology->vertex_count();
  topology_ = frame.topology;
  if (!known) regions_.clear();  // numbers of other vertices tell nothing
  auto mesh = std::make_shared<Mesh>();
  const analysis::Parameters parameters;
  mesh->regions = analysis::shared_region_mesh(frame.topology, sheet::rest_plane(*frame.topology, frame.positions_m),
                                               parameters, coarse);
  mesh->coarse = coarse;
  const sheet::Topology& own = *mesh->regions->stencils.topology;
  mesh->hinges = sheet::hinges(own);
  mesh->first_triangle.assign(own.vertex_count(), sheet::kNone);
  for (std::uint32_t t = 0; t < own.triangle_count(); ++t) {
    for (const std::uint32_t vertex : own.triangles()[t])
      if (mesh->first_triangle[vertex] == sheet::kNone) mesh->first_triangle[vertex] = t;
  }
  mesh_ = std::move(mesh);
}

void Partition::update(const sheet::MeshFrame& frame) {
  if (frame.topology->triangle_count() == 0) {
    topology_ = frame.topology;
    mesh_.reset();
    regions_.assign(topology_->vertex_count(), kNoRegion);
    ridges_.clear();
    rulings_.clear();
    return;
  }
  meet(frame);
  const analysis::Parameters parameters;
  const auto& stencils = mesh_->regions->stencils;
  sheet::relative_positions_m(frame.positions_m, sheet::mean_position_m(frame.positions_m), relative_m_);
  positions_m_ = mesh_->regions->positions_m(relative_m_, gathered_m_);
  if (mesh_->coarse) {
    analysis::segment(stencils, {positions_m_, {}}, frame.time_s, parameters, &history_, scratch_, map_);
  } else {
    analysis::adopt_partition(*frame.partition, stencils, {positions_m_, {}}, parameters, scratch_, map_);
  }
  number_regions();
  find_ridges();
  find_rulings();
}

void Partition::number_regions() {
  std::swap(earlier_, regions_);
  regions_.resize(topology_->vertex_count());
  const auto& proxy = mesh_->regions->proxy;
  for (std::size_t v = 0; v < regions_.size(); ++v) {
    const std::uint32_t triangle = mesh_->first_triangle[proxy ? proxy->nearest[v] : v];
    const std::uint32_t region = triangle == sheet::kNone ? sheet::kNone : map_.region[triangle];
    regions_[v] = region < kNoRegion ? static_cast<std::uint16_t>(region) : kNoRegion;
  }
  if (earlier_.size() != regions_.size()) return;
  // The greatest overlaps first: each takes its earlier number, the others what is left.
  std::map<std::pair<std::uint16_t, std::uint16_t>, std::size_t> shared;  // now, earlier
  for (std::size_t v = 0; v < regions_.size(); ++v)
    if (regions_[v] != kNoRegion && earlier_[v] != kNoRegion) ++shared[{regions_[v], earlier_[v]}];
  std::vector<std::tuple<std::size_t, std::uint16_t, std::uint16_t>> by_size;
  for (const auto& [pair, count] : shared) by_size.emplace_back(count, pair.first, pair.second);
  std::sort(by_size.begin(), by_size.end(), [](const auto& a, const auto& b) {
    return std::tuple(std::get<0>(b), std::get<1>(a), std::get<2>(a)) <
           std::tuple(std::get<0>(a), std::get<1>(b), std::get<2>(b));
  });
  const std::size_t count = std::min<std::size_t>(map_.region_count, kNoRegion);
  std::vector<std::uint16_t> number(count, kNoRegion);
  std::vector<bool> taken(kNoRegion, false);
  for (const auto& [size, now, then] : by_size) {
    if (number[now] != kNoRegion || taken[then]) continue;
    number[now] = then;
    taken[then] = true;
  }
  std::size_t unused = 0;
  for (std::uint16_t& each : number) {
    if (each != kNoRegion) continue;
    while (taken[unused]) ++unused;
    each = static_cast<std::uint16_t>(unused++);
  }
  for (std::uint16_t& region : regions_)
    if (region != kNoRegion) region = number[region];
}

/// A fold runs along the sharpest edges of the triangles that it touches.
void Partition::find_ridges() {
  ridges_.clear();
  if (std::none_of(map_.ridge.begin(), map_.ridge.end(), [](std::uint8_t ridge) { return ridge != 0; })) return;
  const sheet::Topology& own = *mesh_->regions->stencils.topology;
  scratch_.angles_rad.resize(mesh_->hinges.size());
  sheet::dihedral_angles_rad(mesh_->hinges, positions_m_, scratch_.angles_rad);
  const auto edges = own.interior_edges();
  const auto is_sharpest_of = [&](std::size_t edge, std::uint32_t triangle) {
    const float angle = std::fabs(scratch_.angles_rad[edge]);
    const auto& sides = own.triangle_edges()[triangle];
    return std::all_of(sides.begin(), sides.end(), [&](std::uint32_t other) {
      return other == sheet::kNone || std::fabs(scratch_.angles_rad[other]) <= angle;
    });
  };
  for (std::size_t e = 0; e < edges.size(); ++e) {
    const auto& edge = edges[e];
    if (map_.ridge[edge.left] == 0 || map_.ridge[edge.right] == 0) continue;
    if (is_sharpest_of(e, edge.left) || is_sharpest_of(e, edge.right))
      ridges_.push_back({mesh_->of_sheet(edge.start), mesh_->of_sheet(edge.end)});
  }
}

void Partition::find_rulings() {
  rulings_.clear();
  const auto& stencils = mesh_->regions->stencils;
  const auto& plane_m = stencils.plane.coordinates_m;
  std::vector<std::uint32_t> curved;
  for (const std::uint32_t t : stencils.order)
    if (map_.ridge[t] == 0 && map_.region_curved[map_.region[t]]) curved.push_back(t);
  const std::size_t step = (curved.size() + kMostRulings - 1) / kMostRulings;
  for (std::size_t k = 0; k < curved.size(); k += step) {
    const std::uint32_t t = curved[k];
    const sheet::Triangle& v = stencils.topology->triangles()[t];
    const sheet::Vec2d a = plane_m[v[1]] - plane_m[v[0]], b = plane_m[v[2]] - plane_m[v[0]];
    const double det = a.x() * b.y() - a.y() * b.x();
    if (std::fabs(det) < 1e-16) continue;
    // As long as a few triangles, more where few are drawn.
    const double half_m = 0.5 * stencils.edge_length_m[t] * std::sqrt(static_cast<double>(step));
    const sheet::Vec2d d = half_m * analysis::ruling_direction(map_, t);
    rulings_.push_back({{mesh_->of_sheet(v[0]), mesh_->of_sheet(v[1]), mesh_->of_sheet(v[2])},
                        static_cast<float>((d.x() * b.y() - d.y() * b.x()) / det),
                        static_cast<float>((a.x() * d.y() - a.y() * d.x()) / det)});
  }
}

std::vector<Segment> Partition::ridges(std::span<const Vec3f> positions_m) const {
  std::vector<Segment> out;
  out.reserve(ridges_.size());
  for (const auto& [start, end] : ridges_) out.push_back({positions_m[start], positions_m[end]});
  return out;
}

std::vector<Segment> Partition::rulings(std::span<const Vec3f> positions_m) const {
  std::vector<Segment> out;
  out.reserve(rulings_.size());
  for (const Ruling& ruling : rulings_) {
    const Vec3f &p = positions_m[ruling.corners[0]], a = positions_m[ruling.corners[1]] - p,
                b = positions_m[ruling.corners[2]] - p;
    const Vec3f middle = p + (a + b) / 3.0F, half = ruling.along_a * a + ruling.along_b * b;
    out.push_back({middle - half, middle + half});
  }
  return out;
}

}  // namespace rustle::page
