#pragma once

#include <cmath>

namespace rustle::sheets {

/// A point or a vector of a plane, metres.
struct Point2 {
  double x = 0, y = 0;

  friend Point2 operator+(Point2 a, Point2 b) { return {a.x + b.x, a.y + b.y}; }
  friend Point2 operator-(Point2 a, Point2 b) { return {a.x - b.x, a.y - b.y}; }
  friend Point2 operator*(double s, Point2 a) { return {s * a.x, s * a.y}; }
  friend bool operator==(Point2, Point2) = default;
};

inline double dot(Point2 a, Point2 b) {
  return a.x * b.x + a.y * b.y;
}
/// > 0 where b lies to the left of a.
inline double cross(Point2 a, Point2 b) {
  return a.x * b.y - a.y * b.x;
}
inline double length(Point2 a) {
  return std::hypot(a.x, a.y);
}
inline double angle_of(Point2 a) {
  return std::atan2(a.y, a.x);
}
/// Counter-clockwise.
inline Point2 turned(Point2 a, double angle_rad) {
  const double c = std::cos(angle_rad), s = std::sin(angle_rad);
  return {c * a.x - s * a.y, s * a.x + c * a.y};
}
/// Unit length; the zero vector stays zero.
inline Point2 direction_of(Point2 a) {
  const double l = length(a);
  return l > 0 ? (1 / l) * a : Point2{};
}

}  // namespace rustle::sheets
