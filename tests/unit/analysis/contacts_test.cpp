#include "server/analysis/contacts.h"

#include <cmath>
#include <functional>
#include <memory>

#include <catch2/catch.hpp>

#include "client_sdk/sheets/demos.h"
#include "client_sdk/sheets/motions.h"
#include "tests/unit/analysis/contact_sheets.h"

namespace contacts_test {

using namespace contact_tests;

TEST_CASE("A sliding flat sheet has its speed and area at any resolution and frame rate", "[contacts]") {
  const scene::SceneState scene = table_at();
  for (const std::size_t triangles : {183u, 1333u, 20000u}) {
    const auto mesh = sheets::make_rectangle(sheets::MeshKind::kDelaunay, kWidth_m, kHeight_m, triangles);
    const auto topology = topology_of(mesh);
    for (const double rate_hz : {30.0, 60.0, 240.0}) {
      Run run;
      std::uint64_t id = 0;
      for (int k = 0; k < 4; ++k) {
        const double t = k / rate_hz;
        const auto contacts =
            run.step(frame_at(topology, mesh, t, [&](double u, double v) { return Vec3d(u + 0.08 * t, v - 0.06 * t, 0.0); }),
                     only(scene));
        REQUIRE(contacts.size() == 1);
        const FrictionContact& contact = contacts[0];
        if (k == 0) id = contact.id;
        CHECK(contact.id == id);
        CHECK(contact.speed_m_per_s == Approx(k == 0 ? 0.0 : 0.1).epsilon(0.01).margin(1e-9));
        CHECK(contact.area_m2 == Approx(kWidth_m * kHeight_m).epsilon(1e-4));
        CHECK(contact.touched_surface == "wooden-table");
        CHECK(contact.vertices.size() == mesh.material_coordinates.size());
        double by_vertex_m2 = 0;
        for (const auto& vertex : contact.vertices) {
          by_vertex_m2 += static_cast<double>(vertex.area_m2);
          if (k > 0) CHECK((vertex.slip_velocity_m_per_s - Vec3f(0.08f, -0.06f, 0)).norm() < 0.002f);
        }
        CHECK(by_vertex_m2 == Approx(contact.area_m2).epsilon(1e-5));
        if (k > 0) CHECK((contact.direction - Vec3d(0.8, -0.6, 0)).norm() < 0.01);
        CHECK((contact.position_m - Vec3d(kWidth_m / 2 + 0.08 * t, kHeight_m / 2 - 0.06 * t, 0)).norm() < 1e-3);
      }
    }
  }
}

TEST_CASE("The gap that simulators leave is bridged, a wider one is not", "[contacts]") {
  const auto mesh = sheets::make_rectangle(sheets::MeshKind::kDelaunay, kWidth_m, kHeight_m, 446);
  const auto topology = topology_of(mesh);
  const scene::SceneState scene = table_at();
  const auto at_height = [&](double z) {
    return Run().step(frame_at(topology, mesh, 0, [&](double u, double v) { return Vec3d(u, v, z); }), only(scene));
  };
  REQUIRE(at_height(0.0025).size() == 1);
  CHECK(at_height(0.0025)[0].area_m2 == Approx(kWidth_m * kHeight_m).epsilon(0.01));
  CHECK(at_height(-0.002).size() == 1);
  CHECK(at_height(0.0031).empty());
  CHECK(at_height(-0.05).empty());
}

TEST_CASE("An arched sheet on its edges and a standing one touch alike at any resolution", "[contacts]") {
  const scene::SceneState scene = table_at();
  const sheets::BentShape arch(kWidth_m, kHeight_m, 0, {}, {8.0});
  const double low = arch.at(0, 0)[2];
  const auto arched = [&](double t) {
    return [&, t](double u, double v) {
      const auto p = arch.at(u, v);
      return Vec3d(p[0] + 0.1 * t, p[1], p[2] - low);
    };
  };
  const auto standing = [](double t) {
    return [t](double u, double v) { return Vec3d(0.3 * u + 0.1 * t, v, std::sqrt(1 - 0.09) * u); };
  };
  double arched_area = 0, standing_area = 0;
  for (const auto kind : {sheets::MeshKind::kDelaunay, sheets::MeshKind::kStructured}) {
    for (const std::size_t triangles : {20000u, 1333u, 446u, 183u}) {
      INFO(triangles);
      const auto mesh = sheets::make_rectangle(kind, kWidth_m, kHeight_m, triangles);
      const auto topology = topology_of(mesh);
      Run run, other;
      std::vector<FrictionContact> on_edges, on_edge;
      for (int k = 0; k < 2; ++k) {
        on_edges = run.step(frame_at(topology, mesh, k / 60.0, arched(k / 60.0)), only(scene));
        on_edge = other.step(frame_at(topology, mesh, k / 60.0, standing(k / 60.0)), only(scene));
      }
      REQUIRE(on_edges.size() == 2);
      REQUIRE(on_edge.size() == 1);
      if (arched_area == 0) {
        arched_area = on_edges[0].area_m2;
        standing_area = on_edge[0].area_m2;
        CHECK(standing_area == Approx(kHeight_m * 0.925 * kRadius_m / std::sqrt(1 - 0.09)).epsilon(0.1));
      }
      for (const auto& contact : on_edges) {
        CHECK(std::abs(level_db(contact.speed_m_per_s, 0.1)) < 0.1);
        CHECK(std::abs(level_db(contact.area_m2, arched_area)) < 1.0);
      }
      CHECK(std::abs(level_db(on_edge[0].speed_m_per_s, 0.1)) < 0.1);
      CHECK(std::abs(level_db(on_edge[0].area_m2, standing_area)) < 0.1);
    }
  }
}

TEST_CASE("Sliding over a sphere, a capsule, a box and a mesh is heard alike at any resolution", "[contacts]") {
  scene::MeshShape roof;
  roof.vertices_m = {Vec3f(0, -1, 0),        Vec3f(0, 1, 0),         Vec3f(-0.5f, -1, -0.2f),
                     Vec3f(-0.5f, 1, -0.2f), Vec3f(0.5f, -1, -0.2f), Vec3f(0.5f, 1, -0.2f)};
  roof.triangles = {{0, 1, 2}, {1, 3, 2}, {0, 4, 1}, {1, 4, 5}};
  const std::vector<scene::Shape> shapes = {scene::SphereShape{0.1}, scene::CapsuleShape{0.05, 0.02},
                                            scene::BoxShape{Vec3d(0.05, 0.05, 0.1)}, roof};
  const std::vector<double> tops = {0.1, 0.07, 0.1, 0.0};
  for (std::size_t s = 0; s < shapes.size(); ++s) {
    double area = 0;
    for (const std::size_t triangles : {20000u, 1333u, 183u}) {
      INFO(s << " " << triangles);
      scene::SceneState scene;
      scene::SceneUpdate update;
      scene::Obstacle obstacle;
      obstacle.id = 1;
      obstacle.shape = shapes[s];
      update.obstacles = {obstacle};
      REQUIRE(scene.apply(update));
      const auto mesh = sheets::make_rectangle(sheets::MeshKind::kDelaunay, kWidth_m, kHeight_m, triangles);
      const auto topology = topology_of(mesh);
      Run run;
      std::vector<FrictionContact> contacts;
      for (int k = 0; k < 3; ++k) {
        const double t = k / 60.0;
        contacts =
            run.step(frame_at(topology, mesh, t,
                              [&](double u, double v) { return Vec3d(u - 0.15 + 0.1 * t, v - 0.1, tops[s] + 0.0005); }),
                     only(scene));
      }
      REQUIRE(contacts.size() == 1);
      CHECK(contacts[0].touched_surface == "cardboard");
      if (area == 0) area = contacts[0].area_m2;
      // Slip runs along the partner's surface: on the roof down its slopes.
      const double speed = s == 3 ? 0.1 * std::cos(std::atan(0.4)) : 0.1;
      CHECK(std::abs(level_db(contacts[0].speed_m_per_s, speed)) < 0.5);
      CHECK(std::abs(level_db(contacts[0].area_m2, area)) < 1.0);
    }
  }
}

TEST_CASE("A sheet carried by its obstacle is silent, one left behind is not", "[contacts]") {
  const auto mesh = sheets::make_rectangle(sheets::MeshKind::kDelaunay, kWidth_m, kHeight_m, 446);
  const auto topology = topology_of(mesh);
  const auto pose_at = [](double t) {
    return scene::Pose{Vec3d(0.5 * t, -0.3 * t, 0.1 * t),
                       Eigen::Quaterniond(Eigen::AngleAxisd(4 * t, Vec3d(0.1, 0.2, 1).normalized()))};
  };
  for (const bool sent : {false, true}) {
    scene::SceneState scene = table_at();
    Run carried, left, first;
    for (int k = 0; k < 5; ++k) {
      const double t = k / 60.0;
      scene::SceneUpdate update;
      update.time_s = t;
      update.poses = {{5, pose_at(t)}};
      REQUIRE(scene.apply(update));
      MeshFrame on = frame_at(topology, mesh, t, [&](double u, double v) {
        return Vec3d(pose_at(t).orientation * Vec3d(u, v, 0.001) + pose_at(t).position_m);
      });
      if (sent) {
        for (const Vec3f& p : on.positions_m) {
          const scene::RigidMotion motion = scene.find(5)->motion(t, 0);
          on.velocities_m_per_s.push_back(motion.at(p.cast<double>()).cast<float>());
        }
      }
      const auto contacts = carried.step(std::move(on), only(scene));
      REQUIRE(contacts.size() == 1);
      CHECK(contacts[0].speed_m_per_s < 1e-3);
    }
  }
  scene::SceneState scene = table_at();
  Run left;
  std::vector<FrictionContact> contacts;
  for (int k = 0; k < 3; ++k) {
    scene::SceneUpdate update;
    update.time_s = k / 60.0;
    update.poses = {{5, {Vec3d(0.2 * update.time_s, 0, 0), Eigen::Quaterniond::Identity()}}};
    REQUIRE(scene.apply(update));
    contacts =
        left.step(frame_at(topology, mesh, update.time_s, [](double u, double v) { return Vec3d(u, v, 0); }), only(scene));
  }
  REQUIRE(contacts.size() == 1);
  CHECK(contacts[0].speed_m_per_s == Approx(0.2).epsilon(1e-3));
  CHECK(contacts[0].direction.x() == Approx(-1));
}

TEST_CASE("Two sheets in contact sound once", "[contacts]") {
  const scene::SceneState nothing;
  const auto mesh_a = sheets::make_rectangle(sheets::MeshKind::kDelaunay, kWidth_m, kHeight_m, 446, 1);
  const auto mesh_b = sheets::make_rectangle(sheets::MeshKind::kDelaunay, kWidth_m, kHeight_m, 1333, 2);
  const auto topology_a = topology_of(mesh_a);
  const auto topology_b = topology_of(mesh_b);
  Run a, b;
  for (int k = 0; k < 4; ++k) {
    const double t = k / 60.0;
    MeshFrame frame_a = frame_at(
        topology_a, mesh_a, t, [&](double u, double v) { return Vec3d(u, v + 0.25 * t, 1.002 + 0.1 * t); }, 1);
    MeshFrame frame_b = frame_at(
        topology_b, mesh_b, t, [&](double u, double v) { return Vec3d(u - 0.1, v, 1.0 + 0.1 * t); }, 2);
    // The neighbour's newest frame is the one before: it is carried on to this frame's time.
    const std::unique_ptr<MeshFrame> b_before = b.previous ? std::make_unique<MeshFrame>(*b.previous) : nullptr;
    const NeighbourSheet sees_b{2, &frame_b, b_before.get(), "tracing-paper"};
    const NeighbourSheet sees_a{1, &frame_a, a.previous.get(), "printer-paper"};
    SheetSurroundings around_a = only(nothing), around_b = only(nothing);
    around_a.others = {&sees_b, 1};
    around_b.others = {&sees_a, 1};
    const auto from_b = b.step(frame_b, around_b);
    const auto from_a = a.step(frame_a, around_a);
    CHECK(from_b.empty());
    REQUIRE(from_a.size() == 1);
    CHECK(from_a[0].partner == sheet::ContactPartner(sheet::SheetPartner{2}));
    CHECK(from_a[0].touched_surface == "tracing-paper");
    CHECK(from_a[0].area_m2 == Approx((kWidth_m - 0.1) * (kHeight_m - 0.25 * t)).epsilon(0.05));
    CHECK(from_a[0].speed_m_per_s == Approx(k == 0 ? 0.0 : 0.25).margin(1e-6).epsilon(0.01));
  }
}

TEST_CASE("A folded sheet touches itself, once, where its halves meet", "[contacts]") {
  const scene::SceneState nothing;
  for (const bool with_material : {true, false}) {
    for (const std::size_t triangles : {446u, 1333u, 5000u}) {
      INFO(triangles << " " << with_material);
      const auto mesh = sheets::make_rectangle(sheets::MeshKind::kDelaunay, kWidth_m, kHeight_m, triangles);
      const auto topology = topology_of(mesh, with_material);
      Run run;
      std::vector<FrictionContact> contacts;
      for (int k = 0; k < 3; ++k) {
        const double t = k / 60.0;
        contacts = run.step(frame_at(topology, mesh, t, [&](double u, double v) { return folded(u, v, t); }), only(nothing));
      }
      REQUIRE(contacts.size() == 1);
      CHECK(contacts[0].partner == sheet::ContactPartner(sheet::SheetPartner{1}));
      CHECK(contacts[0].touched_surface == "printer-paper");
      CHECK(contacts[0].area_m2 < 0.147 * kHeight_m);
      CHECK(contacts[0].area_m2 > (triangles > 1000 ? 0.75 : 0.5) * 0.147 * kHeight_m);
      CHECK(contacts[0].speed_m_per_s == Approx(0.1).epsilon(0.05));
    }
  }
}

TEST_CASE("Flat and bent sheets do not touch themselves", "[contacts]") {
  const scene::SceneState nothing;
  for (const sheets::NamedShape& named : sheets::shape_zoo()) {
    for (const std::size_t triangles : {183u, 1333u}) {
      INFO(named.name << " " << triangles);
      const auto mesh = sheets::make_rectangle(sheets::MeshKind::kDelaunay, named.width_m, named.height_m, triangles);
      for (const bool with_material : {true, false}) {
        const auto contacts = Run().step(frame_at(topology_of(mesh, with_material), mesh, 0,
                                                  [&](double u, double v) {
                                                    const auto p = named.shape->at(u, v);
                                                    return Vec3d(p[0], p[1], p[2]);
                                                  }),
                                         only(nothing));
        CHECK(contacts.empty());
      }
    }
  }
}

TEST_CASE("Level and area over every kind of obstacle hold at any resolution and frame rate", "[contacts]") {
  scene::MeshShape slab;
  slab.vertices_m = {Vec3f(-0.05f, -1, 0), Vec3f(0.05f, -1, 0), Vec3f(0.05f, 1, 0), Vec3f(-0.05f, 1, 0)};
  slab.triangles = {{0, 1, 2}, {0, 2, 3}};
  const std::vector<scene::Shape> shapes = {scene::PlaneShape{}, scene::BoxShape{Vec3d(0.05, 0.05, 0.1)},
                                            scene::SphereShape{0.1}, scene::CapsuleShape{0.05, 0.02}, slab};
  const std::vector<double> tops = {0, 0.1, 0.1, 0.07, 0};
  for (std::size_t s = 0; s < shapes.size(); ++s) {
    const scene::SceneState scene = scene_with(shapes[s]);
    double level = 0, area_m2 = 0;
    for (const std::size_t triangles : {20000u, 5000u, 1333u, 446u, 183u}) {
      const auto mesh = sheets::make_rectangle(sheets::MeshKind::kDelaunay, kWidth_m, kHeight_m, triangles);
      const auto topology = topology_of(mesh);
      for (const double rate_hz : {240.0, 60.0, 30.0}) {
        if (triangles == 20000u && rate_hz == 60.0) continue;
        INFO(s << " " << triangles << " " << rate_hz);
        Run run;
        std::vector<FrictionContact> contacts;
        for (int k = 0; k < 2; ++k) {
          const double t = 0.1 + (k - 1) / rate_hz;
          contacts = run.step(
              frame_at(topology, mesh, t,
                       [&](double u, double v) { return Vec3d(u - 0.15 + 0.08 * t, v - 0.1 + 0.06 * t, tops[s] + 0.0005); }),
              only(scene));
        }
        REQUIRE(contacts.size() == 1);
        if (level == 0) level = contacts[0].speed_m_per_s, area_m2 = contacts[0].area_m2;
        CHECK(std::abs(level_db(contacts[0].speed_m_per_s, level)) < 0.5);
        CHECK(std::abs(level_db(contacts[0].area_m2, area_m2)) < 1.0);
      }
    }
    CHECK(std::abs(level_db(level, 0.1)) < 0.5);
  }
}

TEST_CASE("The same frames give the same bits", "[contacts]") {
  const scene::SceneState table = table_at();
  const auto mesh = sheets::make_rectangle(sheets::MeshKind::kDelaunay, kWidth_m, kHeight_m, 446);
  const auto topology = topology_of(mesh);
  const auto run = [&] {
    Run one;
    std::vector<FrictionContact> all;
    for (int k = 0; k < 6; ++k) {
      const double t = k / 60.0;
      for (auto& contact :
           one.step(frame_at(topology, mesh, t, [&](double u, double v) { return folded(u, v, t); }), only(table))) {
        all.push_back(std::move(contact));
      }
    }
    return all;
  };
  const auto a = run();
  const auto b = run();
  REQUIRE(a.size() == b.size());
  REQUIRE(a.size() >= 12);
  for (std::size_t c = 0; c < a.size(); ++c) {
    CHECK(a[c].id == b[c].id);
    CHECK(a[c].area_m2 == b[c].area_m2);
    CHECK(a[c].speed_m_per_s == b[c].speed_m_per_s);
    CHECK(a[c].position_m == b[c].position_m);
    REQUIRE(a[c].vertices.size() == b[c].vertices.size());
    for (std::size_t v = 0; v < a[c].vertices.size(); ++v) {
      CHECK(a[c].vertices[v].vertex == b[c].vertices[v].vertex);
      CHECK(a[c].vertices[v].area_m2 == b[c].vertices[v].area_m2);
      CHECK(a[c].vertices[v].slip_velocity_m_per_s == b[c].vertices[v].slip_velocity_m_per_s);
    }
  }
}

TEST_CASE("Sent contacts replace proximity and keep their slip and force", "[contacts]") {
  const auto mesh = sheets::make_rectangle(sheets::MeshKind::kStructured, kWidth_m, kHeight_m, 183);
  const auto topology = topology_of(mesh);
  const scene::SceneState scene = table_at();
  Run run;
  for (int k = 0; k < 3; ++k) {
    const double t = k / 60.0;
    MeshFrame frame = frame_at(topology, mesh, t, [&](double u, double v) { return Vec3d(u + 0.1 * t, v, 0.001); });
    frame.contacts.emplace();
    if (k == 0) {
      CHECK(run.step(frame, only(scene)).empty());
      continue;
    }
    frame.contacts->push_back({0, sheet::ObstaclePartner{5}, Vec3f(0, 0.3f, 0), 0.5f});
    frame.contacts->push_back({1, sheet::ObstaclePartner{5}, Vec3f(0, 0.3f, 0), 0.25f});
    frame.contacts->push_back({150, sheet::ObstaclePartner{5}, std::nullopt, std::nullopt});
    if (frame.topology->vertex_count() <= 150) frame.contacts->back().vertex = 60;
    const auto contacts = run.step(frame, only(scene));
    REQUIRE(contacts.size() == 2);
    CHECK(contacts[0].source == observation::Source::kSent);
    CHECK(contacts[0].speed_m_per_s == Approx(0.3));
    CHECK(contacts[0].normal_force_n == Approx(0.75));
    CHECK(contacts[0].vertices[1].normal_force_n == 0.25f);
    CHECK(contacts[1].speed_m_per_s == Approx(0.1).epsilon(0.01));
    CHECK(contacts[1].normal_force_n < 0);
    CHECK(contacts[0].id == 1);
    CHECK(contacts[1].id == 2);
  }
}

TEST_CASE("A remesh neither bursts nor breaks an episode", "[contacts]") {
  const scene::SceneState scene = table_at();
  for (const bool with_material : {true, false}) {
    Run run;
    std::uint64_t id = 0;
    for (int k = 0; k < 6; ++k) {
      const double t = k / 60.0;
      const auto mesh = sheets::make_rectangle(sheets::MeshKind::kDelaunay, kWidth_m, kHeight_m,
                                               400 + 37 * static_cast<std::size_t>(k), static_cast<std::uint64_t>(k));
      const auto contacts = run.step(frame_at(topology_of(mesh, with_material), mesh, t,
                                              [&](double u, double v) { return Vec3d(u + 0.1 * t, v, 0.002); }),
                                     only(scene));
      REQUIRE(contacts.size() == 1);
      if (k == 0) id = contacts[0].id;
      CHECK(contacts[0].id == id);
      if (k > 0) CHECK(contacts[0].speed_m_per_s == Approx(with_material ? 0.1 : 0.0).epsilon(0.01).margin(1e-9));
    }
  }
}

TEST_CASE("Where a contact splits, its larger part keeps the id", "[contacts]") {
  const scene::SceneState scene = table_at();
  const auto mesh = sheets::make_rectangle(sheets::MeshKind::kStructured, kWidth_m, kHeight_m, 2000);
  const auto topology = topology_of(mesh);
  Run run;
  const auto whole = run.step(frame_at(topology, mesh, 0, [](double u, double v) { return Vec3d(u, v, 0); }), only(scene));
  REQUIRE(whole.size() == 1);
  const auto parts = run.step(
      frame_at(topology, mesh, 0.02, [](double u, double v) { return Vec3d(u, v, std::abs(u - 0.1) < 0.02 ? 0.02 : 0.0); }),
      only(scene));
  REQUIRE(parts.size() == 2);
  const auto& larger = parts[0].area_m2 > parts[1].area_m2 ? parts[0] : parts[1];
  const auto& smaller = parts[0].area_m2 > parts[1].area_m2 ? parts[1] : parts[0];
  CHECK(larger.id == whole[0].id);
  CHECK(smaller.id != whole[0].id);
  const auto merged =
      run.step(frame_at(topology, mesh, 0.04, [](double u, double v) { return Vec3d(u, v, 0); }), only(scene));
  REQUIRE(merged.size() == 1);
  CHECK(merged[0].id == whole[0].id);
}

TEST_CASE("A lone vertex of a fine mesh must touch twice to be believed", "[contacts]") {
  const scene::SceneState scene = table_at();
  const auto mesh = sheets::make_rectangle(sheets::MeshKind::kStructured, kWidth_m, kHeight_m, 20000);
  const auto topology = topology_of(mesh);
  const auto& spot = mesh.material_coordinates[mesh.material_coordinates.size() / 2 + 20];
  const auto dip = [&](double depth) {
    return [&spot, depth](double u, double v) {
      const bool there =
          std::abs(u - static_cast<double>(spot[0])) < 1e-6 && std::abs(v - static_cast<double>(spot[1])) < 1e-6;
      return Vec3d(u, v, there ? 0.0045 - depth : 0.0045);
    };
  };
  Run run;
  CHECK(run.step(frame_at(topology, mesh, 0.00, dip(0.0035)), only(scene)).empty());
  CHECK(run.step(frame_at(topology, mesh, 0.02, dip(0)), only(scene)).empty());
  CHECK(run.step(frame_at(topology, mesh, 0.04, dip(0.0035)), only(scene)).empty());
  CHECK(run.step(frame_at(topology, mesh, 0.06, dip(0.0035)), only(scene)).size() == 1);
}

TEST_CASE("History reset gives one silent frame", "[contacts]") {
  const scene::SceneState scene = table_at();
  const auto mesh = sheets::make_rectangle(sheets::MeshKind::kStructured, kWidth_m, kHeight_m, 446);
  const auto topology = topology_of(mesh);
  Run run;
  for (int k = 0; k < 4; ++k) {
    MeshFrame frame = frame_at(topology, mesh, k / 60.0,
                               [&](double u, double v) { return Vec3d(u + 0.1 * k / 60.0 + (k >= 2 ? 3.0 : 0.0), v, 0); });
    frame.reset_history = k == 2;
    const auto contacts = run.step(frame, only(scene));
    REQUIRE(contacts.size() == 1);
    CHECK(contacts[0].speed_m_per_s == Approx(k == 0 || k == 2 ? 0.0 : 0.1).epsilon(0.01).margin(1e-9));
    CHECK(contacts[0].id == (k < 2 ? 1 : 2));
  }
}

TEST_CASE("In the demo the front edge slides, the held edge rests and the lifted sheet is free", "[contacts]") {
  const auto demo = sheets::make_demo("bend_slide_snap_shake");
  const auto topology = topology_of(demo->mesh());
  const scene::SceneState scene = table_at();
  Run run;
  for (int k = 0; k < static_cast<int>(60 * demo->duration_s()); ++k) {
    MeshFrame frame;
    frame.sheet = 1;
    frame.time_s = k / 60.0;
    frame.topology = topology;
    frame.positions_m.resize(topology->vertex_count());
    demo->positions(frame.time_s, {frame.positions_m[0].data(), 3 * frame.positions_m.size()});
    std::vector<std::uint8_t> held(topology->vertex_count());
    demo->anchored(frame.time_s, held);
    const auto before = run.previous ? run.previous->positions_m : frame.positions_m;
    double front_m_per_s = 0;
    for (std::size_t i = 0; i < held.size(); ++i) {
      if (!held[i]) continue;
      const double moved = static_cast<double>(frame.positions_m[i].x()) - static_cast<double>(before[i].x());
      front_m_per_s = std::max(front_m_per_s, std::abs(moved) * 60);
    }
    const double time_s = frame.time_s;
    const auto contacts = run.step(std::move(frame), only(scene));
    INFO(time_s);
    if (time_s < 0.3) {
      REQUIRE(contacts.size() == 1);
      CHECK(contacts[0].area_m2 == Approx(kWidth_m * kHeight_m).epsilon(1e-3));
    }
    if (time_s > 1.0 && time_s < 1.7) {
      REQUIRE(contacts.size() == 2);
      const auto [slow, fast] = std::minmax(contacts[0].speed_m_per_s, contacts[1].speed_m_per_s);
      CHECK(fast == Approx(front_m_per_s).epsilon(0.05).margin(0.002));
      CHECK(slow < 0.012);  // it turns on the table
    }
    if (time_s > 2.1 && time_s < 2.3) {
      REQUIRE(contacts.size() == 2);
      for (const auto& contact : contacts) CHECK(contact.speed_m_per_s == Approx(front_m_per_s).epsilon(0.01));
    }
    if (time_s > 4.6) CHECK(contacts.empty());
  }
}

}  // namespace contacts_test
