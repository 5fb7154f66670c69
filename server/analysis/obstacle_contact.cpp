#include "server/analysis/obstacle_contact.h"

#include <algorithm>
#include <cmath>

#include "server/sheet/simd.h"

namespace rustle::analysis {

using sheet::Triangle;
using sheet::Vec3d;

namespace {

/// n·p + offset of every point.
RUSTLE_SIMD void plane_distances_m(const sheet::Vec4f* points_m, std::size_t count, const Eigen::Vector3f& normal,
                                   float offset_m, float* out_m) {
  const float x = normal.x(), y = normal.y(), z = normal.z();
  for (std::size_t i = 0; i < count; ++i) {
    const float* const p = points_m[i].data();
    out_m[i] = x * p[0] + y * p[1] + z * p[2] + offset_m;
  }
}

}  // namespace

void ObstacleContact::set(const scene::ObstacleSurface& obstacle) {
  obstacle_ = &obstacle;
  usual_edge_m_ = 0;
  if (obstacle.is_plane()) plane_ = {obstacle.pose().position_m, obstacle.rotation().col(2), obstacle.motion()};
}

void ObstacleContact::select(const ContactGeometry& geometry, double radius_m, std::vector<std::uint32_t>& out_triangles) {
  out_triangles.clear();
  if (obstacle_->is_plane()) {
    select_by_distance(geometry, radius_m, out_triangles);
  } else {
    select_by_box(geometry, radius_m, out_triangles);
  }
}

void ObstacleContact::select_by_distance(const ContactGeometry& geometry, double radius_m,
                                         std::vector<std::uint32_t>& out_triangles) {
  const Eigen::Vector3f normal = plane_.normal.cast<float>();
  const auto offset_m = static_cast<float>(plane_.normal.dot(geometry.origin_m.cast<double>() - plane_.position_m));
  const float limit_m = static_cast<float>(radius_m) + geometry.rounding_m() + 2e-6f * std::abs(offset_m);
  distances_m_.resize(geometry.relative_m.size());
  plane_distances_m(geometry.relative_m.data(), distances_m_.size(), normal, offset_m, distances_m_.data());
  const auto triangles = geometry.frame->topology->triangles();
  out_triangles.resize(triangles.size() + 1);  // what is not near is written behind
  std::size_t count = 0;
  for (std::uint32_t t = 0; t < triangles.size(); ++t) {
    const Triangle& v = triangles[t];
    out_triangles[count] = t;
    count += std::min(std::min(distances_m_[v[0]], distances_m_[v[1]]), distances_m_[v[2]]) <= limit_m;
  }
  out_triangles.resize(count);
}

void ObstacleContact::select_by_box(const ContactGeometry& geometry, double radius_m,
                                    std::vector<std::uint32_t>& out_triangles) {
  const scene::Box bounds = obstacle_->own_bounds_m();
  if (bounds.isEmpty()) return;
  const Eigen::Matrix3d to_own = obstacle_->rotation().transpose();
  const Vec3d origin = to_own * (geometry.origin_m.cast<double>() - obstacle_->pose().position_m);
  const auto padded = [](const Vec3d& v) {
    return Eigen::Array4f(static_cast<float>(v.x()), static_cast<float>(v.y()), static_cast<float>(v.z()), 0.0f);
  };
  const Eigen::Array4f x = padded(to_own.col(0));
  const Eigen::Array4f y = padded(to_own.col(1));
  const Eigen::Array4f z = padded(to_own.col(2));
  const Eigen::Array4f start = padded(origin);
  own_m_.resize(geometry.relative_m.size());
  for (std::size_t i = 0; i < own_m_.size(); ++i) {
    const Eigen::Vector4f& p = geometry.relative_m[i];
    own_m_[i] = (p.x() * x + p.y() * y + p.z() * z + start).matrix();
  }
  const double largest_m = std::max(origin.cwiseAbs().maxCoeff(),
                                    std::max(bounds.min().cwiseAbs().maxCoeff(), bounds.max().cwiseAbs().maxCoeff()));
  const double slack_m = radius_m + static_cast<double>(geometry.rounding_m()) + 2e-6 * largest_m;
  const Eigen::Array4f low = padded(Vec3d(bounds.min() - Vec3d::Constant(slack_m)));
  const Eigen::Array4f high = padded(Vec3d(bounds.max() + Vec3d::Constant(slack_m)));

  const auto triangles = geometry.frame->topology->triangles();
  for (std::uint32_t t = 0; t < triangles.size(); ++t) {
    const Triangle& v = triangles[t];
    const Eigen::Array4f a = own_m_[v[0]].array();
    const Eigen::Array4f b = own_m_[v[1]].array();
    const Eigen::Array4f c = own_m_[v[2]].array();
    const Eigen::Array4f outside = (a.min(b).min(c) - high).max(low - a.max(b).max(c));
    if (outside.maxCoeff() <= 0) out_triangles.push_back(t);
  }
  if (obstacle_->is_mesh()) {
    const auto& positions_m = geometry.frame->positions_m;
    std::erase_if(out_triangles, [&](std::uint32_t t) {
      const scene::Box box = scene::triangle_box(triangles[t], positions_m);
      const Vec3d reach = Vec3d::Constant(radius_m);
      return !obstacle_->may_meet(scene::Box(Vec3d(box.min() - reach), Vec3d(box.max() + reach)));
    });
  }
  double area_m2 = 0;
  for (const std::uint32_t t : out_triangles) {
    const Triangle& v = triangles[t];
    const auto& p = geometry.relative_m;
    area_m2 += 0.5 * static_cast<double>((p[v[1]] - p[v[0]]).cross3(p[v[2]] - p[v[0]]).norm());
  }
  if (!out_triangles.empty()) {
    usual_edge_m_ = std::sqrt(area_m2 / static_cast<double>(out_triangles.size()) * 4 / std::sqrt(3.0));
  }
}

bool ObstacleContact::touch(const Vec3d& point_m, const SheetSpot&, double radius_m, Touch& out) {
  const auto closest = obstacle_->closest(point_m, radius_m);
  if (!closest) return false;
  // A mesh may be open: both of its sides are outside.
  const bool behind = obstacle_->is_mesh() && closest->distance_m < 0;
  out.distance_m = behind ? -closest->distance_m : closest->distance_m;
  out.normal = closest->normal;
  out.side_normal = behind ? Vec3d(-closest->normal) : closest->normal;
  out.velocity_m_per_s = obstacle_->velocity_m_per_s(*closest);
  out.velocity_known = true;
  out.triangle = closest->triangle;
  return true;
}

}  // namespace rustle::analysis
