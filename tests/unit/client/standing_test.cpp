#include <set>

#include <catch2/catch.hpp>

#include "client_sdk/cpp/standing.h"

namespace standing_test {

using rustle::client::internal::Standing;
namespace v1 = rustle::v1;

namespace {

v1::StreamMessage topology(std::uint64_t id) {
  v1::StreamMessage message;
  message.mutable_topology()->set_topology_id(id);
  return message;
}

v1::StreamMessage frame(std::uint32_t sheet, std::uint64_t topology_id, double time_s) {
  v1::StreamMessage message;
  message.mutable_frame()->set_sheet_id(sheet);
  message.mutable_frame()->set_topology_id(topology_id);
  message.mutable_frame()->set_time_s(time_s);
  return message;
}

}  // namespace

TEST_CASE("obstacles stand as they are now", "[client][standing]") {
  Standing standing;
  for (std::uint32_t k = 0; k < 4; ++k) {
    v1::StreamMessage message;
    v1::Obstacle* obstacle = message.mutable_scene()->add_obstacles();
    obstacle->set_obstacle_id(k);
    if (k == 3) {
      obstacle->mutable_sphere()->set_radius(2);
    } else {
      obstacle->mutable_mesh()->set_vertices("old");
    }
    standing.take(message);
  }
  v1::StreamMessage message;
  v1::SceneUpdate* update = message.mutable_scene();
  update->set_time_s(5);
  auto* moved = update->add_poses();
  moved->set_obstacle_id(1);
  moved->mutable_pose()->mutable_position()->set_y(2);
  for (const std::uint32_t id : {2u, 3u, 9u}) {
    auto* deformed = update->add_vertices();
    deformed->set_obstacle_id(id);
    deformed->set_vertices("new");
  }
  update->add_removed_obstacle_ids(0);
  standing.take(message);

  const auto told = standing.messages();
  REQUIRE(told.size() == 1);
  const v1::SceneUpdate& scene = told[0].scene();
  CHECK(scene.time_s() == 5);
  REQUIRE(scene.obstacles_size() == 3);
  CHECK(scene.obstacles(0).obstacle_id() == 1);
  CHECK(scene.obstacles(0).pose().position().y() == 2);
  CHECK(scene.obstacles(0).mesh().vertices() == "old");
  CHECK(scene.obstacles(1).mesh().vertices() == "new");
  CHECK(scene.obstacles(2).sphere().radius() == 2);  // not a mesh: it stays what it is
}

TEST_CASE("topologies stand while they may still be used", "[client][standing]") {
  Standing standing;
  for (std::uint64_t k = 1; k <= 200; ++k) {
    standing.take(topology(k));
    if (k <= 150) standing.take(frame(7, k, static_cast<double>(k)));
  }
  std::set<std::uint64_t> kept;
  for (const auto& message : standing.messages()) kept.insert(message.topology().topology_id());
  CHECK(kept.size() == 200 - 150 + 1 + 64);
  CHECK(*kept.begin() == 150 - 64);
  CHECK(standing.newest_time_s() == 150);

  for (std::uint64_t k = 1000; k < 3000; ++k) standing.take(topology(k));
  CHECK(standing.messages().size() == 1024 + 1 + 64);
}

TEST_CASE("sheets come first, then topologies, the scene and the listener", "[client][standing]") {
  Standing standing;
  v1::StreamMessage listener, scene, sheet, end;
  listener.mutable_listener()->set_time_s(3);
  scene.mutable_scene()->add_obstacles()->set_obstacle_id(1);
  sheet.mutable_sheet()->set_sheet_id(4);
  end.mutable_end();
  for (const auto& message : {listener, scene, topology(1), sheet, frame(4, 1, 2)}) standing.take(message);
  std::vector<v1::StreamMessage::BodyCase> order;
  for (const auto& message : standing.messages()) order.push_back(message.body_case());
  CHECK(order == std::vector<v1::StreamMessage::BodyCase>{v1::StreamMessage::kSheet, v1::StreamMessage::kTopology,
                                                          v1::StreamMessage::kScene, v1::StreamMessage::kListener});
  CHECK(standing.newest_time_s() == 3);
  CHECK_FALSE(standing.ended());
  standing.take(end);
  CHECK(standing.ended());
}

}  // namespace standing_test
