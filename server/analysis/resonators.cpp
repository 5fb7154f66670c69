#include "server/analysis/resonators.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "server/sheet/disjoint_sets.h"

namespace rustle::analysis {
namespace {

using observation::Resonator;
using sheet::kNone;
using sheet::Vec2d;
using sheet::Vec3d;
using sheet::Vec3f;

constexpr int kMostSteps = 4000;
constexpr double kTightBend = 0.5;        // curvature times edge length: a bend within two edges
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

}  // namespace

ResonatorFinder::ResonatorFinder(const RegionStencils& stencils, const RegionMap& map, std::span<const Vec3f> positions_m,
                                 const Vec3d& origin_m, const Holds& holds, const Parameters& parameters,
                                 const sheet::SentPartition* partition)
    : stencils_(stencils),
      map_(map),
      positions_m_(positions_m),
      origin_m_(origin_m),
      holds_(holds),
      parameters_(parameters),
      partition_(partition),
      region_start_(map.region_count + 1, 0),
      region_triangles_(map.region.size()),
      measured_(map.region_count) {
  for (std::uint32_t r : map.region) ++region_start_[r + 1];
  for (std::size_t r = 0; r < map.region_count; ++r) region_start_[r + 1] += region_start_[r];
  std::vector<std::uint32_t> next(region_start_.begin(), region_start_.end() - 1);
  for (std::uint32_t f = 0; f < map.region.size(); ++f) region_triangles_[next[map.region[f]]++] = f;
}

std::vector<Resonator> ResonatorFinder::reached_from(std::span<const std::uint32_t> triangles, StopAt stop) {
  sheet::DisjointSets reach(map_.region_count);
  const auto stamped = [&](std::uint32_t v) {
    return holds_.anchored[v] || (stop == StopAt::kRidgesAndHolds && holds_.touching[v]);
  };
  for (const auto& e : stencils_.topology->interior_edges()) {
    const std::uint32_t a = map_.region[e.left], b = map_.region[e.right];
    if (a == b || (map_.ridge[e.left] && map_.ridge[e.right]) || stamped(e.start) || stamped(e.end)) continue;
    reach.join(a, b);
  }
  std::vector<bool> sounding(map_.region_count, false);
  for (std::uint32_t f : triangles) sounding[reach.find(map_.region[f])] = true;
  std::vector<Resonator> out;
  for (std::uint32_t r = 0; r < map_.region_count; ++r) {
    if (sounding[reach.find(r)] && region_start_[r] < region_start_[r + 1]) out.push_back(region(r));
  }
  return out;
}

const Resonator& ResonatorFinder::region(std::uint32_t label) {
  if (!measured_[label]) measured_[label] = measure(label);
  return *measured_[label];
}

Resonator ResonatorFinder::measure(std::uint32_t label) const {
  Resonator out;
  const auto& topology = *stencils_.topology;
  const std::span triangles(region_triangles_.begin() + region_start_[label],
                            region_triangles_.begin() + region_start_[label + 1]);
  if (triangles.empty()) return out;
  Vec3d first = Vec3d::Zero(), normal = Vec3d::Zero();
  Eigen::Matrix3d second = Eigen::Matrix3d::Zero();
  double bend = 0, edge = 0;
  for (std::uint32_t f : triangles) {
    const sheet::Triangle& v = topology.triangles()[f];
    const double area = map_.areas_m2[f];
    const Vec3d a = positions_m_[v[0]].cast<double>(), b = positions_m_[v[1]].cast<double>(),
                c = positions_m_[v[2]].cast<double>();
    const Vec3d sum = a + b + c;
    out.area_m2 += area;
    first += area / 3 * sum;
    // ∫ x xᵀ over a triangle: A/12 (Σ xi xiᵀ + (Σ xi)(Σ xi)ᵀ)
    second += area / 12 * (a * a.transpose() + b * b.transpose() + c * c.transpose() + sum * sum.transpose());
    normal += area * map_.normals[f].cast<double>();
    bend += area * std::fabs(map_.curvature_per_m[f]) * stencils_.edge_length_m[f];
    edge += area * stencils_.edge_length_m[f];
  }
  const double area = std::max(out.area_m2, 1e-30);
  const Vec3d mean =
      out.area_m2 > 0 ? Vec3d(first / area) : Vec3d(positions_m_[topology.triangles()[triangles[0]][0]].cast<double>());
  out.position_m = origin_m_ + mean;
  if (out.area_m2 > 0) out.covariance_m2 = second / area - mean * mean.transpose();
  if (normal.norm() > 1e-12 * area) out.normal = normal.normalized();
  double spread = 0;
  for (std::uint32_t f : triangles) {
    const double cosine = out.normal.dot(map_.normals[f].cast<double>());
    spread += map_.areas_m2[f] * std::max(1 - cosine * cosine, 0.0);
  }
  out.normal_spread = std::sqrt(spread / area);
  out.disc_radius_m = std::sqrt(out.area_m2 / std::numbers::pi);

  const bool curved = map_.region_curved[label];
  double perimeter = 0;
  const auto borders = topology.border_edges();
  for (std::size_t k = 0; k < borders.size(); ++k) {
    const auto& e = borders[k];
    if (map_.region[e.triangle] != label) continue;
    const double length = (positions_m_[e.end] - positions_m_[e.start]).norm();
    perimeter += length;
    const bool held =
        holds_.anchored[e.start] || holds_.anchored[e.end] || holds_.touching[e.start] || holds_.touching[e.end];
    if (curved && !held) out.free_border_length_m += length * static_cast<double>(map_.free_border[k]);
  }
  for (const auto& e : topology.interior_edges()) {
    if ((map_.region[e.left] == label) != (map_.region[e.right] == label)) {
      perimeter += (positions_m_[e.end] - positions_m_[e.start]).norm();
    }
  }
  if (curved) out.ruling_length_m = ruling_length_m(label);
  out.constrained = !curved || out.free_border_length_m < parameters_.free_border_min_m || !(out.ruling_length_m > 0);
  out.coarse = stencils_.graded || bend > kTightBend * area || 2 * area * area < kNarrowRegionEdges * edge * perimeter;
  return out;
}

double ResonatorFinder::ruling_length_m(std::uint32_t label) const {
  if (partition_ != nullptr) {
    double sum = 0;
    std::size_t count = 0;
    for (const auto& ruling : partition_->rulings) {
      if (ruling.region == label) sum += static_cast<double>((ruling.end_m - ruling.start_m).norm()), ++count;
    }
    if (count > 0) return sum / static_cast<double>(count);
  }
  // Sorted across the rulings, on which their length depends most, the sample is stratified where it matters.
  std::vector<std::uint32_t> triangles(region_triangles_.begin() + region_start_[label],
                                       region_triangles_.begin() + region_start_[label + 1]);
  Vec2d twice = Vec2d::Zero();
  for (std::uint32_t f : triangles) {
    const double angle = 2 * static_cast<double>(map_.ruling_rad[f]);
    twice += static_cast<double>(map_.areas_m2[f]) * Vec2d(std::cos(angle), std::sin(angle));
  }
  const double mean_angle = std::atan2(twice.y(), twice.x()) / 2;
  const Vec2d across(-std::sin(mean_angle), std::cos(mean_angle));
  std::stable_sort(triangles.begin(), triangles.end(), [&](std::uint32_t a, std::uint32_t b) {
    return across.dot(stencils_.centres.at_m[a]) < across.dot(stencils_.centres.at_m[b]);
  });
  std::vector<double> reached;
  double area = 0;
  for (std::uint32_t f : triangles) reached.push_back(area += static_cast<double>(map_.areas_m2[f]));
  if (!(area > 0)) return 0;
  Sequence random;
  const auto samples = static_cast<double>(parameters_.ruling_samples);
  double sum = 0;
  for (std::size_t i = 0; i < parameters_.ruling_samples; ++i) {
    const double target = (static_cast<double>(i) + 0.5) / samples * area;
    const auto at = std::min<std::size_t>(
        static_cast<std::size_t>(std::lower_bound(reached.begin(), reached.end(), target) - reached.begin()),
        triangles.size() - 1);
    const std::uint32_t f = triangles[at];
    double u = random.next(), v = random.next();
    if (u + v > 1) u = 1 - u, v = 1 - v;
    const sheet::Triangle& t = stencils_.topology->triangles()[f];
    const auto& x = stencils_.plane.coordinates_m;
    const Vec2d from = x[t[0]] + u * (x[t[1]] - x[t[0]]) + v * (x[t[2]] - x[t[0]]);
    const double gap = std::max(2 * parameters_.min_region_width_m, 2 * stencils_.edge_length_m[f]);
    const double angle = map_.ruling_rad[f];
    sum += traced_m(f, from, angle, gap) + traced_m(f, from, angle + std::numbers::pi, gap);
  }
  return sum / samples;
}

/// Along a straight line of the rest plane, until it leaves the region for more than `gap`: a ruling may run along a region
/// border that is jagged because it follows triangle edges. The length is measured in space.
double ResonatorFinder::traced_m(std::uint32_t triangle, const Vec2d& from, double angle_rad, double gap_m) const {
  const auto& x = stencils_.plane.coordinates_m;
  const auto& topology = *stencils_.topology;
  const Vec2d direction(std::cos(angle_rad), std::sin(angle_rad));
  const std::uint32_t label = map_.region[triangle];
  Vec2d at = from;
  double length = 0, inside = 0;
  std::uint32_t came = kNone;
  Vec3d place;
  {
    const sheet::Triangle& v = topology.triangles()[triangle];
    const Vec2d a = x[v[1]] - x[v[0]], b = x[v[2]] - x[v[0]], w = at - x[v[0]];
    const double det = a.x() * b.y() - a.y() * b.x();
    if (std::fabs(det) < 1e-20) return 0;
    const double s = (w.x() * b.y() - w.y() * b.x()) / det, t = (a.x() * w.y() - a.y() * w.x()) / det;
    place = (1 - s - t) * positions_m_[v[0]].cast<double>() + s * positions_m_[v[1]].cast<double>() +
            t * positions_m_[v[2]].cast<double>();
  }
  for (int step = 0; step < kMostSteps; ++step) {
    const sheet::Triangle& v = topology.triangles()[triangle];
    const auto& sides = topology.triangle_edges()[triangle];
    const Vec2d p = x[v[1]] - x[v[0]], q = x[v[2]] - x[v[0]];
    const double facing = p.x() * q.y() - p.y() * q.x() < 0 ? -1 : 1;
    double best = std::numeric_limits<double>::infinity();
    std::size_t side = 3;
    for (std::size_t k = 0; k < 3; ++k) {
      if (came != kNone && sides[k] == came) continue;
      const Vec2d edge = x[v[(k + 1) % 3]] - x[v[k]];
      const Vec2d outward = facing * Vec2d(edge.y(), -edge.x());
      const double d = direction.dot(outward);
      if (d <= 1e-12 * edge.norm()) continue;
      const double s = std::max((x[v[k]] - at).dot(outward) / d, 0.0);
      if (s < best) best = s, side = k;
    }
    if (side == 3) return inside;
    at += best * direction;
    const std::uint32_t a = v[side], b = v[(side + 1) % 3];
    const Vec2d edge = x[b] - x[a];
    const double share = std::clamp((at - x[a]).dot(edge) / std::max(edge.squaredNorm(), 1e-30), 0.0, 1.0);
    const Vec3d there = (1 - share) * positions_m_[a].cast<double>() + share * positions_m_[b].cast<double>();
    length += (there - place).norm();
    place = there;
    if (map_.region[triangle] == label) inside = length;
    if (sides[side] == kNone || length - inside > gap_m) return inside;
    came = sides[side];
    const auto& e = topology.interior_edges()[came];
    triangle = e.left == triangle ? e.right : e.left;
  }
  return inside;
}

}  // namespace rustle::analysis
