#include "server/analysis/regions.h"

#include <algorithm>
#include <cmath>
#include <map>

#include <catch2/catch.hpp>

#include "moving_sheet.h"
#include "server/analysis/resonators.h"
#include "server/scene/scene_state.h"

namespace regions_test {

using namespace rustle;
using observation::Resonator;
using sheets::MeshKind;

namespace {

struct Answer {
  double area_m2, ruling_m, free_border_m;  ///< 0, 0: constrained
};
/// By formula, largest first; the lengths of slanted rulings by dense sampling of the exact shape.
const std::map<std::string, std::vector<Answer>> kAnswers = {
    {"flat", {{0.06237, 0, 0}}},
    {"strip10", {{0.06237, 0.21, 0.594}}},
    {"strip30", {{0.06237, 0.21, 0.594}}},
    {"strip30_oblique", {{0.06237, 0.2037, 0.594}}},
    {"cone", {{0.06237, 0.1933, 0.7607}}},
    {"sbend", {{0.03118, 0.21, 0.297}, {0.03118, 0.21, 0.297}}},
    {"half_bent", {{0.03547, 0, 0}, {0.0269, 0.21, 0.2571}}},
    {"ridge", {{0.03742, 0, 0}, {0.02495, 0, 0}}},
    {"ridge_oblique", {{0.03814, 0, 0}, {0.02423, 0, 0}}},
    {"fold3mm", {{0.03814, 0, 0}, {0.02353, 0, 0}}},
    {"bent_ridge", {{0.03742, 0.21, 0.357}, {0.02495, 0.21, 0.237}}},
};

void check(const std::vector<Resonator>& found, const std::vector<Answer>& answers, double bound) {
  std::vector<Resonator> regions = found;
  std::sort(regions.begin(), regions.end(), [](const auto& a, const auto& b) { return a.area_m2 > b.area_m2; });
  REQUIRE(regions.size() == answers.size());
  for (std::size_t i = 0; i < answers.size(); ++i) {
    CHECK(regions[i].area_m2 == Approx(answers[i].area_m2).epsilon(bound));
    CHECK(regions[i].constrained == (answers[i].free_border_m == 0));
    CHECK(regions[i].ruling_length_m == Approx(answers[i].ruling_m).epsilon(bound));
    CHECK(regions[i].free_border_length_m == Approx(answers[i].free_border_m).epsilon(bound));
  }
}

}  // namespace

TEST_CASE("regions, rulings and free borders of the sheets with known answers") {
  for (const auto& [name, answers] : kAnswers) {
    const auto& shape = *sheets::find_shape(name);
    for (MeshKind kind : {MeshKind::kStructured, MeshKind::kDelaunay}) {
      for (std::size_t triangles : {446, 1333, 20000}) {
        const auto mesh = sheets::make_rectangle(kind, shape.width_m, shape.height_m, triangles);
        const auto picture =
            analysis::picture_regions(test::frame_of(mesh, test::topology_of(mesh), test::map_of(*shape.shape)), {});
        CAPTURE(name, static_cast<int>(kind), triangles);
        check(picture.regions, answers, 0.06);
        if (triangles == 20000) CHECK(picture.map.region.size() < 2000);
      }
    }
  }
}

TEST_CASE("graded and coarse meshes say that they are coarse") {
  const auto& shape = *sheets::find_shape("strip30");
  const auto graded = sheets::make_rectangle(MeshKind::kGraded, shape.width_m, shape.height_m, 446);
  for (const auto& r :
       analysis::picture_regions(test::frame_of(graded, test::topology_of(graded), test::map_of(*shape.shape)), {})
           .regions) {
    CHECK(r.coarse);
  }
  const auto fine = sheets::make_rectangle(MeshKind::kDelaunay, shape.width_m, shape.height_m, 1333);
  for (const auto& r :
       analysis::picture_regions(test::frame_of(fine, test::topology_of(fine), test::map_of(*shape.shape)), {}).regions) {
    CHECK_FALSE(r.coarse);
  }
}

TEST_CASE("place, normal, spread and covariance of a resonator") {
  const auto mesh = sheets::make_rectangle(MeshKind::kDelaunay, 0.3, 0.2, 1333);
  const auto topology = test::topology_of(mesh);
  const Eigen::Quaterniond turn(Eigen::AngleAxisd(0.7, sheet::Vec3d(1, 1, 0).normalized()));
  const auto flat = test::moved(test::arc(0, 0.3), turn, {9, 8, 7});
  const auto picture = analysis::picture_regions(test::frame_of(mesh, topology, flat), {});
  REQUIRE(picture.regions.size() == 1);
  const Resonator& r = picture.regions[0];
  CHECK(r.position_m.isApprox(flat(0.15, 0.1), 1e-5));
  CHECK(std::abs(r.normal.dot(turn * sheet::Vec3d::UnitZ())) == Approx(1).epsilon(1e-6));
  CHECK(r.normal_spread < 1e-3);
  CHECK(r.disc_radius_m == Approx(std::sqrt(0.06 / 3.14159265)).epsilon(1e-4));
  const sheet::Vec3d along = turn * sheet::Vec3d::UnitX();
  CHECK(along.dot(r.covariance_m2 * along) == Approx(0.3 * 0.3 / 12).epsilon(0.01));
  CHECK(r.normal.dot(r.covariance_m2 * r.normal) < 1e-8);

  const double k = 6, half = k * 0.15;  // an arc's normals turn by ± half
  const auto bent = analysis::picture_regions(test::frame_of(mesh, topology, test::arc(k, 0.3)), {});
  REQUIRE(bent.regions.size() == 1);
  CHECK(bent.regions[0].normal_spread == Approx(std::sqrt(0.5 - std::sin(2 * half) / (4 * half))).epsilon(0.02));
}

TEST_CASE("a ridge stops the flood, an inflection does not, an anchor does") {
  const auto reached = [](const char* name, bool anchor_middle) {
    const auto& shape = *sheets::find_shape(name);
    const auto mesh = sheets::make_rectangle(MeshKind::kDelaunay, shape.width_m, shape.height_m, 1333);
    const auto frame = test::frame_of(mesh, test::topology_of(mesh), test::map_of(*shape.shape));
    const auto stencils = analysis::region_stencils(frame.topology, sheet::rest_plane(*frame.topology, {}), {});
    const analysis::Parameters parameters;
    analysis::RegionScratch scratch;
    analysis::RegionMap map;
    std::vector<sheet::Vec4f> relative;
    sheet::relative_positions_m(frame.positions_m, sheet::Vec3f::Zero(), relative);
    analysis::segment(stencils, {relative, {}}, 0, parameters, nullptr, scratch, map);
    analysis::Holds holds{std::vector<std::uint8_t>(frame.positions_m.size()),
                          std::vector<std::uint8_t>(frame.positions_m.size())};
    for (std::size_t i = 0; i < frame.positions_m.size(); ++i) {
      holds.anchored[i] = anchor_middle && std::abs(mesh.material_coordinates[i][0] - 0.1485f) < 0.02f;
    }
    analysis::ResonatorFinder finder(parameters);
    finder.turn_to({stencils, map, relative, sheet::Vec3d::Zero(), holds});
    const std::uint32_t corner = map.region[0];
    const auto first =
        static_cast<std::uint32_t>(std::find(map.region.begin(), map.region.end(), corner) - map.region.begin());
    return finder.reached_from(std::span(&first, 1), analysis::ResonatorFinder::StopAt::kRidgesAndHolds).size();
  };
  CHECK(reached("ridge", false) == 1);
  CHECK(reached("bent_ridge", false) == 1);
  CHECK(reached("sbend", false) == 2);
  CHECK(reached("half_bent", false) == 2);
  CHECK(reached("sbend", true) == 1);
}

TEST_CASE("held borders are not free, and a border held whole makes the resonator constrained") {
  const auto mesh = sheets::make_rectangle(MeshKind::kDelaunay, 0.297, 0.210, 1333);
  auto frame = test::frame_of(mesh, test::topology_of(mesh), test::arc(5));
  frame.anchored.assign(frame.positions_m.size(), false);
  for (std::size_t i = 0; i < frame.positions_m.size(); ++i) frame.anchored[i] = mesh.material_coordinates[i][1] < 1e-6f;
  auto regions = analysis::picture_regions(frame, {}).regions;
  REQUIRE(regions.size() == 1);
  CHECK_FALSE(regions[0].constrained);
  CHECK(regions[0].free_border_length_m == Approx(0.297).epsilon(0.05));
  for (std::size_t i = 0; i < frame.positions_m.size(); ++i) {
    frame.anchored[i] = frame.anchored[i] || mesh.material_coordinates[i][1] > 0.21f - 1e-6f;
  }
  regions = analysis::picture_regions(frame, {}).regions;
  CHECK(regions[0].constrained);
}

TEST_CASE("the simulator's own partition is used when it is sent") {
  const auto mesh = sheets::make_rectangle(MeshKind::kStructured, 0.297, 0.210, 446);
  auto frame = test::frame_of(mesh, test::topology_of(mesh), test::arc(5));
  sheet::SentPartition partition;
  for (const auto& t : mesh.triangles) {
    const float u =
        (mesh.material_coordinates[t[0]][0] + mesh.material_coordinates[t[1]][0] + mesh.material_coordinates[t[2]][0]) / 3;
    partition.triangle_regions.push_back(u < 0.1f ? 0 : u < 0.2f ? 1 : sheet::kNone);
  }
  partition.region_curved = {true, false};
  partition.rulings = {{{0, 0, 0}, {0, 0.19f, 0}, 0}, {{0, 0, 0}, {0, 0.17f, 0}, 0}};
  frame.partition = partition;
  const auto picture = analysis::picture_regions(frame, {});
  REQUIRE(picture.map.region_count == 3);
  CHECK(picture.regions[0].ruling_length_m == Approx(0.18));
  CHECK(picture.regions[0].free_border_length_m == Approx(0.2).epsilon(0.15));
  CHECK_FALSE(picture.regions[0].constrained);
  CHECK(picture.regions[1].constrained);
  CHECK(picture.regions[2].constrained);
}

TEST_CASE("sliding flat is constrained, sliding on two edges leaves the curved borders free, resting seeks nothing") {
  const auto scene = test::table_at_zero();
  analysis::SheetSurroundings surroundings;
  surroundings.scene = &scene;
  const auto mesh = sheets::make_rectangle(MeshKind::kDelaunay, 0.297, 0.210, 1333);
  const auto topology = test::topology_of(mesh);
  const double k = 6, rise = (1 - std::cos(k * 0.297 / 2)) / k;
  for (bool bent : {false, true}) {
    for (double speed : {0.1, 0.0}) {
      analysis::SheetAnalyzer analyzer(1, {});
      std::uint64_t next_id = 1;
      observation::Observation last;
      for (int frame = 0; frame < 5; ++frame) {
        const double t = frame / 60.0;
        const auto map = test::moved(bent ? test::arc(k) : test::arc(0), Eigen::Quaterniond::Identity(),
                                     {0, speed * t, bent ? rise + 0.0005 : 0.0005});
        last = analyzer.analyze(test::frame_of(mesh, topology, map, t), surroundings, next_id);
      }
      CAPTURE(bent, speed);
      REQUIRE(last.friction.size() >= 1);
      for (const auto& contact : last.friction) {
        if (speed == 0) {
          CHECK(contact.resonators.empty());
          continue;
        }
        REQUIRE(contact.resonators.size() == 1);
        CHECK(contact.resonators[0].constrained == !bent);
        if (bent) {
          CHECK(contact.resonators[0].free_border_length_m > 0.45);
          CHECK(contact.resonators[0].free_border_length_m < 0.6);
          CHECK(contact.resonators[0].ruling_length_m == Approx(0.21).epsilon(0.05));
        }
      }
    }
  }
}

TEST_CASE("sent tear tips keep their id and ring the sheet around them") {
  const auto mesh = sheets::make_rectangle(MeshKind::kDelaunay, 0.297, 0.210, 446);
  const auto topology = test::topology_of(mesh);
  analysis::SheetAnalyzer analyzer(1, {});
  std::uint64_t next_id = 10, id = 0;
  for (int k = 0; k < 3; ++k) {
    auto frame = test::frame_of(mesh, topology, test::arc(5), k / 60.0);
    frame.tear_tips.push_back({7, {0, 0.1f, 0}, 0.2f, sheet::Vec3f(0, 1, 0)});
    const auto seen = analyzer.analyze(frame, {}, next_id);
    REQUIRE(seen.tears.size() == 1);
    if (k == 0) id = seen.tears[0].id;
    CHECK(seen.tears[0].id == id);
    CHECK(seen.tears[0].source == observation::Source::kSent);
    REQUIRE(seen.tears[0].resonators.size() == 1);
    CHECK_FALSE(seen.tears[0].resonators[0].constrained);
  }
}

TEST_CASE("resonators move with a sheet that keeps its bend, and change with the bend at once") {
  const auto mesh = sheets::make_rectangle(MeshKind::kDelaunay, 0.297, 0.210, 1333);
  const auto topology = test::topology_of(mesh);
  analysis::SheetAnalyzer analyzer(1, {});
  std::uint64_t next_id = 1;
  const auto ring = [&](int k, double curvature_per_m) {
    const auto place = test::moved(test::arc(curvature_per_m), Eigen::Quaterniond::Identity(), {0.01 * k, 0, 0});
    auto frame = test::frame_of(mesh, topology, place, k / 240.0);
    frame.tear_tips.push_back({7, frame.positions_m[0], 0.2f, std::nullopt});
    const auto seen = analyzer.analyze(frame, {}, next_id);
    REQUIRE(seen.tears[0].resonators.size() == 1);
    return seen.tears[0].resonators[0];
  };
  const Resonator first = ring(0, 5);
  for (int k = 1; k < 30; ++k) {
    const Resonator r = ring(k, 5);
    CHECK(r.position_m.x() == Approx(first.position_m.x() + 0.01 * k).margin(1e-5));
    CHECK(r.ruling_length_m == Approx(first.ruling_length_m).epsilon(0.001));
    CHECK(r.free_border_length_m == Approx(first.free_border_length_m).epsilon(0.001));
  }
  CHECK(ring(30, 0).constrained);
  CHECK_FALSE(ring(31, -3).constrained);
  for (int k = 0; k <= 40; ++k) {  // slowly: no step of it is much, all of it is
    const Resonator r = ring(32 + k, 3 - 0.075 * k);
    if (k == 40) CHECK(r.constrained);
  }
}

TEST_CASE("broken and tiny meshes pass through, finite") {
  using sheet::Topology;
  const std::vector<std::vector<sheet::Triangle>> cases = {{},
                                                           {{0, 1, 2}},
                                                           {{0, 1, 2}, {0, 1, 2}, {2, 1, 0}},
                                                           {{0, 0, 1}, {3, 4, 5}},
                                                           {{0, 1, 2}, {0, 1, 3}, {1, 0, 4}, {1, 0, 5}}};
  const auto scene = test::table_at_zero();
  analysis::SheetSurroundings surroundings;
  surroundings.scene = &scene;
  for (const auto& triangles : cases) {
    for (bool together : {true, false}) {
      Topology::Input input;
      input.vertex_count = 8;
      input.triangles = triangles;
      const auto topology = *Topology::make(std::move(input));
      analysis::SheetAnalyzer analyzer(1, {});
      std::uint64_t next_id = 1;
      for (int k = 0; k < 6; ++k) {
        sheet::MeshFrame frame;
        frame.time_s = k / 60.0;
        frame.topology = topology;
        frame.tear_tips.push_back({1, {0, 0, 0}, 0.1f, std::nullopt});
        for (int i = 0; i < 8; ++i) {
          const float x = together ? 0.0f : 0.05f * static_cast<float>(i * i % 5) + 0.01f * static_cast<float>(k);
          frame.positions_m.emplace_back(x, together ? 0.0f : 0.03f * static_cast<float>(i),
                                         (k % 2 == 1 && i > 3) ? 0.02f : 0.0f);
        }
        const auto seen = analyzer.analyze(frame, surroundings, next_id);
        for (const auto& e : seen.crumpling) CHECK(std::isfinite(e.amplitude_m + e.time_s + e.position_m.sum()));
        for (const auto& t : seen.tears) {
          REQUIRE(!t.resonators.empty());
          for (const auto& r : t.resonators) {
            CHECK(
                std::isfinite(r.area_m2 + r.position_m.sum() + r.normal.sum() + r.covariance_m2.sum() + r.ruling_length_m));
          }
        }
        for (const auto& c : seen.friction) CHECK(std::isfinite(c.speed_m_per_s + c.area_m2));
      }
    }
  }
  sheet::MeshFrame empty;
  empty.topology = *Topology::make({});
  analysis::SheetAnalyzer analyzer(1, {});
  std::uint64_t next_id = 1;
  CHECK(analyzer.analyze(empty, surroundings, next_id).crumpling.empty());
  CHECK(analysis::picture_regions(empty, {}).map.region_count == 0);
}

}  // namespace regions_test
