#include "server/analysis/resonators.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <utility>

#include "server/sheet/simd.h"

namespace rustle::analysis {
namespace {

using observation::Resonator;
using sheet::kNone;
using sheet::Vec2d;
using sheet::Vec3d;
using sheet::Vec3f;

constexpr int kMostSteps = 4000;
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

/// How far a point lies to the left of a line.
double offset(const Vec2d& direction, const Vec2d& to_point) {
  return direction.x() * to_point.y() - direction.y() * to_point.x();
}

constexpr std::size_t kLanes = 16, kBatch = 128;
using Lanes = float[kLanes];

/// A batch of triangles: areas, centroids, normals.
struct Batch {
  float area[kBatch], x[kBatch], y[kBatch], z[kBatch], nx[kBatch], ny[kBatch], nz[kBatch];
};

/// Sums over triangles weighted by area, in lanes: 1; c; c cᵀ; n; n nᵀ.
struct Sums {
  Lanes area, cx, cy, cz, cxx, cxy, cxz, cyy, cyz, czz, nx, ny, nz, nxx, nxy, nxz, nyy, nyz, nzz;
};

RUSTLE_SIMD void add(const Batch& b, Sums& s) {
  for (std::size_t first = 0; first < kBatch; first += kLanes) {
    for (std::size_t i = 0; i < kLanes; ++i) {
      const std::size_t k = first + i;
      const float a = b.area[k], x = a * b.x[k], y = a * b.y[k], z = a * b.z[k], u = a * b.nx[k], v = a * b.ny[k],
                  w = a * b.nz[k];
      s.area[i] += a;
      s.cx[i] += x, s.cy[i] += y, s.cz[i] += z;
      s.cxx[i] += x * b.x[k], s.cxy[i] += x * b.y[k], s.cxz[i] += x * b.z[k];
      s.cyy[i] += y * b.y[k], s.cyz[i] += y * b.z[k], s.czz[i] += z * b.z[k];
      s.nx[i] += u, s.ny[i] += v, s.nz[i] += w;
      s.nxx[i] += u * b.nx[k], s.nxy[i] += u * b.ny[k], s.nxz[i] += u * b.nz[k];
      s.nyy[i] += v * b.ny[k], s.nyz[i] += v * b.nz[k], s.nzz[i] += w * b.nz[k];
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
    rulings_m_.assign(map_->region_count, -1.0);
  }
  for (Reach& reach : reach_) reach.known = false;
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
  for (std::uint32_t f = 0; f < map_->region.size(); ++f) region_triangles_[next_[map_->region[f]]++] = f;
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
  for (const auto& e : stencils_->topology->interior_edges()) {
    const std::uint32_t a = map_->region[e.left], b = map_->region[e.right];
    if (a == b || (map_->ridge[e.left] && map_->ridge[e.right]) || stamped(e.start) || stamped(e.end)) continue;
    sets.join(a, b);
  }
}

std::vector<Resonator> ResonatorFinder::reached_from(std::span<const std::uint32_t> triangles, StopAt stop) {
  index_regions();
  Reach& reach = reach_[stop == StopAt::kRidgesAndHolds ? 0 : 1];
  if (!reach.known) join_reachable(stop, reach.sets), reach.known = true;
  sounding_.assign(map_->region_count, 0);
  for (const std::uint32_t f : triangles) sounding_[reach.sets.find(map_->region[f])] = 1;
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

Resonator ResonatorFinder::measure(std::uint32_t label) {
  Resonator out;
  const auto& topology = *stencils_->topology;
  const auto triangles = triangles_of(label);
  if (triangles.empty()) return out;
  Sums sums{};
  Batch batch;
  double bend = 0, edge = 0;
  for (std::size_t first = 0; first < triangles.size(); first += kBatch) {
    const std::size_t count = std::min(kBatch, triangles.size() - first);
    for (std::size_t i = 0; i < count; ++i) {
      const std::uint32_t f = triangles[first + i];
      const sheet::Triangle& v = topology.triangles()[f];
      const Vec3f centroid = (positions_m_[v[0]] + positions_m_[v[1]] + positions_m_[v[2]]) / 3.0f;
      const Vec3f& normal = map_->faces.normals[f];
      const float area = map_->faces.areas_m2[f];
      batch.area[i] = area;
      batch.x[i] = centroid.x(), batch.y[i] = centroid.y(), batch.z[i] = centroid.z();
      batch.nx[i] = normal.x(), batch.ny[i] = normal.y(), batch.nz[i] = normal.z();
      const double weight = static_cast<double>(area) * stencils_->edge_length_m[f];
      bend += weight * static_cast<double>(std::fabs(map_->curvature_per_m[f]));
      edge += weight;
    }
    for (std::size_t i = count; i < kBatch; ++i) {
      batch.area[i] = batch.x[i] = batch.y[i] = batch.z[i] = batch.nx[i] = batch.ny[i] = batch.nz[i] = 0;
    }
    add(batch, sums);
  }
  out.area_m2 = total(sums.area);
  const double area = std::max(out.area_m2, 1e-30);
  const Vec3d first(total(sums.cx), total(sums.cy), total(sums.cz)), normal(total(sums.nx), total(sums.ny), total(sums.nz));
  const Vec3d mean =
      out.area_m2 > 0 ? Vec3d(first / area) : Vec3d(positions_m_[topology.triangles()[triangles[0]][0]].cast<double>());
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

  const bool curved = map_->region_curved[label];
  const auto borders = topology.border_edges();
  const auto is_free = [&](std::size_t k) {
    const auto& e = borders[k];
    return !(holds_->anchored[e.start] || holds_->anchored[e.end] || holds_->touching[e.start] || holds_->touching[e.end]);
  };
  for (std::size_t k = 0; curved && k < borders.size(); ++k) {
    const auto& e = borders[k];
    if (map_->region[e.triangle] != label || map_->free_border[k] == 0 || !is_free(k)) continue;
    out.free_border_length_m +=
        static_cast<double>((positions_m_[e.end] - positions_m_[e.start]).norm() * map_->free_border[k]);
  }
  for (const auto& shift : map_->border_shifts) {
    if (!curved || !is_free(shift.edge)) continue;
    const auto length = static_cast<double>(shift.length_m * map_->free_border[shift.edge]);
    if (shift.to == label) out.free_border_length_m += length;
    if (shift.from == label) out.free_border_length_m -= length;
  }
  if (curved && rulings_m_[label] < 0) rulings_m_[label] = ruling_length_m(label);
  if (curved) out.ruling_length_m = rulings_m_[label];
  out.constrained = !curved || out.free_border_length_m < parameters_.free_border_min_m || !(out.ruling_length_m > 0);
  out.coarse = stencils_->graded || bend > kTightBend * area ||
               2 * area * area < kNarrowRegionEdges * edge * map_->region_perimeter_m[label];
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
  // The length of a ruling depends most on where it lies across the others: the sample is even by area there, in strips, and
  // within each strip along it.
  const auto triangles = triangles_of(label);
  const auto& centres = stencils_->centres_m;
  Vec2d twice = Vec2d::Zero();
  double area = 0, curvature = 0;
  for (const std::uint32_t f : triangles) {
    const float weight = map_->faces.areas_m2[f] * std::fabs(map_->curvature_per_m[f]);
    twice += (weight * map_->ruling_twice[f]).cast<double>();
    curvature += static_cast<double>(weight);
    area += static_cast<double>(map_->faces.areas_m2[f]);
  }
  if (!(curvature > 0)) return 0;
  const double mean_curvature_per_m = curvature / area;
  const double mean_angle = std::atan2(twice.y(), twice.x()) / 2;
  const Vec2d along(std::cos(mean_angle), std::sin(mean_angle)), across(-along.y(), along.x());
  double low = std::numeric_limits<double>::infinity(), high = -low;
  for (const std::uint32_t f : triangles) {
    const double at = across.dot(centres[f]);
    low = std::min(low, at), high = std::max(high, at);
  }
  const auto whole = static_cast<double>(map_->region.size());
  const auto samples =
      std::max(parameters_.least_ruling_samples,
               static_cast<std::size_t>(static_cast<double>(parameters_.ruling_samples * triangles.size()) / whole));
  const double per_width = high > low ? (static_cast<double>(samples) - 1e-6) / (high - low) : 0.0;
  strips_.assign(samples, Strip());
  strip_of_.resize(triangles.size());
  for (std::size_t i = 0; i < triangles.size(); ++i) {
    const Vec2d& centre = centres[triangles[i]];
    strip_of_[i] = static_cast<std::uint32_t>((across.dot(centre) - low) * per_width);
    Strip& strip = strips_[strip_of_[i]];
    const double at = along.dot(centre), its_area = static_cast<double>(map_->faces.areas_m2[triangles[i]]);
    strip.low_m = std::min(strip.low_m, at), strip.high_m = std::max(strip.high_m, at);
    strip.area_m2 += its_area;
    ++strip.count;
  }
  std::uint32_t start = 0;
  for (Strip& strip : strips_) {
    strip.first = start;
    start += std::exchange(strip.count, 0);
  }
  by_strip_.resize(triangles.size());
  for (std::size_t i = 0; i < triangles.size(); ++i) {
    Strip& strip = strips_[strip_of_[i]];
    by_strip_[strip.first + strip.count++] = triangles[i];
  }
  constexpr double kGoldenRatio = 0.6180339887498949;
  Sequence random;
  double before = 0, share = 0.5;
  std::size_t current = 0;
  traces_.clear();
  for (std::size_t i = 0; i < samples; ++i) {
    const double target = (static_cast<double>(i) + 0.5) / static_cast<double>(samples) * area;
    while (current + 1 < samples && before + strips_[current].area_m2 < target) before += strips_[current++].area_m2;
    const Strip& strip = strips_[current];
    share += kGoldenRatio, share -= std::floor(share);
    const double wanted = strip.low_m + share * (strip.high_m - strip.low_m);
    std::uint32_t f = by_strip_[strip.first];
    double nearest = std::numeric_limits<double>::infinity();
    for (std::uint32_t k = strip.first; k < strip.first + strip.count; ++k) {
      const double away = std::fabs(along.dot(centres[by_strip_[k]]) - wanted);
      if (away < nearest) nearest = away, f = by_strip_[k];
    }
    double u = random.next(), v = random.next();
    if (u + v > 1) u = 1 - u, v = 1 - v;
    const sheet::Triangle& t = stencils_->topology->triangles()[f];
    const auto& x = stencils_->plane.coordinates_m;
    // Toward an inflection a place has less and less of a direction of its own.
    const double bent = std::fabs(static_cast<double>(map_->curvature_per_m[f])) / mean_curvature_per_m;
    const Vec2d from = x[t[0]] + u * (x[t[1]] - x[t[0]]) + v * (x[t[2]] - x[t[0]]);
    start_traces(f, from, bent >= kDirected ? ruling_direction(*map_, f) : along, std::min(bent / kDirected, 1.0));
  }
  // All advance in turn: each waits for memory while the others compute.
  under_way_.resize(traces_.size());
  for (std::uint32_t i = 0; i < traces_.size(); ++i) under_way_[i] = i;
  for (int step = 0; step < kMostSteps && !under_way_.empty(); ++step) {
    std::erase_if(under_way_, [&](std::uint32_t i) { return !advance(traces_[i], label); });
  }
  double sum = 0, weights = 0;
  for (const Trace& trace : traces_) {
    sum += trace.weight * trace.inside_m;
    weights += trace.weight / 2;
  }
  return weights > 0 ? sum / weights : 0.0;
}

/// Where a trace's side is crossed, in space.
Vec3f ResonatorFinder::crossing(const Trace& trace) const {
  const auto share = static_cast<float>(trace.off_m[0] / (trace.off_m[0] - trace.off_m[1]));
  const Vec3f &a = positions_m_[trace.ends[0]], &b = positions_m_[trace.ends[1]];
  return a + share * (b - a);
}

/// Both ways along a straight line of the rest plane, to the sides of the triangle.
void ResonatorFinder::start_traces(std::uint32_t triangle, const Vec2d& from, const Vec2d& direction, double weight) {
  const auto& x = stencils_->plane.coordinates_m;
  const sheet::Triangle& v = stencils_->topology->triangles()[triangle];
  const double off[3] = {offset(direction, x[v[0]] - from), offset(direction, x[v[1]] - from),
                         offset(direction, x[v[2]] - from)};
  Trace found[2];
  int count = 0;
  for (std::uint32_t k = 0; k < 3 && count < 2; ++k) {
    const std::uint32_t next = (k + 1) % 3;
    if ((off[k] > 0) == (off[next] > 0)) continue;
    Trace& trace = found[count++];
    trace.side = 3 * triangle + k;
    trace.ends[0] = v[k], trace.ends[1] = v[next];
    trace.off_m[0] = off[k], trace.off_m[1] = off[next];
    trace.from = from, trace.direction = direction;
    trace.weight = weight;
    trace.place = crossing(trace);
    trace.gap_m = std::max(2 * parameters_.min_region_width_m, 3 * stencils_->edge_length_m[triangle]);
  }
  if (count < 2) return;
  const auto half = static_cast<double>((found[1].place - found[0].place).norm()) / 2;
  for (Trace& trace : found) {
    trace.length_m = trace.inside_m = half;
    traces_.push_back(trace);
  }
}

/// Through the next triangle. False: the trace has left the region, for more than its gap: a ruling may run along a region
/// border that is jagged because it follows triangle edges. Lengths are measured in space.
bool ResonatorFinder::advance(Trace& trace, std::uint32_t label) const {
  const std::uint32_t side = stencils_->beyond[trace.side];
  if (side == kNone || trace.length_m - trace.inside_m > trace.gap_m) return false;
  const std::uint32_t triangle = side / 3, k = side - 3 * triangle, after = k == 2 ? 0 : k + 1,
                      opposite = k == 0 ? 2 : k - 1;
  const sheet::Triangle& corners = stencils_->topology->triangles()[triangle];
  const std::uint32_t apex = corners[opposite];
  const double off = offset(trace.direction, stencils_->plane.coordinates_m[apex] - trace.from);
  // It leaves by the side whose ends lie on either hand: the apex takes the place of the end on its own hand.
  const std::size_t replaced = (off > 0) != (trace.off_m[0] > 0) ? 1 : 0;
  const std::uint32_t kept = trace.ends[1 - replaced];
  trace.ends[replaced] = apex;
  trace.off_m[replaced] = off;
  trace.side = 3 * triangle + (corners[k] == kept ? opposite : after);
  const Vec3f there = crossing(trace);
  trace.length_m += static_cast<double>((there - trace.place).norm());
  trace.place = there;
  trace.inside_m = map_->region[triangle] == label ? trace.length_m : trace.inside_m;
  return true;
}

}  // namespace rustle::analysis
