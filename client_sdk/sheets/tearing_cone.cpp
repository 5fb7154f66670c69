#include "client_sdk/sheets/tearing_cone.h"

#include <algorithm>
#include <cassert>
#include <cstddef>
#include <numbers>

namespace rustle::sheets {
namespace {

constexpr std::size_t kPieces = 64;    // of each Hermite curve
constexpr double kSteepest_rad = 2.4;  // of m, seen from below it
constexpr int kMostTrials = 60;
constexpr double kSolved_rad = 1e-12;
constexpr double kFlat_rad = 1e-9;
constexpr double kLeastReach = 0.25;  // of m from the thumbs' line, in distances to their middle
constexpr std::size_t kHeightSteps = 64;

double norm(const Point3& p) {
  return std::hypot(p[0], p[1], p[2]);
}

/// Thumbs and apex on the table, and the circle on which m lies.
struct Frame {
  Point2 apex, thumbs[2];
  Point2 across;   ///< from the left thumb to the right one, unit length
  Point2 foot;     ///< of the apex on the line that halves the thumbs' line
  Point2 ahead;    ///< away from the apex, unit length
  double reach_m;  ///< of m from the foot
  double tangent_m;
};

struct Curve {
  std::vector<Point3> directions;
  std::vector<double> along_rad;
  double length_rad() const { return along_rad.back(); }
};

/// The curve whose middle lies at the angle `rise_rad` over the table, seen from the foot.
Curve curve_at(const Frame& frame, double rise_rad) {
  const double out = frame.reach_m * std::cos(rise_rad), up = frame.reach_m * std::sin(rise_rad);
  const Point2 m = frame.foot + out * frame.ahead;
  Curve curve;
  curve.directions.reserve(2 * kPieces + 1);
  for (std::size_t k = 0; k <= 2 * kPieces; ++k) {
    const bool second = k > kPieces;
    const double u = static_cast<double>(second ? k - kPieces : k) / kPieces;
    const double end = u * u * (3 - 2 * u), tangents = u * (1 - u) * (1 - 2 * u);
    const Point2 from = second ? m : frame.thumbs[0], to = second ? frame.thumbs[1] : m;
    const Point2 p = from + end * (to - from) + tangents * frame.tangent_m * frame.across - frame.apex;
    const double z = up * (second ? 1 - end : end);
    const double l = std::hypot(p.x, p.y, z);
    curve.directions.push_back({p.x / l, p.y / l, z / l});
    if (k == 0) {
      curve.along_rad.push_back(0);
      continue;
    }
    const Point3 &a = curve.directions[k - 1], &b = curve.directions[k];
    const double chord = std::hypot(b[0] - a[0], b[1] - a[1], b[2] - a[2]);
    curve.along_rad.push_back(curve.along_rad.back() + 2 * std::asin(std::min(1.0, chord / 2)));
  }
  return curve;
}

/// The curve that is this long: by regula falsi (the Illinois algorithm; Dowell, Jarratt 1971).
Curve solved(const Frame& frame, double length_rad) {
  double low = 0, high = kSteepest_rad;
  Curve curve = curve_at(frame, low);
  double below = curve.length_rad() - length_rad, above = curve_at(frame, high).length_rad() - length_rad;
  if (below >= 0) return curve;
  for (int k = 0, last = 0; k < kMostTrials; ++k) {
    const double trial = (low * above - high * below) / (above - below);
    curve = curve_at(frame, trial);
    const double excess = curve.length_rad() - length_rad;
    if (std::abs(excess) < kSolved_rad) break;
    const int side = excess < 0 ? -1 : 1;
    if (side == last) (side < 0 ? above : below) /= 2;
    last = side;
    (side < 0 ? low : high) = trial;
    (side < 0 ? below : above) = excess;
  }
  return curve;
}

}  // namespace

TearCone::TearCone(const TearPose& pose, double roundness)
    : tip_m_(pose.tip_m),
      placed_tip_m_(pose.placed_tip_m),
      left_(direction_of(pose.grips[kLeft].thumb_m - pose.tip_m)),
      angle_rad_(pose.thumbs_angle_rad()),
      opening_rad_(pose.opening_rad()),
      left_heading_rad_(angle_of(left_) + pose.angle_rad[kLeft]),
      strain_(pose.strain()) {
  assert(angle_rad_ > 0 && angle_rad_ < std::numbers::pi && opening_rad_ >= 0 && opening_rad_ < angle_rad_);
  if (opening_rad_ < kFlat_rad) return;
  Frame frame;
  frame.apex = placed_tip_m_;
  for (const auto side : {kLeft, kRight}) frame.thumbs[side] = pose.region(side).at(pose.grips[side].thumb_m);
  const Point2 line = frame.thumbs[1] - frame.thumbs[0], middle = 0.5 * (frame.thumbs[0] + frame.thumbs[1]);
  frame.across = direction_of(line);
  frame.foot = frame.apex + dot(middle - frame.apex, frame.across) * frame.across;
  frame.ahead = direction_of(middle - frame.foot);
  frame.tangent_m = roundness * length(line) / 2;
  const double to_middle_m = length(0.5 * (pose.grips[0].thumb_m + pose.grips[1].thumb_m) - pose.tip_m);
  const double aside_m = length(frame.foot - frame.apex);
  frame.reach_m = std::sqrt(
      std::max((to_middle_m + aside_m) * (to_middle_m - aside_m), kLeastReach * kLeastReach * to_middle_m * to_middle_m));
  Curve curve = solved(frame, angle_rad_);
  const double rest = angle_rad_ / curve.length_rad();
  for (double& along : curve.along_rad) along *= rest;
  directions_ = std::move(curve.directions);
  along_rad_ = std::move(curve.along_rad);
  for (std::size_t k = 1; k < kHeightSteps; ++k) {
    const double share = static_cast<double>(k) / kHeightSteps;
    const Point3 p = at(pose.grips[0].thumb_m + share * (pose.grips[1].thumb_m - pose.grips[0].thumb_m));
    const double beyond = dot(Point2{p[0], p[1]} - middle, frame.ahead);
    height_m_ = std::max(height_m_, p[2]);
    rise_m_ = std::max(rise_m_, std::hypot(p[2], beyond));
  }
}

bool TearCone::covers(Point2 material_m) const {
  const Point2 p = material_m - tip_m_;
  const double from_left_rad = -std::atan2(cross(left_, p), dot(left_, p));
  return from_left_rad >= 0 && from_left_rad <= angle_rad_;
}

Point3 TearCone::direction(double along_rad) const {
  if (directions_.empty()) {
    const double heading = left_heading_rad_ - along_rad;
    return {std::cos(heading), std::sin(heading), 0};
  }
  const auto next = std::upper_bound(along_rad_.begin() + 1, along_rad_.end() - 1, along_rad);
  const auto k = static_cast<std::size_t>(next - along_rad_.begin());
  const double share = std::clamp((along_rad - along_rad_[k - 1]) / (along_rad_[k] - along_rad_[k - 1]), 0.0, 1.0);
  Point3 out{};
  for (std::size_t c = 0; c < 3; ++c) out[c] = std::lerp(directions_[k - 1][c], directions_[k][c], share);
  const double l = norm(out);
  return {out[0] / l, out[1] / l, out[2] / l};
}

Point3 TearCone::at(Point2 material_m) const {
  const Point2 p = material_m - tip_m_;
  const double from_left_rad = -std::atan2(cross(left_, p), dot(left_, p)), away_m = length(p);
  const Point3 d = direction(std::clamp(from_left_rad, 0.0, angle_rad_));
  return {placed_tip_m_.x + away_m * d[0], placed_tip_m_.y + away_m * d[1], away_m * d[2]};
}

double arch_rise(double strain) {
  return 2 / std::numbers::pi * std::sqrt(strain);
}

}  // namespace rustle::sheets
