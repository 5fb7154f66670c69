#include "client_sdk/cpp/standing.h"

#include <algorithm>

namespace rustle::client::internal {

void Standing::take(const v1::StreamMessage& message) {
  switch (message.body_case()) {
    case v1::StreamMessage::kSheet:
      sheets_[message.sheet().sheet_id()] = message.sheet();
      break;
    case v1::StreamMessage::kTopology:
      topologies_.try_emplace(message.topology().topology_id(),
                              KnownTopology{.topology = message.topology(), .last_use = ++uses_, .used = false});
      forget_topologies();
      break;
    case v1::StreamMessage::kFrame:
      take_time(message.frame().time_s());
      use(message.frame().sheet_id(), message.frame().topology_id());
      break;
    case v1::StreamMessage::kScene:
      take_time(message.scene().time_s());
      change(message.scene());
      break;
    case v1::StreamMessage::kListener:
      take_time(message.listener().time_s());
      listener_ = message.listener();
      break;
    case v1::StreamMessage::kTearTips:
      take_time(message.tear_tips().time_s());
      break;
    case v1::StreamMessage::kAdvance:
      take_time(message.advance().time_s());
      break;
    case v1::StreamMessage::kEnd:
      ended_ = true;
      break;
    default:
      break;
  }
}

std::vector<v1::StreamMessage> Standing::messages() const {
  std::vector<v1::StreamMessage> told;
  for (const auto& [id, sheet] : sheets_) *told.emplace_back().mutable_sheet() = sheet;
  std::vector<const KnownTopology*> by_use;
  for (const auto& [id, known] : topologies_) by_use.push_back(&known);
  std::ranges::sort(by_use, {}, &KnownTopology::last_use);
  for (const KnownTopology* known : by_use) *told.emplace_back().mutable_topology() = known->topology;
  if (!obstacles_.empty()) {
    v1::SceneUpdate* scene = told.emplace_back().mutable_scene();
    scene->set_time_s(scene_time_s_);
    for (const auto& [id, obstacle] : obstacles_) *scene->add_obstacles() = obstacle;
  }
  if (listener_) *told.emplace_back().mutable_listener() = *listener_;
  return told;
}

void Standing::take_time(double time_s) {
  newest_time_s_ = std::max(newest_time_s_.value_or(time_s), time_s);
}

void Standing::use(std::uint32_t sheet_id, std::uint64_t topology_id) {
  current_[sheet_id] = topology_id;
  const auto known = topologies_.find(topology_id);
  if (known == topologies_.end()) return;
  known->second.last_use = ++uses_;
  if (known->second.used) return;
  known->second.used = true;
  forget_topologies();
}

bool Standing::is_current(std::uint64_t topology_id) const {
  return std::ranges::any_of(current_, [topology_id](const auto& of_sheet) { return of_sheet.second == topology_id; });
}

void Standing::forget_topologies() {
  std::size_t replaced = 0, waiting = 0;
  auto oldest_replaced = topologies_.end(), oldest_waiting = topologies_.end();
  for (auto entry = topologies_.begin(); entry != topologies_.end(); ++entry) {
    const KnownTopology& known = entry->second;
    if (known.used && is_current(entry->first)) continue;
    ++(known.used ? replaced : waiting);
    auto& oldest = known.used ? oldest_replaced : oldest_waiting;
    if (oldest == topologies_.end() || known.last_use < oldest->second.last_use) oldest = entry;
  }
  // One message makes one too many at most.
  if (replaced > kReplacedTopologies) topologies_.erase(oldest_replaced);
  if (waiting > kWaitingTopologies) topologies_.erase(oldest_waiting);
}

void Standing::change(const v1::SceneUpdate& update) {
  scene_time_s_ = update.time_s();
  for (const v1::Obstacle& obstacle : update.obstacles()) obstacles_[obstacle.obstacle_id()] = obstacle;
  for (const auto& moved : update.poses()) {
    const auto known = obstacles_.find(moved.obstacle_id());
    if (known != obstacles_.end()) *known->second.mutable_pose() = moved.pose();
  }
  for (const auto& deformed : update.vertices()) {
    const auto known = obstacles_.find(deformed.obstacle_id());
    if (known != obstacles_.end() && known->second.has_mesh())
      known->second.mutable_mesh()->set_vertices(deformed.vertices());
  }
  for (const std::uint32_t removed : update.removed_obstacle_ids()) obstacles_.erase(removed);
}

}  // namespace rustle::client::internal
