#include "server/analysis/rigid_motion.h"

#include <algorithm>
#include <cassert>
#include <cmath>

#include <Eigen/Geometry>
#include <Eigen/SVD>

namespace rustle::analysis {
namespace {

constexpr std::size_t kMostVertices = 128;
constexpr double kLeastSpread = 1e-6;  // second singular value beside the first: below it the axis of rotation is open

}  // namespace

std::optional<observation::RigidMotion> nearest_rigid_motion(std::span<const sheet::Vec3f> before_m,
                                                             std::span<const sheet::Vec3f> now_m) {
  assert(before_m.size() == now_m.size());
  if (before_m.size() < 3) return std::nullopt;
  const std::size_t step = (before_m.size() + kMostVertices - 1) / kMostVertices;
  sheet::Vec3d from = sheet::Vec3d::Zero();
  sheet::Vec3d to = sheet::Vec3d::Zero();
  std::size_t count = 0;
  for (std::size_t v = 0; v < before_m.size(); v += step, ++count) {
    from += before_m[v].cast<double>();
    to += now_m[v].cast<double>();
  }
  from /= static_cast<double>(count);
  to /= static_cast<double>(count);
  Eigen::Matrix3d correlation = Eigen::Matrix3d::Zero();
  for (std::size_t v = 0; v < before_m.size(); v += step)
    correlation += (now_m[v].cast<double>() - to) * (before_m[v].cast<double>() - from).transpose();
  if (!correlation.allFinite()) return std::nullopt;

  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(correlation, Eigen::ComputeFullU | Eigen::ComputeFullV);
  const auto& spread = svd.singularValues();
  if (spread[0] <= 0 || spread[1] < kLeastSpread * spread[0]) return std::nullopt;
  Eigen::Vector3d handedness(1, 1, 1);
  handedness[2] = (svd.matrixU() * svd.matrixV().transpose()).determinant() < 0 ? -1 : 1;
  const Eigen::Matrix3d rotation = svd.matrixU() * handedness.asDiagonal() * svd.matrixV().transpose();
  const Eigen::AngleAxisd turn(rotation);
  return observation::RigidMotion{from, to, turn.angle() * turn.axis()};
}

}  // namespace rustle::analysis
