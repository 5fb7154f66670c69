#pragma once

#include <cmath>

#include <Eigen/Core>

/// Points and directions that may cross a queue: plain data, unlike Eigen's matrices. Every operation acts on the
/// coordinates in one fixed order, so that a mirrored input gives the mirrored result bit for bit.
namespace rustle::spatial {

struct Vec3 {
  double x = 0, y = 0, z = 0;

  constexpr Vec3() = default;
  constexpr Vec3(double x_in, double y_in, double z_in) : x(x_in), y(y_in), z(z_in) {}
  Vec3(const Eigen::Vector3d& v) : x(v.x()), y(v.y()), z(v.z()) {}  // NOLINT(google-explicit-constructor)

  constexpr bool operator==(const Vec3&) const = default;
};

constexpr Vec3 operator+(const Vec3& a, const Vec3& b) noexcept {
  return {a.x + b.x, a.y + b.y, a.z + b.z};
}
constexpr Vec3 operator-(const Vec3& a, const Vec3& b) noexcept {
  return {a.x - b.x, a.y - b.y, a.z - b.z};
}
constexpr Vec3 operator-(const Vec3& a) noexcept {
  return {-a.x, -a.y, -a.z};
}
constexpr Vec3 operator*(double s, const Vec3& a) noexcept {
  return {s * a.x, s * a.y, s * a.z};
}
constexpr double dot(const Vec3& a, const Vec3& b) noexcept {
  return a.x * b.x + a.y * b.y + a.z * b.z;
}
constexpr Vec3 cross(const Vec3& a, const Vec3& b) noexcept {
  return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}
inline double norm(const Vec3& a) noexcept {
  return std::sqrt(dot(a, a));
}
/// a / |a|, or `otherwise` when |a| is below 1e-9 or not finite.
inline Vec3 normalized(const Vec3& a, const Vec3& otherwise) noexcept {
  const double length = norm(a);
  return length > 1e-9 && std::isfinite(length) ? (1.0 / length) * a : otherwise;
}

/// A symmetric 3 x 3 matrix, such as the covariance of positions.
struct SymmetricMatrix {
  double xx = 0, xy = 0, xz = 0, yy = 0, yz = 0, zz = 0;

  constexpr SymmetricMatrix() = default;
  SymmetricMatrix(const Eigen::Matrix3d& m)  // NOLINT(google-explicit-constructor)
      : xx(m(0, 0)), xy(m(0, 1)), xz(m(0, 2)), yy(m(1, 1)), yz(m(1, 2)), zz(m(2, 2)) {}
};

/// aᵀ M a.
constexpr double quadratic_form(const SymmetricMatrix& m, const Vec3& a) noexcept {
  return m.xx * a.x * a.x + m.yy * a.y * a.y + m.zz * a.z * a.z +
         2 * (m.xy * a.x * a.y + m.xz * a.x * a.z + m.yz * a.y * a.z);
}

}  // namespace rustle::spatial
