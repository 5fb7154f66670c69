#include <functional>
#include <optional>

#include <catch2/catch.hpp>

#include "server/analysis/contacts.h"
#include "server/analysis/sheet_analyzer.h"
#include "tests/support/counted_allocations.h"
#include "tests/unit/analysis/contact_sheets.h"

namespace allocation_test {

using namespace contact_tests;

TEST_CASE("A warm tracker allocates what it returns and nothing else", "[contacts]") {
  const scene::SceneState table = table_at();
  const scene::SceneState ball = scene_with(scene::SphereShape{0.1});
  const scene::SceneState nothing;
  const auto mesh = sheets::make_rectangle(sheets::MeshKind::kDelaunay, kWidth_m, kHeight_m, 1333);
  const auto topology = topology_of(mesh);
  struct Scene {
    const char* name;
    const scene::SceneState* scene;
    std::function<Vec3d(double, double, double)> at;
    bool touches;
    bool other = false;
  };
  const std::vector<Scene> scenes = {
      {"above", &table, [](double u, double v, double t) { return Vec3d(curled(u, v) + Vec3d(0.1 * t, 0, 0.02)); }, false},
      {"bending", &table, [](double u, double v, double t) { return Vec3d(u, v, 0.02 + (4 + 20 * t) * u * u); }, false},
      {"sliding", &table, [](double u, double v, double t) { return Vec3d(curled(u, v) + Vec3d(0.1 * t, 0, 0)); }, true},
      {"ball", &ball, [](double u, double v, double t) { return Vec3d(u - 0.15 + 0.1 * t, v - 0.1, 0.1005); }, true},
      {"folded", &nothing, [](double u, double v, double t) { return folded(u, v, t); }, true},
      {"stacked", &nothing, [](double u, double v, double t) { return Vec3d(u + 0.1 * t, v, 0.002); }, true, true},
  };
  for (const Scene& scene : scenes) {
    INFO(scene.name);
    std::vector<MeshFrame> frames, below;
    for (int k = 0; k < 8; ++k) {
      const double t = k / 60.0;
      frames.push_back(frame_at(topology, mesh, t, [&](double u, double v) { return scene.at(u, v, t); }));
      below.push_back(frame_at(
          topology, mesh, t, [](double u, double v) { return Vec3d(u, v, 0); }, 2));
    }
    ContactTracker tracker;
    std::uint64_t next_id = 1;
    for (std::size_t n = 0; n < 2 * frames.size(); ++n) {
      const std::size_t k = n % frames.size();
      const std::size_t last = (n + frames.size() - 1) % frames.size();
      const bool warm = n >= frames.size();
      frames[k].time_s = below[k].time_s = static_cast<double>(n) / 60.0;
      SheetSurroundings around = only(*scene.scene);
      around.touched_surface = around.material = "wood";
      NeighbourSheet neighbour{2, &below[k], n > 0 ? &below[last] : nullptr, "wood"};
      if (scene.other) around.others = {&neighbour, 1};
      std::vector<sheet::Vec4f> relative_m;
      const Vec3f& origin_m = frames[k].positions_m.front();
      sheet::relative_positions_m(frames[k].positions_m, origin_m, relative_m);
      const analysis::ContactInputs inputs{frames[k], n > 0 ? &frames[last] : nullptr, around, kRadius_m, origin_m,
                                           relative_m};
      std::vector<observation::FrictionContact> contacts;
      const int allocations = rustle::test_support::allocations_of([&] { contacts = tracker.update(inputs, next_id); });
      CHECK(contacts.empty() != scene.touches);
      // The list, and the vertices of each.
      if (warm) CHECK(allocations == (contacts.empty() ? 0 : static_cast<int>(1 + contacts.size())));
    }
  }
}

TEST_CASE("A warm analyzer allocates what it returns and nothing else", "[contacts]") {
  const scene::SceneState table = table_at();
  const auto mesh = sheets::make_rectangle(sheets::MeshKind::kDelaunay, kWidth_m, kHeight_m, 1333);
  const auto topology = topology_of(mesh);
  for (const bool touching : {false, true}) {
    INFO(touching);
    analysis::SheetAnalyzer analyzer(1, {});
    std::uint64_t next_id = 1;
    SheetSurroundings around = only(table);
    around.touched_surface = around.material = "wood";
    for (int k = 0; k < 80; ++k) {
      const double t = k / 60.0, lift_m = touching ? 0 : 0.02;
      const MeshFrame frame =
          frame_at(topology, mesh, t, [&](double u, double v) { return Vec3d(curled(u, v) + Vec3d(0.1 * t, 0, lift_m)); });
      std::optional<observation::Observation> seen;
      const int allocations = rustle::test_support::allocations_of([&] { seen = analyzer.analyze(frame, around, next_id); });
      REQUIRE(seen->friction.empty() != touching);
      // The list of contacts, of each the vertices and the resonators, and the vertices of one too small to be told yet.
      const auto returned = touching ? 2 + 2 * seen->friction.size() : 0;
      if (k >= 50) CHECK(allocations <= static_cast<int>(returned));
    }
  }
}

}  // namespace allocation_test
