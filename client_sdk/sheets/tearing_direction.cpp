#include "client_sdk/sheets/tearing_direction.h"

#include <algorithm>
#include <cassert>
#include <limits>
#include <numbers>

namespace rustle::sheets {
namespace {

constexpr double kLeastOpening_rad = std::numbers::pi / 18;

/// Distance along the border from the corner (0, 0), counter-clockwise.
double along_border(const RectangleSize& size, Point2 p) {
  const double w = size.width_m, h = size.height_m;
  const double to[4] = {p.y, w - p.x, h - p.y, p.x};
  const auto side = std::min_element(to, to + 4) - to;
  if (side == 0) return p.x;
  if (side == 1) return w + p.y;
  if (side == 2) return w + h + (w - p.x);
  return 2 * w + h + (h - p.y);
}

Point2 border_point(const RectangleSize& size, double along) {
  const double w = size.width_m, h = size.height_m, around = 2 * (w + h);
  double s = std::fmod(std::fmod(along, around) + around, around);
  if (s < w) return {s, 0};
  if ((s -= w) < h) return {w, s};
  if ((s -= h) < w) return {w - s, h};
  return {0, h - (s - w)};
}

}  // namespace

Point2 border_hit(const RectangleSize& size, Point2 from_m, Point2 along) {
  assert(along.x != 0 || along.y != 0);
  double reach = std::numeric_limits<double>::infinity();
  if (along.x > 0) reach = std::min(reach, (size.width_m - from_m.x) / along.x);
  if (along.x < 0) reach = std::min(reach, -from_m.x / along.x);
  if (along.y > 0) reach = std::min(reach, (size.height_m - from_m.y) / along.y);
  if (along.y < 0) reach = std::min(reach, -from_m.y / along.y);
  const Point2 hit = from_m + std::max(0.0, reach) * along;
  return {std::clamp(hit.x, 0.0, size.width_m), std::clamp(hit.y, 0.0, size.height_m)};
}

Point2 outward_at(const RectangleSize& size, Point2 border_m) {
  const double to[4] = {border_m.y, size.width_m - border_m.x, size.height_m - border_m.y, border_m.x};
  constexpr Point2 kOut[4] = {{0, -1}, {1, 0}, {0, 1}, {-1, 0}};
  return kOut[std::min_element(to, to + 4) - to];
}

Point2 tear_start(const RectangleSize& size, const Grips& grips, double share) {
  double at[2];
  for (const auto side : {kLeft, kRight}) {
    at[side] = along_border(size, border_hit(size, grips[side].index_m, grips[side].index_m - grips[side].thumb_m));
  }
  const double around = 2 * (size.width_m + size.height_m);
  double gap = std::fmod(at[kRight] - at[kLeft] + 2 * around, around);
  if (gap > around / 2) gap -= around;  // the shorter way
  return border_point(size, at[kLeft] + std::clamp(share, 0.0, 1.0) * gap);
}

Point2 rotation_advance(const TearPose& pose, const HandMotions& motions, double torn_m_per_rad) {
  Point2 sum;
  for (const auto side : {kLeft, kRight}) {
    const Point2 v = direction_of(pose.grips[side].thumb_m - pose.tip_m);
    sum = sum + std::max(0.0, motions[side].rotation_rad) * v;
  }
  return torn_m_per_rad * sum;
}

Point2 translation_advance(const TearPose& pose, const HandMotions& motions) {
  const Point2 apart = motions[kRight].translation_m - motions[kLeft].translation_m;
  const double half_rad = std::max(pose.opening_rad(), kLeastOpening_rad) / 2;
  const double mean_rad = (pose.angle_rad[kLeft] + pose.angle_rad[kRight]) / 2;
  const Point2 advance = (1 / (2 * std::sin(half_rad))) * turned({-apart.y, apart.x}, -mean_rad);
  const Point2 ahead =
      direction_of(pose.grips[kLeft].thumb_m - pose.tip_m) + direction_of(pose.grips[kRight].thumb_m - pose.tip_m);
  return dot(advance, ahead) > 0 ? advance : Point2{};
}

}  // namespace rustle::sheets
