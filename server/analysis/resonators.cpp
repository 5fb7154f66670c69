#include "server/analysis/resonators.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "server/sheet/simd.h"
#include "server/sheet/vector_batch.h"

namespace rustle::analysis {
namespace {

using observation::Resonator;
using sheet::Vec2d;
using sheet::Vec2f;
using sheet::Vec3d;
using sheet::Vec3f;

constexpr double kTightBend = 0.5;        // curvature times edge length: a bend within two edges
constexpr double kDirected = 0.6;         // of a region's mean curvature: with less, a ruling is that of the others
constexpr double kNarrowRegionEdges = 3;  // 2 area / perimeter below this many edges

/// Numbers in [0, 1) from a counter (splitmix64).
class Sequence {
 public:
  double next() {
    std::uint64_t z = (state_ += 0x9e3779b97f4a7c15u);
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9u;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebu;
    return static_cast<double>((z ^ (z >> 31)) >> 11) * 0x1.0p-53;
  }

 private:
  std::uint64_t state_ = 1;
};

constexpr std::size_t kLanes = 16;
using Lanes = float[kLanes];

/// A batch of triangles: their first corners, and the sides from there to the other two.
struct TriangleBatch {
  sheet::VectorBatch corner_m, side_b_m, side_c_m;
};

/// Sums over triangles weighted by area, in lanes: 1; c; c cᵀ; n; n nᵀ, with c the centroid and n the normal.
struct Sums {
  Lanes area, cx, cy, cz, cxx, cxy, cxz, cyy, cyz, czz, nx, ny, nz, nxx, nxy, nxz, nyy, nyz, nzz;
};

/// N = b x c, A = |N|/2, n = N/|N|. Triangles without area add nothing.
RUSTLE_SIMD void add(const TriangleBatch& batch, Sums& s) {
  for (std::size_t first = 0; first < sheet::kBatch; first += kLanes) {
    for (std::size_t i = 0; i < kLanes; ++i) {
      const auto &p = batch.corner_m.at[first + i], &b = batch.side_b_m.at[first + i], &c = batch.side_c_m.at[first + i];
      const float bx = b[0], by = b[1], bz = b[2], cx = c[0], cy = c[1], cz = c[2], third = 1.0f / 3;
      const float x = p[0] + third * (bx + cx), y = p[1] + third * (by + cy), z = p[2] + third * (bz + cz);
      const float u = by * cz - bz * cy, v = bz * cx - bx * cz, w = bx * cy - by * cx;
      const float length = std::sqrt(u * u + v * v + w * w), area = 0.5f * length;
      const float ax = area * x, ay = area * y, az = area * z, half_per_length = length > 0 ? 0.5f / length : 0.0f;
      const float mx = half_per_length * u, my = half_per_length * v, mz = half_per_length * w;  // A n nᵀ = m Nᵀ
      s.area[i] += area;
      s.cx[i] += ax, s.cy[i] += ay, s.cz[i] += az;
      s.cxx[i] += ax * x, s.cxy[i] += ax * y, s.cxz[i] += ax * z;
      s.cyy[i] += ay * y, s.cyz[i] += ay * z, s.czz[i] += az * z;
      s.nx[i] += 0.5f * u, s.ny[i] += 0.5f * v, s.nz[i] += 0.5f * w;
      s.nxx[i] += mx * u, s.nxy[i] += mx * v, s.nxz[i] += mx * w;
      s.nyy[i] += my * v, s.nyz[i] += my * w, s.nzz[i] += mz * w;
    }
  }
}

double total(const Lanes& lanes) {
  double out = 0;
  for (const float lane : lanes) out += static_cast<double>(lane);
  return out;
}

Eigen::Matrix3d symmetric(const Lanes& xx, const Lanes& xy, const Lanes& xz, const Lanes& yy, const Lanes& yz,
                          const Lanes& zz) {
  Eigen::Matrix3d out;
  out << total(xx), total(xy), total(xz), total(xy), total(yy), total(yz), total(xz), total(yz), total(zz);
  return out;
}

}  // namespace

void ResonatorFinder::turn_to(const Partition& partition, bool same_map) {
  stencils_ = &partition.stencils;
  map_ = &partition.map;
  positions_m_ = partition.positions_m;
  origin_m_ = partition.origin_m;
  holds_ = &partition.holds;
  sent_ = partition.sent;
  if (!same_map) {
    indexed_ = false;
    lasting_.assign(map_->region_count, Lasting());
  }
  for (Reach& reach : reach_) reach.known = false;
  borders_known_ = false;
  is_measured_.assign(map_->region_count, 0);
  measured_.resize(map_->region_count);
}

void ResonatorFinder::index_regions() {
  if (indexed_) return;
  indexed_ = true;
  region_start_.assign(map_->region_count + 1, 0);
  region_triangles_.resize(map_->region.size());
  for (const std::uint32_t r : map_->region) ++region_start_[r + 1];
  for (std::size_t r = 0; r < map_->region_count; ++r) region_start_[r + 1] += region_start_[r];
  next_.assign(region_start_.begin(), region_start_.end() - 1);
  for (const std::uint32_t f : stencils_->order) region_triangles_[next_[map_->region[f]]++] = f;
  outline_regions(*stencils_, *map_, outlines_);
}

std::span<const std::uint32_t> ResonatorFinder::triangles_of(std::uint32_t label) const {
  return std::span(region_triangles_).subspan(region_start_[label], region_start_[label + 1] - region_start_[label]);
}

void ResonatorFinder::join_reachable(StopAt stop, sheet::DisjointSets& sets) const {
  sets.reset(map_->region_count);
  if (map_->region_count < 2) return;
  const auto stamped = [&](std::uint32_t v) {
    return holds_->anchored[v] || (stop == StopAt::kRidgesAndHolds && holds_->touching[v]);
  };
  const auto interior = stencils_->topology->interior_edges();
  for (const std::uint32_t k : map_->cuts) {
    const auto& e = interior[k];
    const std::uint32_t a = map_->region[e.left], b = map_->region[e.right];
    if ((map_->ridge[e.left] && map_->ridge[e.right]) || stamped(e.start) || stamped(e.end)) continue;
    sets.join(a, b);
  }
}

std::vector<Resonator> ResonatorFinder::reached_from(std::span<const std::uint32_t> triangles, StopAt stop) {
  index_regions();
  Reach& reach = reach_[stop == StopAt::kRidgesAndHolds ? 0 : 1];
  if (!reach.known) join_reachable(stop, reach.sets), reach.known = true;
  sounding_.assign(map_->region_count, 0);
  for (const std::uint32_t f : triangles) sounding_[map_->region[f]] = 1;
  for (std::uint32_t r = 0; r < map_->region_count; ++r) sounding_[reach.sets.find(r)] |= sounding_[r];
  const auto sounds = [&](std::uint32_t r) { return sounding_[reach.sets.find(r)] && !triangles_of(r).empty(); };
  std::size_t count = 0;
  for (std::uint32_t r = 0; r < map_->region_count; ++r) count += sounds(r) ? 1 : 0;
  std::vector<Resonator> out;
  out.reserve(count);
  for (std::uint32_t r = 0; r < map_->region_count; ++r) {
    if (sounds(r)) out.push_back(region(r));
  }
  return out;
}

const Resonator& ResonatorFinder::region(std::uint32_t label) {
  index_regions();
  if (!is_measured_[label]) measured_[label] = measure(label), is_measured_[label] = 1;
  return measured_[label];
}

/// Of every region: border edges by how curved they are, but for those that something holds.
void ResonatorFinder::measure_borders() {
  if (borders_known_) return;
  borders_known_ = true;
  free_border_m_.assign(map_->region_count, 0.0);
  const auto borders = stencils_->topology->border_edges();
  const auto held = [&](std::uint32_t v) { return holds_->anchored[v] || holds_->touching[v]; };
  // An edge that rises from what is held is free but for its end.
  const auto is_free = [&](std::size_t k) { return !(held(borders[k].start) && held(borders[k].end)); };
  for (std::size_t k = 0; k < borders.size(); ++k) {
    const auto& e = borders[k];
    if (map_->free_border[k] == 0 || !is_free(k)) continue;
    free_border_m_[map_->region[e.triangle]] +=
        static_cast<double>((positions_m_[e.end] - positions_m_[e.start]).norm() * map_->free_border[k]);
  }
  for (const auto& shift : map_->border_shifts) {
    if (!is_free(shift.edge)) continue;
    const auto length_m = static_cast<double>(shift.length_m * map_->free_border[shift.edge]);
    free_border_m_[shift.to] += length_m;
    free_border_m_[shift.from] -= length_m;
  }
}

/// What stays while the partition does.
ResonatorFinder::Lasting ResonatorFinder::measure_lasting(std::uint32_t label) {
  double area_m2 = 0, edge_m3 = 0, bend_m2 = 0;
  for (const std::uint32_t f : triangles_of(label)) {
    const double area = map_->areas_m2[f], length = area * stencils_->edge_length_m[f];
    area_m2 += area;
    edge_m3 += length;
    bend_m2 += length * std::fabs(static_cast<double>(map_->curvature_per_m[f]));
  }
  const bool narrow = 2 * area_m2 * area_m2 < kNarrowRegionEdges * edge_m3 * map_->region_perimeter_m[label];
  return {true, stencils_->graded || bend_m2 > kTightBend * area_m2 || narrow,
          map_->region_curved[label] ? ruling_length_m(label) : 0.0};
}

Resonator ResonatorFinder::measure(std::uint32_t label) {
  Resonator out;
  const auto corners = stencils_->topology->triangles();
  const auto triangles = triangles_of(label);
  if (triangles.empty()) return out;
  Sums sums{};
  TriangleBatch batch;
  sheet::in_batches(
      triangles.size(),
      [&](std::size_t k, std::size_t i) {
        const sheet::Triangle& v = corners[triangles[k]];
        const sheet::Vec4f& corner_m = positions_m_[v[0]];
        batch.corner_m.put(i, corner_m);
        batch.side_b_m.put(i, positions_m_[v[1]] - corner_m);
        batch.side_c_m.put(i, positions_m_[v[2]] - corner_m);
      },
      [&](std::size_t, std::size_t here) {
        for (std::size_t i = here; i < sheet::kBatch; ++i) batch.side_b_m.put(i, sheet::Vec4f::Zero());
        add(batch, sums);
      });
  out.area_m2 = total(sums.area);
  const double area = std::max(out.area_m2, 1e-30);
  const Vec3d first(total(sums.cx), total(sums.cy), total(sums.cz)), normal(total(sums.nx), total(sums.ny), total(sums.nz));
  const Vec3d mean =
      out.area_m2 > 0 ? Vec3d(first / area) : Vec3d(positions_m_[corners[triangles[0]][0]].head<3>().cast<double>());
  out.position_m = origin_m_ + mean;
  if (normal.norm() > 1e-12 * area) out.normal = normal.normalized();
  const Eigen::Matrix3d normals = symmetric(sums.nxx, sums.nxy, sums.nxz, sums.nyy, sums.nyz, sums.nzz) / area;
  out.normal_spread = std::sqrt(std::clamp(1 - out.normal.dot(normals * out.normal), 0.0, 1.0));
  if (out.area_m2 > 0) {
    // Of the centroids, and inside the triangles: an equilateral one of area A has A/(6√3) (I - n nᵀ).
    const double inside = area / static_cast<double>(triangles.size()) / (6 * std::numbers::sqrt3);
    out.covariance_m2 = symmetric(sums.cxx, sums.cxy, sums.cxz, sums.cyy, sums.cyz, sums.czz) / area -
                        mean * mean.transpose() + inside * (Eigen::Matrix3d::Identity() - normals);
  }
  out.disc_radius_m = std::sqrt(out.area_m2 / std::numbers::pi);

  Lasting& lasting = lasting_[label];
  if (!lasting.known) lasting = measure_lasting(label);
  measure_borders();
  const bool curved = map_->region_curved[label];
  if (curved) out.free_border_length_m = free_border_m_[label];
  out.ruling_length_m = lasting.ruling_m;
  out.constrained = !curved || out.free_border_length_m < parameters_.free_border_min_m || !(out.ruling_length_m > 0);
  out.coarse = lasting.coarse;
  return out;
}

double ResonatorFinder::ruling_length_m(std::uint32_t label) {
  if (sent_ != nullptr) {
    double sum = 0;
    std::size_t count = 0;
    for (const auto& ruling : sent_->rulings) {
      if (ruling.region == label) sum += static_cast<double>((ruling.end_m - ruling.start_m).norm()), ++count;
    }
    if (count > 0) return sum / static_cast<double>(count);
  }
  const auto triangles = triangles_of(label);
  Vec2d twice = Vec2d::Zero();
  double area = 0, curvature = 0;
  for (const std::uint32_t f : triangles) {
    const float weight = map_->areas_m2[f] * std::fabs(map_->curvature_per_m[f]);
    twice += (weight * map_->ruling_twice[f]).cast<double>();
    curvature += static_cast<double>(weight);
    area += static_cast<double>(map_->areas_m2[f]);
  }
  if (!(curvature > 0)) return 0;
  const double mean_curvature_per_m = curvature / area;
  const double mean_angle = std::atan2(twice.y(), twice.x()) / 2;
  const Vec2f along = Vec2d(std::cos(mean_angle), std::sin(mean_angle)).cast<float>();
  const auto samples =
      std::max(parameters_.least_ruling_samples, parameters_.ruling_samples * triangles.size() / map_->region.size());
  // One place in each of so many parts of the region of equal area: triangles come along a curve that fills it.
  const double part_m2 = area / static_cast<double>(samples);
  Sequence random;
  double before_m2 = 0, sum = 0, weights = 0;
  std::size_t current = 0;
  for (std::size_t i = 0; i < samples; ++i) {
    const double target_m2 = (static_cast<double>(i) + random.next()) * part_m2;
    double here_m2 = static_cast<double>(map_->areas_m2[triangles[current]]);
    while (current + 1 < triangles.size() && before_m2 + here_m2 < target_m2) {
      before_m2 += here_m2;
      here_m2 = static_cast<double>(map_->areas_m2[triangles[++current]]);
    }
    const std::uint32_t f = triangles[current];
    auto u = static_cast<float>(random.next()), v = static_cast<float>(random.next());
    if (u + v > 1) u = 1 - u, v = 1 - v;
    const sheet::Triangle& t = stencils_->topology->triangles()[f];
    const auto& x = stencils_->rest_m;
    // Toward an inflection a place has less and less of a direction of its own.
    const double bent = std::fabs(static_cast<double>(map_->curvature_per_m[f])) / mean_curvature_per_m;
    const Vec2f from = x[t[0]] + u * (x[t[1]] - x[t[0]]) + v * (x[t[2]] - x[t[0]]);
    const Vec2f direction = bent >= kDirected ? Vec2f(ruling_direction(*map_, f).cast<float>()) : along;
    const double weight = std::min(bent / kDirected, 1.0), per_rest = stretch(f, direction);
    if (!(per_rest > 0)) continue;
    const double gap_m = std::max(2 * parameters_.min_region_width_m, 3 * stencils_->edge_length_m[f]) / per_rest;
    sum += weight * per_rest * tracer_.length_m(outlines_, label, from, direction, static_cast<float>(gap_m));
    weights += weight;
  }
  return weights > 0 ? sum / weights : 0.0;
}

/// Length in space over that in the rest plane.
double ResonatorFinder::stretch(std::uint32_t triangle, const Vec2f& d) const {
  const sheet::Triangle& v = stencils_->topology->triangles()[triangle];
  const auto& r = stencils_->rest_m;
  const Vec2f a = r[v[1]] - r[v[0]], b = r[v[2]] - r[v[0]];
  const float det = a.x() * b.y() - a.y() * b.x();
  if (std::fabs(det) < 1e-16f) return 0;
  const float along_a = (d.x() * b.y() - d.y() * b.x()) / det, along_b = (a.x() * d.y() - a.y() * d.x()) / det;
  return static_cast<double>(
      (along_a * (positions_m_[v[1]] - positions_m_[v[0]]) + along_b * (positions_m_[v[2]] - positions_m_[v[0]])).norm());
}

}  // namespace rustle::analysis
