#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <variant>
#include <vector>

#include "server/sheet/mesh_frame.h"
#include "server/sheet/vector.h"

/// What surrounds the sheets. Metres, seconds, z up.
namespace rustle::scene {

using sheet::ObstacleId;
using sheet::Vec3d;
using sheet::Vec3f;

struct Pose {
  Vec3d position_m = Vec3d::Zero();
  Eigen::Quaterniond orientation = Eigen::Quaterniond::Identity();
};

/// Solid below z = 0 of its own frame.
struct PlaneShape {};
/// Centred, edges along the axes of its own frame.
struct BoxShape {
  Vec3d half_extents_m;
};
struct SphereShape {
  double radius_m;
};
/// Along z from -half_length to +half_length, caps beyond.
struct CapsuleShape {
  double radius_m;
  double half_length_m;
};
struct MeshShape {
  std::vector<sheet::Triangle> triangles;
  std::vector<Vec3f> vertices_m;  ///< in the obstacle's own frame
};
using Shape = std::variant<PlaneShape, BoxShape, SphereShape, CapsuleShape, MeshShape>;

struct Obstacle {
  ObstacleId id = 0;
  std::string name;
  std::string surface_material;  ///< empty: the sheet's touched surface
  bool reflecting = false;
  double reflection_coefficient = 1.0;
  Shape shape;
  Pose pose;
};

/// Changes at one time, as `wire` decodes them: sizes, indices and finiteness are checked.
struct SceneUpdate {
  double time_s = 0;
  std::vector<Obstacle> obstacles;  ///< created or replaced
  struct PoseUpdate {
    ObstacleId id;
    Pose pose;
  };
  std::vector<PoseUpdate> poses;
  struct VerticesUpdate {
    ObstacleId id;
    std::vector<Vec3f> vertices_m;
  };
  std::vector<VerticesUpdate> vertices;
  std::vector<ObstacleId> removed;
};

struct Listener {
  double time_s = 0;
  Vec3d position_m = Vec3d::Zero();
  std::optional<Vec3d> forward;  ///< unit length; absent: toward the sheets
  Vec3d up = Vec3d::UnitZ();     ///< unit length
};

/// An infinite reflecting plane at one time.
struct ReflectingPlane {
  ObstacleId id;
  Vec3d point_m;
  Vec3d normal;  ///< unit length
  double reflection_coefficient;
};

}  // namespace rustle::scene
