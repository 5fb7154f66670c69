#include "server/scene/proximity.h"

#include <cassert>
#include <cmath>
#include <limits>
#include <variant>

namespace rustle::scene {
namespace {

SurfacePoint from_axis_point(const Vec3d& axis_point, double radius_m, const Vec3d& query, const Vec3d& fallback) {
  const Vec3d offset = query - axis_point;
  const double length = offset.norm();
  SurfacePoint point;
  point.normal = length > 0 ? Vec3d(offset / length) : fallback;
  point.position_m = axis_point + radius_m * point.normal;
  point.distance_m = length - radius_m;
  return point;
}

/// Own-frame half extents of a solid, infinite ones included.
Vec3d half_extents(const Shape& shape) {
  if (const auto* box = std::get_if<BoxShape>(&shape)) return box->half_extents_m;
  if (const auto* sphere = std::get_if<SphereShape>(&shape)) return Vec3d::Constant(sphere->radius_m);
  if (const auto* capsule = std::get_if<CapsuleShape>(&shape)) {
    return {capsule->radius_m, capsule->radius_m, capsule->radius_m + capsule->half_length_m};
  }
  return Vec3d::Constant(std::numeric_limits<double>::infinity());
}

/// The box around a turned box; `rotation` takes its frame to the new one.
Box turned(const Box& box, const Eigen::Matrix3d& rotation, const Vec3d& shift) {
  const Vec3d centre = rotation * box.center() + shift;
  const Vec3d half = rotation.cwiseAbs() * (0.5 * box.sizes());
  return {Vec3d(centre - half), Vec3d(centre + half)};
}

}  // namespace

SurfacePoint closest_point(const PlaneShape&, const Vec3d& query) {
  SurfacePoint point;
  point.position_m = {query.x(), query.y(), 0};
  point.normal = Vec3d::UnitZ();
  point.distance_m = query.z();
  return point;
}

SurfacePoint closest_point(const BoxShape& box, const Vec3d& query) {
  SurfacePoint point;
  const Vec3d inside = query.cwiseMax(-box.half_extents_m).cwiseMin(box.half_extents_m);
  const Vec3d offset = query - inside;
  const double length = offset.norm();
  if (length > 0) {
    point.position_m = inside;
    point.normal = offset / length;
    point.distance_m = length;
    return point;
  }
  int axis = 0;
  const double depth = (box.half_extents_m - query.cwiseAbs()).minCoeff(&axis);
  const double side = query[axis] < 0 ? -1.0 : 1.0;
  point.position_m = query;
  point.position_m[axis] = side * box.half_extents_m[axis];
  point.normal = side * Vec3d::Unit(axis);
  point.distance_m = -depth;
  return point;
}

SurfacePoint closest_point(const SphereShape& sphere, const Vec3d& query) {
  return from_axis_point(Vec3d::Zero(), sphere.radius_m, query, Vec3d::UnitZ());
}

SurfacePoint closest_point(const CapsuleShape& capsule, const Vec3d& query) {
  const Vec3d axis_point(0, 0, std::clamp(query.z(), -capsule.half_length_m, capsule.half_length_m));
  return from_axis_point(axis_point, capsule.radius_m, query, Vec3d::UnitX());
}

void ObstacleSurface::update(const ObstacleTrack& track, double time_s, double over_s) {
  pose_ = track.pose(time_s);
  rotation_ = pose_.orientation.toRotationMatrix();
  turned_ = pose_.orientation.vec().squaredNorm() > 0;
  motion_ = track.motion(time_s, over_s);
  description_ = track.shared_description();
  const MeshShape* mesh = track.mesh();
  if (!mesh) {
    revision_ = track.revision();
    return;
  }
  const bool is_new = revision_ != track.revision();
  if (is_new || track.deforms()) {
    track.vertices_m(time_s, vertices_m_);
    if (is_new) {
      tree_.build(mesh->triangles, vertices_m_);
    } else {
      tree_.refit(vertices_m_);
    }
  }
  revision_ = track.revision();
  track.vertex_velocities_m_per_s(time_s, over_s, velocities_m_per_s_);
}

std::optional<SurfacePoint> ObstacleSurface::closest(const Vec3d& query_m, double radius_m) const {
  if (is_plane()) {
    SurfacePoint point;
    point.normal = rotation_.col(2);
    point.distance_m = point.normal.dot(query_m - pose_.position_m);
    point.position_m = query_m - point.distance_m * point.normal;
    return point.distance_m > radius_m ? std::nullopt : std::optional(point);
  }
  const Vec3d shifted = query_m - pose_.position_m;
  const Vec3d query = turned_ ? Vec3d(rotation_.transpose() * shifted) : shifted;
  SurfacePoint point;
  if (const auto* mesh = std::get_if<MeshShape>(&description_->shape)) {
    double best2 = radius_m * radius_m;
    double best_facing = 0;
    bool found = false;
    tree_.visit_near(query, radius_m, [&](std::uint32_t t) {
      const Triangle& triangle = mesh->triangles[t];
      const Vec3d a = vertices_m_[triangle[0]].cast<double>();
      const Vec3d b = vertices_m_[triangle[1]].cast<double>();
      const Vec3d c = vertices_m_[triangle[2]].cast<double>();
      const TrianglePoint on = closest_on_triangle(query, a, b, c);
      const Vec3d offset = query - on.position_m;
      const double distance2 = offset.squaredNorm();
      const double tie = 1e-9 * best2 + 1e-18;
      if (distance2 > best2 + tie) return best2;
      const Vec3d normal = (b - a).cross(c - a).normalized();
      // At a shared edge or corner the triangle that faces the query most tells inside from outside.
      const double facing = offset.dot(normal);
      if (found && distance2 > best2 - tie && std::abs(facing) <= std::abs(best_facing)) return best2;
      found = true;
      best2 = std::min(best2, distance2);
      best_facing = facing;
      const double side = facing < 0 ? -1.0 : 1.0;
      const double distance = std::sqrt(distance2);
      point.position_m = on.position_m;
      point.barycentric = on.barycentric;
      point.triangle = t;
      point.distance_m = side * distance;
      point.normal = distance > 1e-9 ? Vec3d(offset * (side / distance)) : normal;
      return best2;
    });
    if (!found) return std::nullopt;
  } else {
    point = std::visit(
        [&](const auto& shape) -> SurfacePoint {
          if constexpr (std::is_same_v<std::decay_t<decltype(shape)>, MeshShape>) {
            return {};
          } else {
            return closest_point(shape, query);
          }
        },
        description_->shape);
    if (point.distance_m > radius_m) return std::nullopt;
  }
  if (turned_) {
    point.position_m = rotation_ * point.position_m;
    point.normal = rotation_ * point.normal;
  }
  point.position_m += pose_.position_m;
  return point;
}

bool ObstacleSurface::may_meet(const Box& box_m) const {
  if (is_plane()) {
    const Vec3d normal = rotation_.col(2);
    const double reach = normal.cwiseAbs().dot(0.5 * box_m.sizes());
    return normal.dot(box_m.center() - pose_.position_m) <= reach;
  }
  const Box own = !turned_ ? Box(Vec3d(box_m.min() - pose_.position_m), Vec3d(box_m.max() - pose_.position_m))
                           : turned(box_m, rotation_.transpose(), -(rotation_.transpose() * pose_.position_m));
  if (is_mesh()) return tree_.touches(own);
  const Vec3d half = half_extents(description_->shape);
  return own.intersects(Box(Vec3d(-half), half));
}

Box ObstacleSurface::own_bounds_m() const {
  if (is_mesh()) return tree_.bounds();
  const Vec3d half = half_extents(description_->shape);
  if (is_plane()) return {Vec3d(-half), Vec3d(half.x(), half.y(), 0)};
  return {Vec3d(-half), half};
}

Vec3d ObstacleSurface::velocity_m_per_s(const SurfacePoint& point) const {
  Vec3d velocity = motion_.at(point.position_m);
  if (!velocities_m_per_s_.empty() && point.triangle != sheet::kNone) {
    const Triangle& triangle = std::get<MeshShape>(description_->shape).triangles[point.triangle];
    Vec3d own = Vec3d::Zero();
    for (int k = 0; k < 3; ++k) {
      own += point.barycentric[k] * velocities_m_per_s_[triangle[static_cast<std::size_t>(k)]].cast<double>();
    }
    velocity += rotation_ * own;
  }
  return velocity;
}

}  // namespace rustle::scene
