#include <catch2/catch.hpp>

#include "tests/unit/wire/messages.h"

namespace scene_test {

using namespace rustle;
using namespace rustle::wire;
using namespace rustle::wire::test;
using sheet::Vec3d;

namespace {

void require_error(const tl::expected<Decoded, Error>& decoded, ErrorCode code, const std::string& field) {
  REQUIRE_FALSE(decoded.has_value());
  CHECK(code_name(decoded.error().code) == code_name(code));
  CHECK(decoded.error().field == field);
  CHECK_FALSE(decoded.error().remedy.empty());
}

session::SessionOptions y_up() {
  session::SessionOptions options;
  options.up_axis = session::UpAxis::kY;
  options.metres_per_unit = 0.5;
  return options;
}

Vec3d turned(const Vec3d& v) {
  return {v.x(), -v.z(), v.y()};
}

}  // namespace

TEST_CASE("every shape comes through, in metres", "[wire][scene]") {
  session::SessionOptions options;
  options.metres_per_unit = 0.1;
  Decoder decoder(options);
  auto sent = message();
  sent.mutable_scene()->set_time_s(2);
  auto* plane = add_obstacle(sent, 1);
  plane->set_name("table");
  plane->set_surface_material("wooden-table");
  plane->set_reflecting(true);
  plane->set_reflection_coefficient(0.5);
  plane->mutable_plane();
  set(add_obstacle(sent, 2)->mutable_box()->mutable_half_extents(), 1, 2, 3);
  add_obstacle(sent, 3)->mutable_sphere()->set_radius(4);
  auto* capsule = add_obstacle(sent, 4)->mutable_capsule();
  capsule->set_radius(5);
  capsule->set_half_length(6);
  auto* mesh = add_obstacle(sent, 5)->mutable_mesh();
  mesh->set_triangles(pack(kTriangles));
  mesh->set_vertices(pack(kPositions));
  const auto decoded = decode(decoder, sent);
  REQUIRE(decoded.has_value());
  const auto& read = item_of<scene::SceneUpdate>(decoded);
  CHECK(read.time_s == 2);
  REQUIRE(read.obstacles.size() == 5);
  CHECK(read.obstacles[0].surface_material == "wooden-table");
  CHECK(read.obstacles[0].reflecting);
  CHECK(read.obstacles[0].reflection_coefficient == 0.5);
  CHECK(std::holds_alternative<scene::PlaneShape>(read.obstacles[0].shape));
  CHECK((std::get<scene::BoxShape>(read.obstacles[1].shape).half_extents_m - Vec3d(0.1, 0.2, 0.3)).norm() < 1e-12);
  CHECK(read.obstacles[1].reflection_coefficient == 1);
  CHECK(std::get<scene::SphereShape>(read.obstacles[2].shape).radius_m == Approx(0.4));
  CHECK(std::get<scene::CapsuleShape>(read.obstacles[3].shape).half_length_m == Approx(0.6));
  const auto& vertices = std::get<scene::MeshShape>(read.obstacles[4].shape).vertices_m;
  CHECK((vertices[2] - sheet::Vec3f(0.1f, 0.2f, 0.025f)).norm() < 1e-6f);
  CHECK(decoder.obstacle_count() == 5);
}

TEST_CASE("a point of an obstacle is where the sender's axes put it", "[wire][scene]") {
  Decoder decoder(y_up());
  const Eigen::Quaterniond turn(Eigen::AngleAxisd(0.7, Vec3d(1, 2, -1).normalized()));
  const Vec3d place(3, -1, 2);
  auto sent = mesh_obstacle_message(5);
  const auto write_pose = [&](v1::Pose* pose) {
    set(pose->mutable_position(), place.x(), place.y(), place.z());
    pose->mutable_orientation()->set_w(2 * turn.w());  // any length is taken
    pose->mutable_orientation()->set_x(2 * turn.x());
    pose->mutable_orientation()->set_y(2 * turn.y());
    pose->mutable_orientation()->set_z(2 * turn.z());
  };
  write_pose(sent.mutable_scene()->mutable_obstacles(0)->mutable_pose());
  const auto decoded = decode(decoder, sent);
  REQUIRE(decoded.has_value());
  const auto& obstacle = item_of<scene::SceneUpdate>(decoded).obstacles[0];
  for (std::size_t v = 0; v < kVertices; ++v) {
    const Vec3d local(kPositions[3 * v], kPositions[3 * v + 1], kPositions[3 * v + 2]);
    const Vec3d world = turned(turn * local + place) * 0.5;
    const Vec3d read = obstacle.pose.orientation * std::get<scene::MeshShape>(obstacle.shape).vertices_m[v].cast<double>() +
                       obstacle.pose.position_m;
    CHECK((world - read).norm() < 1e-6);
  }
}

TEST_CASE("a plane's point and normal are in its pose, also after it moved", "[wire][scene]") {
  for (const auto& options : {session::SessionOptions{}, y_up()}) {
    const bool y = options.up_axis == session::UpAxis::kY;
    const double scale = options.metres_per_unit;
    for (const Vec3d& normal : {Vec3d(0, 0, 1), Vec3d(0, 0, -3), Vec3d(0, 1, 0), Vec3d(1, -2, 0.5), Vec3d(1e-9, 0, -1)}) {
      Decoder decoder(options);
      auto sent = message();
      auto* plane = add_obstacle(sent, 1)->mutable_plane();
      set(plane->mutable_point(), 1, 2, 3);
      set(plane->mutable_normal(), normal.x(), normal.y(), normal.z());
      const auto check = [&](const scene::Pose& pose, const Vec3d& moved) {
        const Vec3d point = (Vec3d(1, 2, 3) + moved) * scale;
        const Vec3d unit = normal.normalized();
        CHECK((pose.position_m - (y ? turned(point) : point)).norm() < 1e-9);
        CHECK((pose.orientation * Vec3d::UnitZ() - (y ? turned(unit) : unit)).norm() < 1e-8);
      };
      const auto created = decode(decoder, sent);
      REQUIRE(created.has_value());
      check(item_of<scene::SceneUpdate>(created).obstacles[0].pose, Vec3d::Zero());
      auto move = message();
      auto* pose = move.mutable_scene()->add_poses();
      pose->set_obstacle_id(1);
      set(pose->mutable_pose()->mutable_position(), 0, 5, 0);
      const auto moved = decode(decoder, move);
      REQUIRE(moved.has_value());
      check(item_of<scene::SceneUpdate>(moved).poses[0].pose, Vec3d(0, 5, 0));
    }
  }
}

TEST_CASE("poses, vertices and removals are of obstacles that exist", "[wire][scene]") {
  Decoder decoder{session::SessionOptions{}};
  REQUIRE(decode(decoder, mesh_obstacle_message(5)).has_value());
  auto sent = message();
  auto* scene = sent.mutable_scene();
  SECTION("unknown ones") {
    scene->add_poses()->set_obstacle_id(6);
    require_error(decode(decoder, sent), ErrorCode::kUnknownObstacle, "scene.poses[0].obstacle_id");
    scene->clear_poses();
    scene->add_vertices()->set_obstacle_id(6);
    require_error(decode(decoder, sent), ErrorCode::kUnknownObstacle, "scene.vertices[0].vertices");
    scene->clear_vertices();
    scene->add_removed_obstacle_ids(6);
    require_error(decode(decoder, sent), ErrorCode::kUnknownObstacle, "scene.removed_obstacle_ids");
  }
  SECTION("created in the same message") {
    add_obstacle(sent, 6)->mutable_sphere()->set_radius(1);
    scene->add_poses()->set_obstacle_id(6);
    CHECK(decode(decoder, sent).has_value());
  }
  SECTION("vertices as many as the mesh has, of a mesh") {
    auto* vertices = scene->add_vertices();
    vertices->set_obstacle_id(5);
    vertices->set_vertices(pack(std::vector<float>(9)));
    require_error(decode(decoder, sent), ErrorCode::kMalformed, "scene.vertices[0].vertices");
    vertices->set_vertices(pack(std::vector<float>(12, 2.0f)));
    CHECK(decode(decoder, sent).has_value());
    add_obstacle(sent, 5)->mutable_sphere()->set_radius(1);
    require_error(decode(decoder, sent), ErrorCode::kMalformed, "scene.vertices[0].vertices");
  }
  SECTION("removed ones are gone") {
    scene->add_removed_obstacle_ids(5);
    REQUIRE(decode(decoder, sent).has_value());
    CHECK(decoder.obstacle_count() == 0);
    CHECK_FALSE(decode(decoder, sent).has_value());
  }
  SECTION("time does not go back") {
    scene->set_time_s(2);
    REQUIRE(decode(decoder, sent).has_value());
    REQUIRE(decode(decoder, sent).has_value());
    scene->set_time_s(1);
    require_error(decode(decoder, sent), ErrorCode::kTimeOrder, "scene.time_s");
  }
}

TEST_CASE("obstacles with impossible fields are refused, and nothing of their message is kept", "[wire][scene]") {
  Decoder decoder{session::SessionOptions{}};
  auto sent = message();
  add_obstacle(sent, 1)->mutable_sphere()->set_radius(1);
  auto* bad = add_obstacle(sent, 2);
  const auto refused = [&](ErrorCode code, const std::string& field) {
    require_error(decode(decoder, sent), code, field);
    CHECK(decoder.obstacle_count() == 0);
  };
  refused(ErrorCode::kMalformed, "scene.obstacles[1].shape");
  bad->mutable_sphere();
  refused(ErrorCode::kOutOfRange, "scene.obstacles[1].sphere.radius");
  bad->mutable_sphere()->set_radius(std::nan(""));
  refused(ErrorCode::kNotFinite, "scene.obstacles[1].sphere.radius");
  bad->mutable_box();
  refused(ErrorCode::kOutOfRange, "scene.obstacles[1].box.half_extents.x");
  bad->mutable_capsule()->set_radius(1);
  bad->mutable_capsule()->set_half_length(-1);
  refused(ErrorCode::kOutOfRange, "scene.obstacles[1].capsule.half_length");
  bad->mutable_plane()->mutable_normal();
  refused(ErrorCode::kOutOfRange, "scene.obstacles[1].plane.normal");
  bad->mutable_mesh()->set_vertices(pack(kPositions));
  refused(ErrorCode::kMalformed, "scene.obstacles[1].mesh.triangles");
  bad->mutable_mesh()->set_triangles(pack<std::uint32_t>({0, 1, 9}));
  refused(ErrorCode::kOutOfRange, "scene.obstacles[1].mesh.triangles");
  bad->mutable_sphere()->set_radius(1);
  bad->set_reflection_coefficient(1.5);
  refused(ErrorCode::kOutOfRange, "scene.obstacles[1].reflection_coefficient");
  bad->set_reflection_coefficient(1);
  bad->mutable_pose()->mutable_orientation()->set_w(1e-5);
  refused(ErrorCode::kOutOfRange, "scene.obstacles[1].pose.orientation");
  bad->mutable_pose()->mutable_orientation()->set_w(1);
  set(bad->mutable_pose()->mutable_position(), 0, 1e6, 0);
  refused(ErrorCode::kOutOfRange, "scene.obstacles[1].pose.position");
  bad->clear_pose();
  CHECK(decode(decoder, sent).has_value());
}

TEST_CASE("obstacles are counted", "[wire][scene]") {
  Limits limits;
  limits.obstacles = 3;
  limits.obstacle_triangles = 3;
  Decoder decoder({}, limits);
  for (std::uint32_t id = 1; id <= 4; ++id) {
    auto sent = message();
    add_obstacle(sent, id)->mutable_sphere()->set_radius(1);
    CHECK(decode(decoder, sent).has_value() == (id <= 3));
  }
  CHECK(decode(decoder, mesh_obstacle_message(1)).has_value());
  require_error(decode(decoder, mesh_obstacle_message(2)), ErrorCode::kTooLarge, "scene.obstacles");
  CHECK(decode(decoder, mesh_obstacle_message(1)).has_value());
}

}  // namespace scene_test
