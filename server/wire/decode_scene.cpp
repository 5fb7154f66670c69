#include <algorithm>
#include <cmath>
#include <numbers>

#include <fmt/format.h>

#include "rustle/v1/session.pb.h"
#include "server/wire/decode.h"
#include "server/wire/fields.h"

namespace rustle::wire {
namespace {

using sheet::Vec3d;
using sheet::Vec3f;

/// The sender's axes in ours: (x, y, z) -> (x, -z, y) is a quarter turn about x.
Eigen::Quaterniond axes_turn(bool y_up) {
  if (!y_up) return Eigen::Quaterniond::Identity();
  const double half = std::numbers::sqrt2 / 2;
  return {half, half, 0, 0};
}

/// The shortest turn from +z to `normal`; half a turn about x for -z.
Eigen::Quaterniond turn_z_to(const Vec3d& normal) {
  if (normal.z() < -1 + 1e-12) return {0, 1, 0, 0};
  return Eigen::Quaterniond(1 + normal.z(), -normal.y(), normal.x(), 0).normalized();
}

}  // namespace

tl::expected<scene::Pose, Error> Decoder::decode_pose(const v1::Pose* sent, const std::string& field,
                                                      const scene::Pose& shape_in_frame) const {
  scene::Pose pose;
  if (sent != nullptr) {
    const auto position =
        read_vector(sent->position(), metres_per_unit_, y_up_, limits_.position_m, field + ".position", "m");
    if (!position) return tl::unexpected(position.error());
    pose.position_m = *position;
    const v1::Quaternion& q = sent->orientation();
    for (const double component : {q.w(), q.x(), q.y(), q.z()})
      if (const auto good = check_range(component, -1e3, 1e3, field + ".orientation", ""); !good)
        return tl::unexpected(good.error());
    const Eigen::Quaterniond turn(q.w(), q.x(), q.y(), q.z());
    const double norm = turn.norm();
    if (norm > 0) {
      if (norm < 1e-3)
        return refuse(ErrorCode::kOutOfRange, field + ".orientation",
                      fmt::format("The quaternion of {} has the length {}.", field, norm),
                      "Send unit quaternions, or leave the orientation out.");
      pose.orientation = turn.normalized();
    }
  }
  pose.orientation = (axes_turn(y_up_) * pose.orientation).normalized();
  pose.position_m += pose.orientation * shape_in_frame.position_m;
  pose.orientation = (pose.orientation * shape_in_frame.orientation).normalized();
  return pose;
}

tl::expected<Decoder::NewObstacle, Error> Decoder::decode_obstacle(const v1::Obstacle& sent,
                                                                   const std::string& field) const {
  NewObstacle out;
  scene::Obstacle& obstacle = out.obstacle;
  obstacle.id = sent.obstacle_id();
  if (const auto good = check_text(sent.name(), field + ".name", limits_); !good) return tl::unexpected(good.error());
  if (const auto good = check_text(sent.surface_material(), field + ".surface_material", limits_); !good)
    return tl::unexpected(good.error());
  obstacle.name = sent.name();
  obstacle.surface_material = sent.surface_material();
  obstacle.reflecting = sent.reflecting();
  if (sent.has_reflection_coefficient()) {
    if (const auto good = check_range(sent.reflection_coefficient(), 0, 1, field + ".reflection_coefficient", ""); !good)
      return tl::unexpected(good.error());
    obstacle.reflection_coefficient = sent.reflection_coefficient();
  }

  const auto length = [&](double units, double low_m, const std::string& name) {
    return check_range(units * metres_per_unit_, low_m, limits_.position_m, field + name, "m").map([&] {
      return units * metres_per_unit_;
    });
  };
  constexpr double kLeast_m = 1e-6;
  switch (sent.shape_case()) {
    case v1::Obstacle::kPlane: {
      const auto point =
          read_vector(sent.plane().point(), metres_per_unit_, false, limits_.position_m, field + ".plane.point", "m");
      if (!point) return tl::unexpected(point.error());
      const auto normal = read_direction(sent.plane().normal(), false, field + ".plane.normal");
      if (!normal) return tl::unexpected(normal.error());
      if (sent.plane().has_normal() && normal->isZero(0))
        return refuse(ErrorCode::kOutOfRange, field + ".plane.normal", "The plane's normal has no length.",
                      "Send a direction, or leave the normal out for +z.");
      out.known.shape_in_frame.position_m = *point;
      if (sent.plane().has_normal()) out.known.shape_in_frame.orientation = turn_z_to(*normal);
      obstacle.shape = scene::PlaneShape{};
      break;
    }
    case v1::Obstacle::kBox: {
      const auto& half = sent.box().half_extents();
      const auto x = length(half.x(), kLeast_m, ".box.half_extents.x");
      const auto y = length(half.y(), kLeast_m, ".box.half_extents.y");
      const auto z = length(half.z(), kLeast_m, ".box.half_extents.z");
      for (const auto* extent : {&x, &y, &z})
        if (!*extent) return tl::unexpected(extent->error());
      obstacle.shape = scene::BoxShape{Vec3d(*x, *y, *z)};
      break;
    }
    case v1::Obstacle::kSphere: {
      const auto radius = length(sent.sphere().radius(), kLeast_m, ".sphere.radius");
      if (!radius) return tl::unexpected(radius.error());
      obstacle.shape = scene::SphereShape{*radius};
      break;
    }
    case v1::Obstacle::kCapsule: {
      const auto radius = length(sent.capsule().radius(), kLeast_m, ".capsule.radius");
      if (!radius) return tl::unexpected(radius.error());
      const auto half_length = length(sent.capsule().half_length(), 0, ".capsule.half_length");
      if (!half_length) return tl::unexpected(half_length.error());
      obstacle.shape = scene::CapsuleShape{*radius, *half_length};
      break;
    }
    case v1::Obstacle::kMesh: {
      const std::string vertices_field = field + ".mesh.vertices";
      const auto count = count_rows(sent.mesh().vertices(), sizeof(Vec3f), limits_.vertices, vertices_field);
      if (!count) return tl::unexpected(count.error());
      auto triangles = read_triangles(sent.mesh().triangles(), *count, limits_.triangles, field + ".mesh.triangles");
      if (!triangles) return tl::unexpected(std::move(triangles.error()));
      if (triangles->empty())
        return refuse(ErrorCode::kMalformed, field + ".mesh.triangles", "The mesh has no triangle.", "Send at least one.");
      auto vertices =
          read_points(sent.mesh().vertices(), metres_per_unit_, false,
                      {.field = vertices_field, .item = "Vertex", .limit = limits_.position_m, .limit_unit = "m"});
      if (!vertices) return tl::unexpected(std::move(vertices.error()));
      out.known.vertex_count = *count;
      out.known.triangle_count = triangles->size();
      obstacle.shape = scene::MeshShape{std::move(*triangles), std::move(*vertices)};
      break;
    }
    case v1::Obstacle::SHAPE_NOT_SET:
      return refuse(ErrorCode::kMalformed, field + ".shape", fmt::format("Obstacle {} has no shape.", sent.obstacle_id()),
                    "Give it a plane, box, sphere, capsule or mesh.");
  }
  auto pose = decode_pose(sent.has_pose() ? &sent.pose() : nullptr, field + ".pose", out.known.shape_in_frame);
  if (!pose) return tl::unexpected(std::move(pose.error()));
  obstacle.pose = *pose;
  return out;
}

Decoder::Item Decoder::decode_scene(const v1::SceneUpdate& sent) {
  if (const auto good = check_time(sent.time_s(), "scene.time_s", limits_); !good) return tl::unexpected(good.error());
  if (newest_scene_s_ && sent.time_s() < *newest_scene_s_)
    return refuse(ErrorCode::kTimeOrder, "scene.time_s",
                  fmt::format("scene.time_s is {} s, after {} s was taken; scene times do not decrease.", sent.time_s(),
                              *newest_scene_s_),
                  "Stamp every update with the current simulation time.");
  for (const int count : {sent.obstacles_size(), sent.poses_size(), sent.vertices_size(), sent.removed_obstacle_ids_size()})
    if (static_cast<std::size_t>(count) > limits_.obstacles)
      return refuse(ErrorCode::kTooLarge, "scene",
                    fmt::format("The update names {} obstacles; at most {} are taken.", count, limits_.obstacles),
                    "Merge obstacles that move together into one mesh.");

  scene::SceneUpdate update;
  update.time_s = sent.time_s();
  std::map<sheet::ObstacleId, KnownObstacle> created;
  for (const v1::Obstacle& obstacle : sent.obstacles()) {
    auto read = decode_obstacle(obstacle, fmt::format("scene.obstacles[{}]", update.obstacles.size()));
    if (!read) return tl::unexpected(std::move(read.error()));
    created[read->obstacle.id] = read->known;
    update.obstacles.push_back(std::move(read->obstacle));
  }
  const auto find = [&](sheet::ObstacleId id) -> const KnownObstacle* {
    if (const auto entry = created.find(id); entry != created.end()) return &entry->second;
    if (const auto entry = obstacles_.find(id); entry != obstacles_.end()) return &entry->second;
    return nullptr;
  };
  const auto unknown = [](sheet::ObstacleId id, std::string_view field) {
    return refuse(ErrorCode::kUnknownObstacle, field, fmt::format("Obstacle {} is not in the scene.", id),
                  "Send it in SceneUpdate.obstacles first.");
  };

  for (const v1::ObstaclePose& pose : sent.poses()) {
    const std::string field = fmt::format("scene.poses[{}]", update.poses.size());
    const KnownObstacle* known = find(pose.obstacle_id());
    if (known == nullptr) return unknown(pose.obstacle_id(), field + ".obstacle_id");
    auto read = decode_pose(pose.has_pose() ? &pose.pose() : nullptr, field + ".pose", known->shape_in_frame);
    if (!read) return tl::unexpected(std::move(read.error()));
    update.poses.push_back({.id = pose.obstacle_id(), .pose = *read});
  }
  for (const v1::ObstacleVertices& vertices : sent.vertices()) {
    const std::string field = fmt::format("scene.vertices[{}].vertices", update.vertices.size());
    const KnownObstacle* known = find(vertices.obstacle_id());
    if (known == nullptr) return unknown(vertices.obstacle_id(), field);
    if (known->vertex_count == 0)
      return refuse(ErrorCode::kMalformed, field, fmt::format("Obstacle {} is no mesh.", vertices.obstacle_id()),
                    "Move it by its pose, or send it as a mesh.");
    if (const auto good = check_size(vertices.vertices(), known->vertex_count, sizeof(Vec3f), field, "vertices"); !good)
      return tl::unexpected(good.error());
    auto read = read_points(vertices.vertices(), metres_per_unit_, false,
                            {.field = field, .item = "Vertex", .limit = limits_.position_m, .limit_unit = "m"});
    if (!read) return tl::unexpected(std::move(read.error()));
    update.vertices.push_back({.id = vertices.obstacle_id(), .vertices_m = std::move(*read)});
  }
  for (const std::uint32_t id : sent.removed_obstacle_ids()) {
    if (find(id) == nullptr) return unknown(id, "scene.removed_obstacle_ids");
    update.removed.push_back(id);
  }

  std::size_t triangles = 0, count = created.size();
  for (const auto& [id, known] : created) triangles += known.triangle_count;
  for (const auto& [id, known] : obstacles_)
    if (!created.contains(id)) {
      ++count;
      triangles += known.triangle_count;
    }
  if (count > limits_.obstacles)
    return refuse(ErrorCode::kTooLarge, "scene.obstacles",
                  fmt::format("The scene would hold {} obstacles; at most {} are taken.", count, limits_.obstacles),
                  "Remove obstacles that are no longer near, or merge them into one mesh.");
  if (triangles > limits_.obstacle_triangles)
    return refuse(ErrorCode::kTooLarge, "scene.obstacles",
                  fmt::format("The obstacles would have {} triangles together; at most {} are taken.", triangles,
                              limits_.obstacle_triangles),
                  "Send coarser obstacles.");

  for (const auto& [id, known] : created) obstacles_[id] = known;
  for (const sheet::ObstacleId id : update.removed) obstacles_.erase(id);
  newest_scene_s_ = sent.time_s();
  return engine::StreamItem(std::move(update));
}

}  // namespace rustle::wire
