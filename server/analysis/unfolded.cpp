#include "server/analysis/unfolded.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "server/sheet/disjoint_sets.h"
#include "server/sheet/simd.h"

namespace rustle::analysis {
namespace {

using sheet::Triangle;
using sheet::Vec2d;
using sheet::Vec3d;

constexpr float kLeastCosine = 0.1f;

double cross(const Vec2d& a, const Vec2d& b) {
  return a.x() * b.y() - a.y() * b.x();
}

bool in_one_piece(const sheet::Topology& topology) {
  const auto triangles = topology.triangles();
  sheet::DisjointSets sets(topology.vertex_count());
  for (const Triangle& v : triangles) sets.join(v[0], v[1]), sets.join(v[0], v[2]);
  return std::all_of(triangles.begin(), triangles.end(),
                     [&](const Triangle& v) { return sets.find(v[0]) == sets.find(triangles[0][0]); });
}

/// How far the corners of every triangle may move while its normal stays within the cone about the axis; 0: at once or not
/// at all within. With corners moved by d at most, a cross product c of sides e1, e2 changes by at most
/// 2 d (|e1| + |e2|) + 4 d², and it stays within while  axis·c - k |c|  exceeds (1 + k) times that.
struct NormalMargin {
  bool within;
  float margin_m;
};

constexpr std::size_t kBatch = 128;
using Lanes = float[kBatch];

/// Sides e1 and e2 of a batch of triangles, and what they say, each by lane.
struct Sides {
  Lanes e1[3], e2[3];
  Lanes least2;                                // of (axis·c)² / (e1² + e2²)
  std::int32_t within[kBatch], steep[kBatch];  // all within the cone; any near its edge
};

RUSTLE_SIMD void add(Sides& s, float x, float y, float z) {
  for (std::size_t i = 0; i < kBatch; ++i) {
    const float cx = s.e1[1][i] * s.e2[2][i] - s.e1[2][i] * s.e2[1][i],
                cy = s.e1[2][i] * s.e2[0][i] - s.e1[0][i] * s.e2[2][i],
                cz = s.e1[0][i] * s.e2[1][i] - s.e1[1][i] * s.e2[0][i];
    const float along = x * cx + y * cy + z * cz, along2 = along * along, c2 = cx * cx + cy * cy + cz * cz;
    const float sides2 = s.e1[0][i] * s.e1[0][i] + s.e1[1][i] * s.e1[1][i] + s.e1[2][i] * s.e1[2][i] +
                         s.e2[0][i] * s.e2[0][i] + s.e2[1][i] * s.e2[1][i] + s.e2[2][i] * s.e2[2][i];
    const bool within = (along >= 0) & (along2 >= kLeastCosine * kLeastCosine * c2);
    s.within[i] = within ? s.within[i] : 0;
    s.steep[i] = along2 <= 4 * kLeastCosine * kLeastCosine * c2 ? 1 : s.steep[i];
    const float per_sides = along2 / (sides2 > 0 ? sides2 : 1.0f);
    const float none2 = sides2 > 0 ? per_sides : s.least2[i];
    s.least2[i] = none2 < s.least2[i] ? none2 : s.least2[i];
  }
}

NormalMargin normal_margin(const ContactGeometry& geometry, const Vec3d& axis) {
  constexpr float kKept = 0.5f;  // axis·c - k |c| ≥ kKept axis·c while axis·c ≥ 2 k |c|
  const auto x = static_cast<float>(axis.x()), y = static_cast<float>(axis.y()), z = static_cast<float>(axis.z());
  const auto& p = geometry.relative_m;
  const auto triangles = geometry.frame->topology->triangles();
  Sides sides;
  std::fill(std::begin(sides.least2), std::end(sides.least2), std::numeric_limits<float>::infinity());
  std::fill(std::begin(sides.within), std::end(sides.within), 1);
  std::fill(std::begin(sides.steep), std::end(sides.steep), 0);
  for (std::size_t first = 0; first < triangles.size(); first += kBatch) {
    for (std::size_t i = 0; i < kBatch; ++i) {
      const Triangle& v = triangles[std::min(first + i, triangles.size() - 1)];  // the last fills the last batch
      const Eigen::Vector4f &a = p[v[0]], &b = p[v[1]], &c = p[v[2]];
      for (int d = 0; d < 3; ++d) {
        sides.e1[d][i] = b[d] - a[d];
        sides.e2[d][i] = c[d] - a[d];
      }
    }
    add(sides, x, y, z);
  }
  if (std::find(std::begin(sides.within), std::end(sides.within), 0) != std::end(sides.within)) return {false, 0};
  if (std::find(std::begin(sides.steep), std::end(sides.steep), 1) != std::end(sides.steep)) return {true, 0};
  // |e1| + |e2| ≤ √2 √(e1² + e2²); the term in d² stays below a quarter of the other while d is below this margin.
  const float per_length = std::sqrt(*std::min_element(std::begin(sides.least2), std::end(sides.least2)) / 2);
  return {true, kKept * per_length / (2.5f * (1 + kLeastCosine))};
}

}  // namespace

bool UnfoldedProof::holds(const ContactGeometry& geometry) {
  if (topology_ != geometry.frame->topology) {
    topology_ = geometry.frame->topology;
    connected_ = in_one_piece(*topology_);
    margin_m_ = 0;
  }
  return connected_ && (still_stands(geometry) || prove(geometry));
}

bool UnfoldedProof::still_stands(const ContactGeometry& geometry) const {
  if (!(margin_m_ > 0)) return false;
  Eigen::Array4f most2 = Eigen::Array4f::Zero();
  for (std::size_t i = 0; i < proven_m_.size(); ++i) {
    const Eigen::Array4f moved = (geometry.relative_m[i] - proven_m_[i]).array();
    most2 = most2.max(moved * moved);
  }
  return most2.sum() < margin_m_ * margin_m_;
}

bool UnfoldedProof::prove(const ContactGeometry& geometry) {
  margin_m_ = 0;
  const Vec3d mean = mean_normal(geometry);
  if (!(mean.norm() > 0)) return false;
  const Vec3d axis = mean.normalized();
  const NormalMargin normals = normal_margin(geometry, axis);
  if (!normals.within) return false;
  project_border(geometry, axis);
  const float star_m = star_margin_m();
  if (!(star_m > 0)) return !border_crosses_itself();
  margin_m_ = std::min(normals.margin_m, star_m) - geometry.rounding_m();
  if (margin_m_ > 0) proven_m_ = geometry.relative_m;
  return true;
}

/// Not of unit length. The sum of all cross products is that around the border, where triangles agree in orientation.
Vec3d UnfoldedProof::mean_normal(const ContactGeometry& geometry) const {
  Vec3d sum = Vec3d::Zero();
  const auto& p = geometry.relative_m;
  const auto at = [&](std::uint32_t v) { return Vec3d(p[v].head<3>().cast<double>()); };
  if (topology_->flaws().inconsistent_edges == 0 && topology_->flaws().non_manifold_edges == 0) {
    for (const auto& edge : topology_->border_edges()) sum += at(edge.start).cross(at(edge.end));
  } else {
    for (const Triangle& v : topology_->triangles()) sum += (at(v[1]) - at(v[0])).cross(at(v[2]) - at(v[0]));
  }
  return sum;
}

void UnfoldedProof::project_border(const ContactGeometry& geometry, const Vec3d& axis) {
  const Vec3d across = axis.unitOrthogonal();
  const Vec3d other = axis.cross(across);
  const auto place = [&](std::uint32_t v) {
    const Vec3d p = geometry.relative_m[v].head<3>().cast<double>();
    return Vec2d(across.dot(p), other.dot(p));
  };
  sides_.clear();
  for (const auto& edge : topology_->border_edges()) {
    const Vec2d start = place(edge.start);
    const Vec2d end = place(edge.end);
    sides_.push_back({start, end, edge.start, edge.end, std::min(start.x(), end.x()), std::max(start.x(), end.x())});
  }
}

/// Whether the border goes once around a point, always forward: then it cannot cross itself. How far its vertices may move
/// while it does, or 0. A vertex moves the doubled area of a side with the point, and the point itself, by d at most.
float UnfoldedProof::star_margin_m() const {
  if (sides_.empty()) return 0;
  Vec2d centre = Vec2d::Zero();
  for (const Side& side : sides_) centre += side.start;
  centre /= static_cast<double>(sides_.size());
  int turns = 0;
  double least_m = std::numeric_limits<double>::infinity();
  for (const Side& side : sides_) {
    const Vec2d a = side.start - centre;
    const Vec2d b = side.end - centre;
    const double area2_m2 = cross(a, b);
    if (area2_m2 <= 0) return 0;
    turns += a.y() < 0 && b.y() >= 0;
    least_m = std::min(least_m, area2_m2 / (a.lpNorm<1>() + b.lpNorm<1>()));
  }
  // Both ends and the centre move: the doubled area changes by 2 d (|a| + |b|) + 4 d² at most.
  return turns == 1 ? static_cast<float>(least_m / 2.5) : 0.0f;
}

bool UnfoldedProof::border_crosses_itself() {
  order_.clear();
  for (std::uint32_t i = 0; i < sides_.size(); ++i) order_.emplace_back(sides_[i].low, i);
  std::sort(order_.begin(), order_.end());
  for (std::size_t i = 0; i < order_.size(); ++i) {
    const Side& a = sides_[order_[i].second];
    for (std::size_t j = i + 1; j < order_.size() && order_[j].first <= a.high; ++j) {
      const Side& b = sides_[order_[j].second];
      if (std::max(a.start.y(), a.end.y()) < std::min(b.start.y(), b.end.y())) continue;
      if (std::max(b.start.y(), b.end.y()) < std::min(a.start.y(), a.end.y())) continue;
      if (a.first == b.first || a.first == b.last || a.last == b.first || a.last == b.last) continue;
      if (cross(a.end - a.start, b.start - a.start) * cross(a.end - a.start, b.end - a.start) > 0) continue;
      if (cross(b.end - b.start, a.start - b.start) * cross(b.end - b.start, a.end - b.start) > 0) continue;
      return true;
    }
  }
  return false;
}

}  // namespace rustle::analysis
