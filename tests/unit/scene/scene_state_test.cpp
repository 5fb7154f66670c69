#include "server/scene/scene_state.h"

#include <cmath>

#include <catch2/catch.hpp>

namespace scene_state_test {

namespace {

using namespace rustle::scene;
using Eigen::AngleAxisd;
using Eigen::Quaterniond;

Obstacle obstacle(ObstacleId id, Shape shape, Vec3d position_m = Vec3d::Zero()) {
  Obstacle made;
  made.id = id;
  made.shape = std::move(shape);
  made.pose.position_m = position_m;
  return made;
}

SceneUpdate create(double time_s, Obstacle made) {
  SceneUpdate update;
  update.time_s = time_s;
  update.obstacles.push_back(std::move(made));
  return update;
}

SceneUpdate move(double time_s, ObstacleId id, Pose pose) {
  SceneUpdate update;
  update.time_s = time_s;
  update.poses.push_back({id, pose});
  return update;
}

MeshShape one_triangle() {
  return {{{0, 1, 2}}, {Vec3f(0, 0, 0), Vec3f(1, 0, 0), Vec3f(0, 1, 0)}};
}

}  // namespace

TEST_CASE("An obstacle moves linearly between its poses and rests outside them", "[scene]") {
  SceneState scene;
  REQUIRE(scene.apply(create(1.0, obstacle(7, SphereShape{0.1}))));
  REQUIRE(scene.apply(move(1.2, 7, {Vec3d(0.4, 0, 0), Quaterniond(AngleAxisd(0.6, Vec3d::UnitZ()))})));
  const ObstacleTrack& track = *scene.find(7);
  CHECK(track.pose(0.5).position_m == Vec3d::Zero());
  CHECK((track.pose(1.05).position_m - Vec3d(0.1, 0, 0)).norm() < 1e-12);
  CHECK(AngleAxisd(track.pose(1.1).orientation).angle() == Approx(0.3));
  CHECK(track.pose(9.0).position_m == Vec3d(0.4, 0, 0));

  const RigidMotion during = track.motion(1.1, 0);
  CHECK((during.at(track.pose(1.1).position_m) - Vec3d(2, 0, 0)).norm() < 1e-9);
  const Vec3d arm(0, 0.5, 0);
  CHECK((during.at(track.pose(1.1).position_m + arm) - (Vec3d(2, 0, 0) + Vec3d(0, 0, 3).cross(arm))).norm() < 1e-9);
  CHECK(track.motion(1.2, 0).at(Vec3d::Zero()).norm() > 0);
  CHECK(track.motion(1.3, 0).at(Vec3d(1, 1, 1)) == Vec3d::Zero());
  CHECK(track.motion(0.9, 0).at(Vec3d(1, 1, 1)) == Vec3d::Zero());
}

TEST_CASE("Mean motion over an interval is the chord of every point carried along", "[scene]") {
  SceneState scene;
  REQUIRE(scene.apply(create(0.0, obstacle(1, PlaneShape{}, Vec3d(0.2, -0.1, 0)))));
  double time_s = 0;
  for (int k = 1; k <= 6; ++k) {
    time_s = 0.01 * k;
    REQUIRE(scene.apply(
        move(time_s, 1,
             {Vec3d(0.2 + 0.03 * k * k, -0.1, 0.01 * k), Quaterniond(AngleAxisd(0.2 * k, Vec3d(1, 2, 3).normalized()))})));
  }
  const ObstacleTrack& track = *scene.find(1);
  const Vec3d own(0.3, 0.7, -0.2);
  const auto world = [&](double at_s) { return Vec3d(track.pose(at_s).orientation * own + track.pose(at_s).position_m); };
  for (const double over_s : {0.01, 0.033, 0.05}) {
    const Vec3d chord = (world(time_s) - world(time_s - over_s)) / over_s;
    CHECK((track.motion(time_s, over_s).at(world(time_s)) - chord).norm() < 1e-9);
  }
  CHECK(track.motion(1.0, 0.01).at(world(1.0)) == Vec3d::Zero());
}

TEST_CASE("Mesh vertices and their velocities are interpolated", "[scene]") {
  SceneState scene;
  REQUIRE(scene.apply(create(0.0, obstacle(3, one_triangle()))));
  CHECK_FALSE(scene.find(3)->deforms());
  SceneUpdate update;
  update.time_s = 0.5;
  update.vertices.push_back({3, {Vec3f(0, 0, 1), Vec3f(1, 0, 0), Vec3f(0, 1, 0)}});
  REQUIRE(scene.apply(update));
  std::vector<Vec3f> out;
  scene.find(3)->vertices_m(0.25, out);
  CHECK(out[0] == Vec3f(0, 0, 0.5f));
  scene.find(3)->vertex_velocities_m_per_s(0.25, 0, out);
  CHECK(out[0] == Vec3f(0, 0, 2));
  CHECK(out[1] == Vec3f(0, 0, 0));
  scene.find(3)->vertex_velocities_m_per_s(0.75, 0.5, out);
  CHECK(out[0] == Vec3f(0, 0, 1));
  scene.find(3)->vertex_velocities_m_per_s(0.75, 0, out);
  CHECK(out[0] == Vec3f(0, 0, 0));
}

TEST_CASE("An obstacle sent again goes on moving; another shape starts anew", "[scene]") {
  SceneState scene;
  REQUIRE(scene.apply(create(0.0, obstacle(1, SphereShape{0.1}))));
  const auto revision = scene.find(1)->revision();
  REQUIRE(scene.apply(create(0.1, obstacle(1, SphereShape{0.1}, Vec3d(0.1, 0, 0)))));
  CHECK(scene.find(1)->revision() == revision);
  CHECK(scene.find(1)->motion(0.1, 0).at(Vec3d::Zero()).x() == Approx(1.0));
  REQUIRE(scene.apply(create(0.2, obstacle(1, SphereShape{0.2}, Vec3d(0.2, 0, 0)))));
  CHECK(scene.find(1)->revision() != revision);
  CHECK(scene.find(1)->motion(0.2, 0).at(Vec3d::Zero()) == Vec3d::Zero());
}

TEST_CASE("A wrong update names its field and changes nothing", "[scene]") {
  SceneState scene;
  Obstacle table = obstacle(1, PlaneShape{});
  table.surface_material = "wooden-table";
  REQUIRE(scene.apply(create(1.0, table)));
  REQUIRE(scene.apply(create(1.0, obstacle(2, one_triangle()))));
  const auto expect_error = [&](SceneUpdate update, const std::string& field) {
    update.obstacles.push_back(obstacle(50, SphereShape{1}));
    const auto result = scene.apply(std::move(update));
    REQUIRE_FALSE(result);
    INFO(result.error());
    CHECK(result.error().find(field) != std::string::npos);
    CHECK(scene.obstacles().size() == 2);
    CHECK(scene.find(1)->pose(9).position_m == Vec3d::Zero());
  };
  expect_error(move(0.5, 1, {Vec3d(1, 0, 0), Quaterniond::Identity()}), "time_s");
  expect_error(move(2.0, 9, {}), "poses names obstacle 9");
  SceneUpdate update;
  update.time_s = 2;
  update.vertices = {{1, {Vec3f::Zero()}}};
  expect_error(update, "not a mesh");
  update.vertices = {{2, {Vec3f::Zero()}}};
  expect_error(update, "1 vertices for obstacle 2, whose mesh has 3");
  update.vertices = {{8, {}}};
  expect_error(update, "vertices names obstacle 8");
  update.vertices.clear();
  update.removed = {4};
  expect_error(update, "removed_obstacle_ids names obstacle 4");
  update.removed = {1};
  update.poses = {{1, {}}};
  expect_error(update, "poses names obstacle 1");
  CHECK(scene.surface_material(1) == "wooden-table");
  CHECK(scene.surface_material(99).empty());

  update.poses.clear();
  REQUIRE(scene.apply(update));
  CHECK(scene.find(1) == nullptr);
}

TEST_CASE("Only reflecting planes reflect, where they are at that time", "[scene]") {
  SceneState scene;
  Obstacle wall = obstacle(4, PlaneShape{}, Vec3d(1, 0, 0));
  wall.reflecting = true;
  wall.reflection_coefficient = 0.5;
  wall.pose.orientation = Quaterniond(AngleAxisd(-M_PI / 2, Vec3d::UnitY()));
  Obstacle ball = obstacle(5, SphereShape{1});
  ball.reflecting = true;
  REQUIRE(scene.apply(create(0, wall)));
  REQUIRE(scene.apply(create(0, ball)));
  REQUIRE(scene.apply(create(0, obstacle(6, PlaneShape{}))));
  REQUIRE(scene.apply(move(1, 4, {Vec3d(2, 0, 0), wall.pose.orientation})));
  const auto planes = scene.reflecting_planes(0.5);
  REQUIRE(planes.size() == 1);
  CHECK(planes[0].id == 4);
  CHECK((planes[0].point_m - Vec3d(1.5, 0, 0)).norm() < 1e-12);
  CHECK((planes[0].normal - Vec3d(-1, 0, 0)).norm() < 1e-12);
  CHECK(planes[0].reflection_coefficient == 0.5);
}

TEST_CASE("The listener moves linearly", "[scene]") {
  SceneState scene;
  CHECK_FALSE(scene.listener(0));
  Listener at;
  at.time_s = 1;
  REQUIRE(scene.apply(at));
  at.time_s = 2;
  at.position_m = Vec3d(0, 2, 0);
  REQUIRE(scene.apply(at));
  CHECK((scene.listener(1.5)->position_m - Vec3d(0, 1, 0)).norm() < 1e-12);
  CHECK(scene.listener(0)->position_m == Vec3d::Zero());
  CHECK(scene.listener(5)->position_m == Vec3d(0, 2, 0));
  at.time_s = 1.5;
  const auto result = scene.apply(at);
  REQUIRE_FALSE(result);
  CHECK(result.error().find("time_s") != std::string::npos);
}

}  // namespace scene_state_test
