#include "server/scene/scene_state.h"

#include <algorithm>
#include <cassert>
#include <set>
#include <utility>

#include <fmt/format.h>

namespace rustle::scene {
namespace {

constexpr double kHistory_s = 0.25;
constexpr double kBeforeAll_s = -1e12;  // earlier than any time that a stream may name

/// Two neighbouring keys and the share of the way from the first to the second.
struct Between {
  std::size_t first, second;
  double share;
};

template <class Key>
Between locate(const std::vector<Key>& keys, double time_s) {
  const auto after =
      std::lower_bound(keys.begin(), keys.end(), time_s, [](const Key& key, double time) { return key.time_s < time; });
  if (after == keys.begin()) return {0, 0, 0.0};
  if (after == keys.end()) return {keys.size() - 1, keys.size() - 1, 0.0};
  const std::size_t second = static_cast<std::size_t>(after - keys.begin());
  const double start_s = keys[second - 1].time_s;
  return {second - 1, second, (time_s - start_s) / (keys[second].time_s - start_s)};
}

template <class Key>
void append(std::vector<Key>& keys, Key key) {
  if (!keys.empty() && keys.back().time_s == key.time_s) keys.pop_back();
  keys.push_back(std::move(key));
  const double oldest_s = keys.back().time_s - kHistory_s;
  std::size_t unused = 0;
  while (unused + 2 < keys.size() && keys[unused + 1].time_s <= oldest_s) ++unused;
  keys.erase(keys.begin(), keys.begin() + static_cast<std::ptrdiff_t>(unused));
}

bool same_shape(const Shape& a, const Shape& b) {
  if (a.index() != b.index()) return false;
  if (const auto* box = std::get_if<BoxShape>(&a)) return box->half_extents_m == std::get<BoxShape>(b).half_extents_m;
  if (const auto* sphere = std::get_if<SphereShape>(&a)) return sphere->radius_m == std::get<SphereShape>(b).radius_m;
  if (const auto* capsule = std::get_if<CapsuleShape>(&a)) {
    const auto& other = std::get<CapsuleShape>(b);
    return capsule->radius_m == other.radius_m && capsule->half_length_m == other.half_length_m;
  }
  if (const auto* mesh = std::get_if<MeshShape>(&a)) {
    const auto& other = std::get<MeshShape>(b);
    return mesh->triangles == other.triangles && mesh->vertices_m.size() == other.vertices_m.size();
  }
  return true;
}

Eigen::Matrix3d cross_matrix(const Vec3d& w) {
  Eigen::Matrix3d m;
  m << 0, -w.z(), w.y(), w.z(), 0, -w.x(), -w.y(), w.x(), 0;
  return m;
}

}  // namespace

ObstacleTrack::ObstacleTrack(Obstacle obstacle, double time_s, std::uint64_t revision) : revision_(revision) {
  poses_.push_back({time_s, obstacle.pose});
  if (const auto* shape = std::get_if<MeshShape>(&obstacle.shape)) {
    vertices_.push_back({time_s, std::make_shared<const std::vector<Vec3f>>(shape->vertices_m)});
  }
  description_ = std::make_shared<const Obstacle>(std::move(obstacle));
}

void ObstacleTrack::add(double time_s, const Pose& pose) {
  append(poses_, PoseKey{time_s, pose});
}

void ObstacleTrack::add(double time_s, std::vector<Vec3f> vertices_m) {
  append(vertices_, VerticesKey{time_s, std::make_shared<const std::vector<Vec3f>>(std::move(vertices_m))});
}

void ObstacleTrack::start_again() {
  poses_.erase(poses_.begin(), poses_.end() - 1);
  poses_.back().time_s = kBeforeAll_s;
  if (vertices_.empty()) return;
  vertices_.erase(vertices_.begin(), vertices_.end() - 1);
  vertices_.back().time_s = kBeforeAll_s;
}

Pose ObstacleTrack::pose(double time_s) const {
  const Between at = locate(poses_, time_s);
  const Pose& a = poses_[at.first].pose;
  const Pose& b = poses_[at.second].pose;
  if (at.first == at.second) return a;
  if (at.share == 1.0) return b;
  return {a.position_m + at.share * (b.position_m - a.position_m), a.orientation.slerp(at.share, b.orientation)};
}

void ObstacleTrack::vertices_m(double time_s, std::vector<Vec3f>& out) const {
  out.clear();
  if (vertices_.empty()) return;
  const Between at = locate(vertices_, time_s);
  const std::vector<Vec3f>& a = *vertices_[at.first].vertices_m;
  const std::vector<Vec3f>& b = *vertices_[at.second].vertices_m;
  if (at.first == at.second || at.share == 1.0) {
    out = b;
    return;
  }
  const float share = static_cast<float>(at.share);
  out.resize(a.size());
  for (std::size_t i = 0; i < a.size(); ++i) out[i] = a[i] + share * (b[i] - a[i]);
}

RigidMotion ObstacleTrack::motion(double time_s, double over_s) const {
  RigidMotion motion;
  if (poses_.size() < 2) return motion;
  if (over_s > 0) {
    const Pose now = pose(time_s);
    const Pose before = pose(time_s - over_s);
    motion.centre_m = now.position_m;
    motion.linear_m_per_s = (now.position_m - before.position_m) / over_s;
    const Eigen::Quaterniond back = before.orientation * now.orientation.conjugate();
    if (back.vec().squaredNorm() > 0) {
      motion.angular_map_per_s = (Eigen::Matrix3d::Identity() - back.toRotationMatrix()) / over_s;
    }
    return motion;
  }
  const Between at = locate(poses_, time_s);
  if (at.first == at.second) return motion;
  const PoseKey& a = poses_[at.first];
  const PoseKey& b = poses_[at.second];
  const double duration_s = b.time_s - a.time_s;
  const Eigen::AngleAxisd turn(b.pose.orientation * a.pose.orientation.conjugate());
  const double angle_rad = turn.angle() > M_PI ? turn.angle() - 2 * M_PI : turn.angle();
  motion.centre_m = pose(time_s).position_m;
  motion.linear_m_per_s = (b.pose.position_m - a.pose.position_m) / duration_s;
  motion.angular_map_per_s = cross_matrix(turn.axis() * (angle_rad / duration_s));
  return motion;
}

void ObstacleTrack::vertex_velocities_m_per_s(double time_s, double over_s, std::vector<Vec3f>& out) const {
  out.clear();
  if (!deforms()) return;
  if (over_s > 0) {
    vertices_m(time_s, out);
    const Between at = locate(vertices_, time_s - over_s);
    const std::vector<Vec3f>& a = *vertices_[at.first].vertices_m;
    const std::vector<Vec3f>& b = *vertices_[at.second].vertices_m;
    const float share = at.first == at.second ? 1.0f : static_cast<float>(at.share);
    const float rate = static_cast<float>(1.0 / over_s);
    for (std::size_t i = 0; i < out.size(); ++i) {
      const Vec3f before = share == 1.0f ? b[i] : Vec3f(a[i] + share * (b[i] - a[i]));
      out[i] = (out[i] - before) * rate;
    }
    return;
  }
  const Between at = locate(vertices_, time_s);
  const std::vector<Vec3f>& a = *vertices_[at.first].vertices_m;
  const std::vector<Vec3f>& b = *vertices_[at.second].vertices_m;
  const double span_s = at.first == at.second ? 1.0 : vertices_[at.second].time_s - vertices_[at.first].time_s;
  const float rate = static_cast<float>(1.0 / span_s);
  out.resize(b.size());
  for (std::size_t i = 0; i < out.size(); ++i) out[i] = (b[i] - a[i]) * rate;
}

tl::expected<void, std::string> SceneState::apply(SceneUpdate update) {
  if (time_s_ && update.time_s < *time_s_) {
    return tl::unexpected(fmt::format(
        "scene update: time_s {} lies before {}, the last update's; send updates in time order", update.time_s, *time_s_));
  }
  std::set<ObstacleId> removed;
  for (const ObstacleId id : update.removed) {
    if (!obstacles_.contains(id)) {
      return tl::unexpected(fmt::format(
          "scene update: removed_obstacle_ids names obstacle {}, which does not exist; remove only what was created", id));
    }
    removed.insert(id);
  }
  std::map<ObstacleId, const Obstacle*> created;
  for (const Obstacle& obstacle : update.obstacles) created[obstacle.id] = &obstacle;
  const auto shape_of = [&](ObstacleId id) -> const Shape* {
    if (const auto found = created.find(id); found != created.end()) return &found->second->shape;
    const ObstacleTrack* track = removed.contains(id) ? nullptr : find(id);
    return track ? &track->description().shape : nullptr;
  };
  for (const auto& change : update.poses) {
    if (!shape_of(change.id)) {
      return tl::unexpected(
          fmt::format("scene update: poses names obstacle {}, which does not exist; send the obstacle first", change.id));
    }
  }
  for (const auto& change : update.vertices) {
    const Shape* shape = shape_of(change.id);
    if (!shape) {
      return tl::unexpected(
          fmt::format("scene update: vertices names obstacle {}, which does not exist; send the obstacle first", change.id));
    }
    const auto* mesh = std::get_if<MeshShape>(shape);
    if (!mesh) {
      return tl::unexpected(fmt::format(
          "scene update: vertices names obstacle {}, which is not a mesh; move it by its pose or send a mesh", change.id));
    }
    if (mesh->vertices_m.size() != change.vertices_m.size()) {
      return tl::unexpected(
          fmt::format("scene update: vertices has {} vertices for obstacle {}, whose mesh has {}; send as many, or the "
                      "obstacle anew",
                      change.vertices_m.size(), change.id, mesh->vertices_m.size()));
    }
  }

  time_s_ = update.time_s;
  for (const ObstacleId id : removed) obstacles_.erase(id);
  for (Obstacle& obstacle : update.obstacles) {
    const ObstacleId id = obstacle.id;
    const auto known = obstacles_.find(id);
    if (known == obstacles_.end() || !same_shape(known->second.description().shape, obstacle.shape)) {
      obstacles_.insert_or_assign(id, ObstacleTrack(std::move(obstacle), update.time_s, next_revision_++));
      continue;
    }
    ObstacleTrack& track = known->second;
    track.add(update.time_s, obstacle.pose);
    const auto* mesh = std::get_if<MeshShape>(&obstacle.shape);
    if (mesh && mesh->vertices_m != *track.vertices_.back().vertices_m) track.add(update.time_s, mesh->vertices_m);
    track.description_ = std::make_shared<const Obstacle>(std::move(obstacle));
  }
  for (const auto& change : update.poses) obstacles_.at(change.id).add(update.time_s, change.pose);
  for (auto& change : update.vertices) obstacles_.at(change.id).add(update.time_s, std::move(change.vertices_m));
  return {};
}

tl::expected<void, std::string> SceneState::apply(const Listener& listener) {
  if (!listeners_.empty() && listener.time_s < listeners_.back().time_s) {
    return tl::unexpected(
        fmt::format("listener: time_s {} lies before {}, the last listener's; send listeners in time order", listener.time_s,
                    listeners_.back().time_s));
  }
  append(listeners_, listener);
  return {};
}

void SceneState::start_again() {
  time_s_.reset();
  listeners_.erase(listeners_.begin(), listeners_.empty() ? listeners_.end() : listeners_.end() - 1);
  for (auto& listener : listeners_) listener.time_s = kBeforeAll_s;
  for (auto& [id, track] : obstacles_) track.start_again();
}

void SceneState::clear() {
  const std::uint64_t revision = next_revision_;
  *this = SceneState();
  next_revision_ = revision;
}

const ObstacleTrack* SceneState::find(ObstacleId id) const {
  const auto found = obstacles_.find(id);
  return found == obstacles_.end() ? nullptr : &found->second;
}

std::string_view SceneState::surface_material(ObstacleId id) const {
  const ObstacleTrack* track = find(id);
  return track ? std::string_view(track->description().surface_material) : std::string_view();
}

std::vector<ReflectingPlane> SceneState::reflecting_planes(double time_s) const {
  std::vector<ReflectingPlane> planes;
  for (const auto& [id, track] : obstacles_) {
    const Obstacle& obstacle = track.description();
    if (!obstacle.reflecting || !std::holds_alternative<PlaneShape>(obstacle.shape)) continue;
    const Pose pose = track.pose(time_s);
    planes.push_back({id, pose.position_m, pose.orientation * Vec3d::UnitZ(), obstacle.reflection_coefficient});
  }
  return planes;
}

std::optional<Listener> SceneState::listener(double time_s) const {
  if (listeners_.empty()) return std::nullopt;
  const Between at = locate(listeners_, time_s);
  const Listener& a = listeners_[at.first];
  const Listener& b = listeners_[at.second];
  Listener listener = b;
  listener.time_s = time_s;
  if (at.first == at.second) return listener;
  const auto blend = [&](const Vec3d& from, const Vec3d& to) -> Vec3d {
    const Vec3d mixed = from + at.share * (to - from);
    return mixed.norm() > 1e-6 ? Vec3d(mixed.normalized()) : to;
  };
  listener.position_m = a.position_m + at.share * (b.position_m - a.position_m);
  if (a.forward && b.forward) listener.forward = blend(*a.forward, *b.forward);
  listener.up = blend(a.up, b.up);
  return listener;
}

}  // namespace rustle::scene
