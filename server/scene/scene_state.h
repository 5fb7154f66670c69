#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include <tl/expected.hpp>

#include "server/scene/scene.h"

/// The scene as it was at any recent time, from updates that arrive in time order.
namespace rustle::scene {

/// A point of an obstacle's surface, in world coordinates, as closest to some query.
struct SurfacePoint {
  Vec3d position_m = Vec3d::Zero();
  Vec3d normal = Vec3d::UnitZ();          ///< outward, unit length
  double distance_m = 0;                  ///< of the query; negative inside
  std::uint32_t triangle = sheet::kNone;  ///< of a mesh
  Vec3d barycentric = Vec3d::Zero();      ///< in that triangle
};

/// Velocity of every point of a rigid body: v(p) = linear + angular_map (p - centre), m/s.
struct RigidMotion {
  Vec3d centre_m = Vec3d::Zero();
  Vec3d linear_m_per_s = Vec3d::Zero();
  Eigen::Matrix3d angular_map_per_s = Eigen::Matrix3d::Zero();

  Vec3d at(const Vec3d& point_m) const { return linear_m_per_s + angular_map_per_s * (point_m - centre_m); }
};

/// One obstacle's description with its recent poses and vertices. Between two of them it moves linearly (orientation by
/// slerp); before the first and after the last it rests. Poses of at least the last 0.25 s are kept.
class ObstacleTrack {
 public:
  ObstacleTrack(Obstacle obstacle, double time_s, std::uint64_t revision);

  const Obstacle& description() const { return *description_; }
  std::shared_ptr<const Obstacle> shared_description() const { return description_; }
  const MeshShape* mesh() const { return std::get_if<MeshShape>(&description_->shape); }
  std::uint64_t revision() const { return revision_; }  ///< unique in its SceneState to this shape
  bool deforms() const { return vertices_.size() > 1; }

  Pose pose(double time_s) const;

  /// In the obstacle's own frame; empty unless it is a mesh.
  void vertices_m(double time_s, std::vector<Vec3f>& out) const;

  /// How the obstacle's frame moves at `time_s`. With over_s > 0 the mean over [time_s - over_s, time_s]: the chord of each
  /// point's path, which is what differenced sheet positions are to be compared with. With over_s = 0 the velocity v + ω×r
  /// of the segment that ends at or holds `time_s`; zero after the last pose.
  RigidMotion motion(double time_s, double over_s) const;

  /// Velocity in the obstacle's own frame of each vertex, [V] or empty when it does not deform; same meaning of over_s.
  void vertex_velocities_m_per_s(double time_s, double over_s, std::vector<Vec3f>& out) const;

 private:
  friend class SceneState;

  struct PoseKey {
    double time_s;
    Pose pose;
  };
  struct VerticesKey {
    double time_s;
    std::shared_ptr<const std::vector<Vec3f>> vertices_m;
  };

  void add(double time_s, const Pose& pose);
  void add(double time_s, std::vector<Vec3f> vertices_m);
  void start_again();

  std::shared_ptr<const Obstacle> description_;
  std::uint64_t revision_;
  std::vector<PoseKey> poses_;         ///< ascending, never empty
  std::vector<VerticesKey> vertices_;  ///< ascending, empty unless a mesh
};

/// All obstacles and the listener. Cheap to copy: meshes are shared. Const methods may run on several threads at once.
class SceneState {
 public:
  /// Applies an update whole or, on error, not at all. Removals come first, then obstacles, poses, vertices. An obstacle
  /// sent again with the same shape goes on moving; with another shape it starts anew, at rest.
  /// Error: a sentence that names the field and the remedy: time before the last update's, an unknown obstacle, vertices of
  /// an obstacle that is no mesh or has another number of them.
  [[nodiscard]] tl::expected<void, std::string> apply(SceneUpdate update);

  /// Error: time before the last listener's.
  [[nodiscard]] tl::expected<void, std::string> apply(const Listener& listener);

  /// Time begins anew: what is there stays where it is newest, at rest, and the next update may have any time.
  void start_again();

  /// Forgets everything, as at a session's start.
  void clear();

  const std::map<ObstacleId, ObstacleTrack>& obstacles() const { return obstacles_; }
  const ObstacleTrack* find(ObstacleId id) const;  ///< null: unknown

  /// Empty: the obstacle names none, or is unknown.
  std::string_view surface_material(ObstacleId id) const;

  std::vector<ReflectingPlane> reflecting_planes(double time_s) const;  ///< in ascending id

  /// Linear between the known times, resting before and after; none until one has been sent.
  std::optional<Listener> listener(double time_s) const;

 private:
  std::map<ObstacleId, ObstacleTrack> obstacles_;
  std::vector<Listener> listeners_;  ///< ascending
  std::optional<double> time_s_;     ///< of the newest update
  std::uint64_t next_revision_ = 1;
};

}  // namespace rustle::scene
