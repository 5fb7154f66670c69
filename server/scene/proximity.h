#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "server/scene/scene_state.h"
#include "server/scene/triangles.h"

/// Distance from points to obstacles.
namespace rustle::scene {

/// Closest surface point, outward normal and signed distance (negative inside the solid), all in the shape's own frame.
/// At a box's edges and corners the normal points from the surface to an outside query; inside, it is that of the nearest
/// face. Where every direction is as near (a sphere's centre) it is +z, on a capsule's axis +x. O(1).
SurfacePoint closest_point(const PlaneShape& plane, const Vec3d& query);
SurfacePoint closest_point(const BoxShape& box, const Vec3d& query);
SurfacePoint closest_point(const SphereShape& sphere, const Vec3d& query);
SurfacePoint closest_point(const CapsuleShape& capsule, const Vec3d& query);

/// One obstacle posed at one time. Keeps a tree over a mesh between frames: built when the shape is new, refitted when
/// vertices have moved. update() and the rest belong to one thread; const methods may run on several.
class ObstacleSurface {
 public:
  /// `over_s` as ObstacleTrack::motion() takes it.
  void update(const ObstacleTrack& track, double time_s, double over_s);

  bool is_mesh() const { return std::holds_alternative<MeshShape>(description_->shape); }
  bool is_plane() const { return std::holds_alternative<PlaneShape>(description_->shape); }

  /// Within the radius outside or, for solids other than meshes, at any depth inside. A mesh may be open: its distance is
  /// negative behind the closest triangle, and never more than the radius either way. World coordinates.
  std::optional<SurfacePoint> closest(const Vec3d& query_m, double radius_m) const;

  /// Whether anything can lie in a box (world coordinates), conservatively: false means surely nothing.
  bool may_meet(const Box& box_m) const;

  /// Around the obstacle in its own frame, infinite where it is.
  Box own_bounds_m() const;

  const Pose& pose() const { return pose_; }
  const Eigen::Matrix3d& rotation() const { return rotation_; }  ///< from the obstacle's own frame to the world
  const RigidMotion& motion() const { return motion_; }          ///< of that frame

  /// Of the surface there, m/s.
  Vec3d velocity_m_per_s(const SurfacePoint& point) const;

 private:
  std::shared_ptr<const Obstacle> description_;
  std::uint64_t revision_ = 0;
  Pose pose_;
  Eigen::Matrix3d rotation_ = Eigen::Matrix3d::Identity();
  bool turned_ = false;
  RigidMotion motion_;
  TriangleTree tree_;
  std::vector<Vec3f> vertices_m_;          ///< own frame
  std::vector<Vec3f> velocities_m_per_s_;  ///< own frame, or empty
};

}  // namespace rustle::scene
