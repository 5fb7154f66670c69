#include "server/analysis/contact_patch.h"

#include <array>
#include <cmath>
#include <limits>
#include <random>

#include <catch2/catch.hpp>

#include "server/analysis/contact_components.h"
#include "server/analysis/obstacle_contact.h"
#include "server/analysis/sheet_contact.h"
#include "server/analysis/unfolded.h"
#include "tests/unit/analysis/contact_sheets.h"

namespace contact_patch_test {

using namespace contact_tests;

TEST_CASE("A flat sheet is surely unfolded, one that overlaps itself is not", "[contacts]") {
  const auto mesh = sheets::make_rectangle(sheets::MeshKind::kDelaunay, 0.6, 0.05, 600);
  const auto topology = topology_of(mesh);
  OwnGeometry geometry;
  const MeshFrame flat = frame_at(topology, mesh, 0, [](double u, double v) { return Vec3d(v, u, 0); });
  geometry.update(flat);
  CHECK(analysis::UnfoldedProof().holds(geometry));
  // A border that is not star-shaped: three quarters of a ring.
  const auto winding = [&](double pitch_m, double radius_m) {
    return frame_at(topology, mesh, 0, [=](double u, double v) {
      const double turn = u / radius_m;
      return Vec3d((0.05 + v) * std::cos(turn), (0.05 + v) * std::sin(turn), pitch_m * turn / (2 * M_PI));
    });
  };
  const MeshFrame ring = winding(0, 0.127);
  geometry.update(ring);
  CHECK(analysis::UnfoldedProof().holds(geometry));
  // A winding stair: all normals point up, yet it passes over itself.
  const MeshFrame stair = winding(0.004, 0.075);
  geometry.update(stair);
  CHECK_FALSE(analysis::UnfoldedProof().holds(geometry));
}

TEST_CASE("A kept proof says what a new one would, however the sheet moves", "[contacts]") {
  const auto mesh = sheets::make_rectangle(sheets::MeshKind::kDelaunay, kWidth_m, kHeight_m, 446);
  const auto topology = topology_of(mesh);
  const MeshFrame flat = frame_at(topology, mesh, 0, [](double u, double v) { return Vec3d(u, v, 0); });
  OwnGeometry geometry;
  const auto holds_after = [&](const MeshFrame& moved) {
    analysis::UnfoldedProof kept;
    geometry.update(flat);
    REQUIRE(kept.holds(geometry));
    geometry.update(moved);
    return kept.holds(geometry);
  };
  const auto holds_anew = [&](const MeshFrame& moved) {
    geometry.update(moved);
    return analysis::UnfoldedProof().holds(geometry);
  };
  SECTION("every vertex in a direction of its own") {
    std::size_t unproven = 0;
    for (std::uint32_t k = 1; k < 40; ++k) {
      std::mt19937 random(k);
      const auto shift = [&] { return 0.0004 * k * (static_cast<double>(random()) / 2147483648.0 - 1); };
      const MeshFrame moved = frame_at(topology, mesh, 0, [&](double u, double v) {
        const double across = shift();
        const double along = shift();
        return Vec3d(u + across, v + along, shift());
      });
      const bool anew = holds_anew(moved);
      unproven += !anew;
      CHECK((anew || !holds_after(moved)));
    }
    CHECK(unproven > 5);
    CHECK(unproven < 35);
  }
  SECTION("one triangle turned over by moving all its corners as little as that takes") {
    for (const sheet::Triangle& t : topology->triangles()) {
      MeshFrame moved = flat;
      const Vec3f side = flat.positions_m[t[2]] - flat.positions_m[t[1]];
      const Vec3f up = Vec3f::UnitZ().cross(side).normalized();
      const float height_m = up.dot(flat.positions_m[t[0]] - flat.positions_m[t[1]]);
      moved.positions_m[t[0]] -= 0.51f * height_m * up;
      for (const std::size_t k : {1u, 2u}) moved.positions_m[t[k]] += 0.51f * height_m * up;
      CHECK_FALSE(holds_anew(moved));
      CHECK_FALSE(holds_after(moved));
    }
  }
}

TEST_CASE("Contact with a plane agrees with fine sampling of every triangle", "[contacts]") {
  // Corners at heights about the radius and about the depth down to which a solid is touched.
  const scene::SceneState scene = table_at();
  std::mt19937 random(7);
  const auto uniform = [&](double low, double high) {
    return low + (high - low) * static_cast<double>(random()) / 4294967296.0;
  };
  const analysis::ContactWeight weight;
  double worst_area_db = 0, worst_level_db = 0;
  for (int k = 0; k < 300; ++k) {
    Topology::Input input;
    input.vertex_count = 3;
    input.triangles = {{0, 1, 2}};
    const auto topology = Topology::make(std::move(input)).value();
    MeshFrame frame;
    frame.topology = topology;
    const double size_m = std::pow(10.0, uniform(-3, -1));
    const double depth_m = k % 3 == 0 ? 0.03 : 0.0;
    for (int c = 0; c < 3; ++c) {
      const double height_m = k % 10 == 0 ? 0.0027 : uniform(-depth_m, k % 2 ? 0.006 : std::max(0.006, 0.5 * size_m));
      frame.positions_m.push_back(Vec3d(uniform(0, size_m), uniform(0, size_m), height_m).cast<float>());
      frame.velocities_m_per_s.push_back(
          Vec3d(0.1 + uniform(-0.02, 0.02), uniform(-0.02, 0.02), uniform(-0.1, 0.1)).cast<float>());
    }
    double area_m2 = 0, speed_area = 0;
    constexpr int kAlong = 400;
    std::array<Vec3d, 3> p, velocity;
    for (std::size_t c = 0; c < 3; ++c) {
      p[c] = frame.positions_m[c].cast<double>();
      velocity[c] = frame.velocities_m_per_s[c].cast<double>();
      velocity[c].z() = 0;
    }
    const double sample_m2 = 0.5 * (p[1] - p[0]).cross(p[2] - p[0]).norm() / (kAlong * kAlong);
    const auto sample = [&](double b, double c) {
      const double w = weight.at((1 - b - c) * p[0].z() + b * p[1].z() + c * p[2].z(), kRadius_m);
      area_m2 += w * sample_m2;
      speed_area += w * sample_m2 * ((1 - b - c) * velocity[0] + b * velocity[1] + c * velocity[2]).norm();
    };
    for (int i = 0; i < kAlong; ++i) {
      for (int j = 0; j < kAlong - i; ++j) {
        sample((i + 1.0 / 3) / kAlong, (j + 1.0 / 3) / kAlong);
        if (j < kAlong - 1 - i) sample((i + 2.0 / 3) / kAlong, (j + 2.0 / 3) / kAlong);
      }
    }
    if (area_m2 < 100 * sample_m2) continue;
    INFO(k);
    scene::ObstacleSurface table;
    table.update(*scene.find(5), 0, 0);
    analysis::ObstacleContact surface;
    surface.set(table);
    OwnGeometry geometry;
    geometry.update(frame);
    analysis::VertexVelocities velocities;
    velocities.sent_m_per_s = frame.velocities_m_per_s;
    analysis::ContactMeter meter;
    const auto& patch = meter.measure(geometry, surface, velocities, weight, kRadius_m);
    double measured_m2 = 0, measured_speed_area = 0;
    for (std::size_t c = 0; c < patch.vertices.size(); ++c) {
      measured_m2 += patch.areas_m2[c];
      measured_speed_area += patch.areas_m2[c] * patch.slips_m_per_s[c].norm();
    }
    REQUIRE(measured_m2 > 0);
    worst_area_db = std::max(worst_area_db, std::abs(level_db(measured_m2, area_m2)));
    worst_level_db = std::max(worst_level_db, std::abs(level_db(measured_speed_area, speed_area)));
    CHECK(std::abs(level_db(measured_m2, area_m2)) < 0.1);
    CHECK(std::abs(level_db(measured_speed_area, speed_area)) < 0.1);
  }
  CAPTURE(worst_area_db, worst_level_db);
  CHECK(worst_area_db < 0.1);
}

TEST_CASE("The broad phase between sheets does linear work", "[contacts]") {
  for (const bool same : {false, true}) {
    double before = 0;
    for (const std::size_t triangles : {500u, 2000u, 8000u, 32000u}) {
      INFO(same << " " << triangles);
      // At the same ratio of radius to edge length.
      const double radius_m = 0.15 * std::sqrt(kWidth_m * kHeight_m / static_cast<double>(triangles));
      const auto mesh = sheets::make_rectangle(sheets::MeshKind::kDelaunay, kWidth_m, kHeight_m, triangles);
      const auto topology = topology_of(mesh);
      const MeshFrame frame = frame_at(topology, mesh, 0, [&](double u, double v) { return Vec3d(u, v, 0.5 * radius_m); });
      const MeshFrame other = frame_at(topology, mesh, 0, [](double u, double v) { return Vec3d(u + 0.004, v, 0); });
      OwnGeometry geometry;
      geometry.update(frame);
      analysis::PosedSheet posed, posed_other;
      posed.update(topology, frame.positions_m, geometry.origin_m);
      posed_other.update(topology, other.positions_m, geometry.origin_m);
      analysis::SurfaceDistance along(topology, frame.positions_m, 3 * radius_m, 2.5);
      analysis::SheetContact surface;
      if (same) {
        surface.set_same(posed, {}, along);
      } else {
        surface.set(posed, posed_other, {});
      }
      analysis::ContactMeter meter;
      const auto& patch = meter.measure(geometry, surface, {}, {}, radius_m);
      if (same) {
        CHECK(patch.vertices.empty());
      } else {
        CHECK(patch.vertices.size() > 0.9 * static_cast<double>(mesh.material_coordinates.size()));
      }
      const double visits = static_cast<double>(surface.pairs_visited()) / static_cast<double>(triangles);
      if (before > 0) CHECK(visits < 1.2 * before);
      before = visits;
    }
  }
}

TEST_CASE("What was put elsewhere in next to no time did not slide", "[contacts]") {
  const auto mesh = sheets::make_rectangle(sheets::MeshKind::kStructured, kWidth_m, kHeight_m, 8);
  const auto topology = topology_of(mesh);
  const MeshFrame frame = frame_at(topology, mesh, 0, [](double u, double v) { return Vec3d(u, v, 0); });
  const auto& corners = topology->triangles()[0];
  const auto contact_of = [&](const Vec3d& slip_m_per_s) {
    analysis::ContactPatch patch;
    for (const std::uint32_t v : corners) {
      patch.vertices.push_back(v);
      patch.areas_m2.push_back(1e-4);
      patch.slips_m_per_s.push_back(slip_m_per_s);
      patch.partner_triangles.push_back(sheet::kNone);
    }
    patch.triangles = {0};
    std::vector<FrictionContact> out;
    analysis::ContactComponents().split(frame, patch, {}, "", false, out);
    REQUIRE(out.size() == 1);
    return out[0];
  };
  CHECK(contact_of({0, 0.2, 0}).speed_m_per_s == Approx(0.2));
  CHECK(contact_of({0, 0.2, 0}).direction == Vec3d(0, 1, 0));
  const double endless = std::numeric_limits<double>::infinity();
  for (const double speed : {1e9, 1e200, endless}) {
    INFO(speed);
    const auto contact = contact_of({0, speed, 0});
    CHECK(contact.speed_m_per_s == 0);
    CHECK(contact.direction.allFinite());
    for (const auto& vertex : contact.vertices) CHECK(vertex.slip_velocity_m_per_s.norm() == 0);
  }
}

}  // namespace contact_patch_test
