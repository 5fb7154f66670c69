#include "server/analysis/unfolded.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "server/sheet/disjoint_sets.h"
#include "server/sheet/simd.h"
#include "server/sheet/vector_batch.h"

namespace rustle::analysis {
namespace {

using sheet::Triangle;
using sheet::Vec2d;
using sheet::Vec3d;
using sheet::Vec4f;

constexpr float kLeastCosine = 0.1f;
constexpr int kUnkept = 15;  // proofs that are not kept after one that served no further frame: the sheet moves too fast

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

constexpr std::size_t kLanes = 16;

/// Sides e1 and e2 of a batch of triangles.
struct SideBatch {
  sheet::VectorBatch e1_m, e2_m;
};

/// What triangles say, each by lane.
struct Normals {
  float least2[kLanes];                        // of (axis·c)² / (e1² + e2²)
  std::int32_t beyond[kLanes], steep[kLanes];  // any outside the cone; any near its edge
};

/// \pre lanes: a multiple of kLanes
RUSTLE_SIMD void add(const SideBatch& sides, std::size_t lanes, float x, float y, float z, Normals& s) {
  for (std::size_t first = 0; first < lanes; first += kLanes) {
    for (std::size_t i = 0; i < kLanes; ++i) {
      const auto &e1 = sides.e1_m.at[first + i], &e2 = sides.e2_m.at[first + i];
      const float ax = e1[0], ay = e1[1], az = e1[2], bx = e2[0], by = e2[1], bz = e2[2];
      const float cx = ay * bz - az * by, cy = az * bx - ax * bz, cz = ax * by - ay * bx;
      const float along = x * cx + y * cy + z * cz, along2 = along * along, c2 = cx * cx + cy * cy + cz * cz;
      const float sides2 = ax * ax + ay * ay + az * az + bx * bx + by * by + bz * bz;
      const bool within = (along >= 0) & (along2 >= kLeastCosine * kLeastCosine * c2);
      s.beyond[i] = within ? s.beyond[i] : 1;
      s.steep[i] = along2 <= 4 * kLeastCosine * kLeastCosine * c2 ? 1 : s.steep[i];
      const float per_sides = along2 / (sides2 > 0 ? sides2 : 1.0f);
      const float none2 = sides2 > 0 ? per_sides : s.least2[i];
      s.least2[i] = none2 < s.least2[i] ? none2 : s.least2[i];
    }
  }
}

NormalMargin normal_margin(const ContactGeometry& geometry, const Vec4f& axis) {
  constexpr float kKept = 0.5f;  // axis·c - k |c| ≥ kKept axis·c while axis·c ≥ 2 k |c|
  const auto& p = geometry.relative_m;
  const auto triangles = geometry.frame->topology->triangles();
  SideBatch sides;
  Normals normals{};
  std::fill(std::begin(normals.least2), std::end(normals.least2), std::numeric_limits<float>::infinity());
  const auto put = [&](std::size_t k, std::size_t i) {
    const Triangle& v = triangles[k];
    const Vec4f& corner = p[v[0]];
    sides.e1_m.put(i, p[v[1]] - corner);
    sides.e2_m.put(i, p[v[2]] - corner);
  };
  sheet::in_batches(triangles.size(), put, [&](std::size_t first, std::size_t here) {
    for (; here % kLanes != 0; ++here) put(first, here);  // the batch's first fills it
    add(sides, here, axis.x(), axis.y(), axis.z(), normals);
  });
  const auto any = [](const auto& flags) { return std::find(std::begin(flags), std::end(flags), 1) != std::end(flags); };
  if (any(normals.beyond)) return {false, 0};
  if (any(normals.steep)) return {true, 0};
  // |e1| + |e2| ≤ √2 √(e1² + e2²); the term in d² stays below a quarter of the other while d is below this margin.
  const float per_length = std::sqrt(*std::min_element(std::begin(normals.least2), std::end(normals.least2)) / 2);
  return {true, kKept * per_length / (2.5f * (1 + kLeastCosine))};
}

/// Of |a - b|² over so many points.
RUSTLE_SIMD float largest_squared_distance(const Vec4f* a_m, const Vec4f* b_m, std::size_t count) {
  float most[kLanes] = {};
  const auto take = [&](std::size_t k, std::size_t i) {
    const float *const a = a_m[k].data(), *const b = b_m[k].data();
    const float x = a[0] - b[0], y = a[1] - b[1], z = a[2] - b[2], distance2 = x * x + y * y + z * z;
    most[i] = most[i] < distance2 ? distance2 : most[i];
  };
  std::size_t k = 0;
  for (; k + kLanes <= count; k += kLanes) {
    for (std::size_t i = 0; i < kLanes; ++i) take(k + i, i);
  }
  for (; k < count; ++k) take(k, 0);
  return *std::max_element(std::begin(most), std::end(most));
}

}  // namespace

bool UnfoldedProof::holds(const ContactGeometry& geometry) {
  if (topology_ != geometry.frame->topology) {
    topology_ = geometry.frame->topology;
    connected_ = in_one_piece(*topology_);
    margin_m_ = 0;
    unkept_ = 0;
  }
  if (!connected_) return false;
  if (margin_m_ > 0) {
    if (still_stands(geometry)) {
      served_ = true;
      return true;
    }
    if (!served_) unkept_ = kUnkept;
  }
  return prove(geometry);
}

bool UnfoldedProof::still_stands(const ContactGeometry& geometry) const {
  return largest_squared_distance(geometry.relative_m.data(), proven_m_.data(), proven_m_.size()) < margin_m_ * margin_m_;
}

bool UnfoldedProof::prove(const ContactGeometry& geometry) {
  margin_m_ = 0;
  Vec4f axis = mean_normal(geometry);
  if (!(axis.norm() > 0)) return false;
  axis.normalize();
  const NormalMargin normals = normal_margin(geometry, axis);
  if (!normals.within) return false;
  const float star_m = star_margin_m(geometry, axis);
  if (!(star_m > 0)) return !border_crosses_itself(geometry, axis);
  margin_m_ = std::min(normals.margin_m, star_m) - geometry.rounding_m();
  if (unkept_ > 0) --unkept_, margin_m_ = 0;
  if (margin_m_ > 0) proven_m_.assign(geometry.relative_m.begin(), geometry.relative_m.end());
  served_ = false;
  return true;
}

/// Not of unit length. The sum of all cross products is that around the border, where triangles agree in orientation.
Vec4f UnfoldedProof::mean_normal(const ContactGeometry& geometry) const {
  Vec4f sum = Vec4f::Zero();
  const auto& p = geometry.relative_m;
  if (topology_->flaws().inconsistent_edges == 0 && topology_->flaws().non_manifold_edges == 0) {
    for (const auto& edge : topology_->border_edges()) sum += p[edge.start].cross3(p[edge.end]);
  } else {
    for (const Triangle& v : topology_->triangles()) sum += (p[v[1]] - p[v[0]]).cross3(p[v[2]] - p[v[0]]);
  }
  return sum;
}

/// Whether the border seen along the axis goes once around a point, always forward: then it cannot cross itself. How far its
/// vertices may move while it does, or 0. A vertex moves the doubled area of a side with the point, and the point itself, by
/// d at most.
float UnfoldedProof::star_margin_m(const ContactGeometry& geometry, const Vec4f& axis) const {
  const auto sides = topology_->border_edges();
  if (sides.empty()) return 0;
  const auto& p = geometry.relative_m;
  Vec4f centre = Vec4f::Zero();
  for (const auto& side : sides) centre += p[side.start];
  centre /= static_cast<float>(sides.size());
  const Eigen::Vector3f other = axis.head<3>().unitOrthogonal();
  const Vec4f across(other.x(), other.y(), other.z(), 0);
  int turns = 0;
  bool forward = true;
  float least_m = std::numeric_limits<float>::infinity();
  for (const auto& side : sides) {
    const Vec4f a = p[side.start] - centre, b = p[side.end] - centre;
    const float area2_m2 = axis.dot(a.cross3(b));
    forward = forward && area2_m2 > 0;
    turns += (across.dot(a) < 0) & (across.dot(b) >= 0);
    const float ratio_m = area2_m2 / (a.norm() + b.norm());
    least_m = ratio_m < least_m ? ratio_m : least_m;
  }
  // Both ends and the centre move: the doubled area changes by 2 d (|a| + |b|) + 4 d² at most.
  return forward && turns == 1 ? least_m / 2.5f : 0.0f;
}

void UnfoldedProof::project_border(const ContactGeometry& geometry, const Vec4f& axis) {
  const Vec3d along = axis.head<3>().cast<double>().normalized();
  const Vec3d across = along.unitOrthogonal();
  const Vec3d other = along.cross(across);
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

bool UnfoldedProof::border_crosses_itself(const ContactGeometry& geometry, const Vec4f& axis) {
  project_border(geometry, axis);
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
