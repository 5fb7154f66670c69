#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

#include <catch2/catch.hpp>

#include "moving_sheet.h"
#include "server/analysis/bending_activity.h"

namespace bending_activity_test {

using namespace rustle;
using sheets::MeshKind;

namespace {

constexpr double kWidth_m = 0.297;
constexpr double kHeight_m = 0.210;
constexpr double kArea_m2 = kWidth_m * kHeight_m;

struct Meshed {
  sheets::SheetMesh mesh;
  std::shared_ptr<const sheet::Topology> topology;
};

Meshed meshed(std::size_t triangles, std::uint64_t seed = 0, bool with_material = true) {
  auto mesh = sheets::make_rectangle(MeshKind::kDelaunay, kWidth_m, kHeight_m, triangles, seed);
  auto topology = test::topology_of(mesh, with_material);
  return {std::move(mesh), std::move(topology)};
}

struct Fed {
  double change_m = 0;
  std::vector<double> by_patch = std::vector<double>(analysis::kMostPatches, 0.0);
  std::vector<observation::BendingPatch> last;
  int unidentified = 0;
};

/// Frame k shows mesh k of the cycle; what came before `from_s` does not count.
template <class MapAt>
Fed feed(const std::vector<Meshed>& cycle, const MapAt& map_at, double seconds, double rate_hz, double from_s = 0) {
  analysis::SheetAnalyzer analyzer(1, {});
  std::uint64_t next_id = 1;
  Fed out;
  for (int k = 0; k <= std::lround(seconds * rate_hz); ++k) {
    const Meshed& now = cycle[static_cast<std::size_t>(k) % cycle.size()];
    const double time_s = k / rate_hz;
    const auto seen = analyzer.analyze(test::frame_of(now.mesh, now.topology, map_at(time_s), time_s), {}, next_id);
    out.unidentified += seen.unidentified ? 1 : 0;
    if (time_s < from_s) continue;
    for (const auto& patch : seen.bending) {
      out.change_m += patch.change_m;
      out.by_patch[patch.patch] += patch.change_m;
    }
    if (!seen.bending.empty()) out.last = seen.bending;
  }
  return out;
}

double ramp(double t, double duration_s) {
  return std::clamp(t / duration_s, 0.0, 1.0);
}

}  // namespace

TEST_CASE("a rigid motion feeds nothing, flat or bent, 10 m from the origin, at any resolution", "[bending]") {
  for (const std::size_t triangles : {183, 1333, 20000}) {
    for (const double curvature_per_m : {0.0, 20.0, 22.0, 60.0}) {
      const auto turning = [&](double t) {
        const Eigen::Quaterniond turn(Eigen::AngleAxisd(3 * t, sheet::Vec3d(1, 2, 3).normalized()));
        return test::moved(test::arc(curvature_per_m), turn, {10 + t, -10, 10 - 2 * t});
      };
      CAPTURE(triangles, curvature_per_m);
      CHECK(feed({meshed(triangles)}, turning, 1, triangles > 10000 ? 30 : 60).change_m == 0);
    }
  }
}

TEST_CASE("gentle bending, and the whole bend of a flap reversed, are elastic", "[bending]") {
  const auto reversed = [](double t) { return test::arc(15.7 * std::cos(2 * std::numbers::pi * t)); };
  CHECK(feed({meshed(1333)}, reversed, 2, 60).change_m == 0);
}

TEST_CASE("what bends beyond yield is counted once, whatever the resolution and the frame rate", "[bending]") {
  // H to 30/m: H_p goes to 20/m. Letting go to 15/m is elastic; bending the other way to -20/m takes H_p to -10/m.
  const auto way = [](double t) {
    const double k = t < 0.4 ? 60 * ramp(t, 0.4) : t < 0.7 ? 60 - 30 * ramp(t - 0.4, 0.3) : 30 - 70 * ramp(t - 0.7, 0.3);
    return test::arc(k);
  };
  for (const std::size_t triangles : {183, 446, 1333, 20000}) {
    for (const double rate_hz : {30.0, 60.0, 240.0}) {
      if (triangles > 10000 && rate_hz > 60) continue;
      CAPTURE(triangles, rate_hz);
      const double bent_m = feed({meshed(triangles)}, way, 0.7, rate_hz).change_m;
      CHECK(bent_m == Approx(20 * kArea_m2).epsilon(0.1));
      const double all_m = feed({meshed(triangles)}, way, 1.0, rate_hz).change_m;
      CHECK(all_m - bent_m == Approx(30 * kArea_m2).epsilon(0.1));
    }
  }
}

TEST_CASE("bending that has been borne before is silent until it is exceeded", "[bending]") {
  const auto again = [](double t) { return test::arc(30 + 20 * std::cos(2 * std::numbers::pi * t)); };
  const Fed fed = feed({meshed(1333)}, again, 3, 60);
  CHECK(fed.change_m < 0.05 * kArea_m2);
}

TEST_CASE("patches tell where the sheet bends, and which way it faces there", "[bending]") {
  // Only the part beyond u = 0.2 m curls up.
  const auto curl = [](double t) -> test::Map {
    const double k = 60 * ramp(t, 0.5) + 1e-6;
    return [=](double u, double v) {
      const double s = std::max(0.0, u - 0.2);
      return sheet::Vec3d(std::min(u, 0.2) + std::sin(k * s) / k, v, (1 - std::cos(k * s)) / k);
    };
  };
  const Fed fed = feed({meshed(1333)}, curl, 0.5, 60);
  REQUIRE(fed.change_m > 0);
  double area_m2 = 0;
  for (const auto& patch : fed.last) {
    CHECK(patch.position_m.x() > 0.17);
    CHECK(patch.normal.norm() == Approx(1));
    CHECK(patch.covariance_m2.trace() < 0.01);
    CHECK(patch.covariance_m2.trace() > 1e-6);
    CHECK(patch.normal_spread >= 0);
    CHECK(patch.normal_spread <= 1);
    area_m2 += patch.area_m2;
  }
  CHECK(area_m2 < 0.6 * kArea_m2);
  CHECK(std::count_if(fed.by_patch.begin(), fed.by_patch.end(), [](double m) { return m > 0; }) <= 8);
}

TEST_CASE("a random remesh at every frame of a fixed sheet feeds nothing that is heard", "[bending][remesh]") {
  // 30 remeshes: less than one fine event, of some 480 per metre; sharp folds, as dog-ears in P14, one in ten remeshes.
  for (const sheets::NamedShape& shape : sheets::shape_zoo()) {
    for (const std::size_t triangles : {183, 446, 1333}) {
      for (const bool with_material : {true, false}) {
        std::vector<Meshed> cycle;
        for (std::uint64_t seed = 0; seed < 8; ++seed) {
          auto mesh = sheets::make_rectangle(MeshKind::kDelaunay, shape.width_m, shape.height_m,
                                             triangles * (85 + 4 * (seed * 5 % 8)) / 100, seed);
          auto topology = test::topology_of(mesh, with_material);
          cycle.push_back({std::move(mesh), std::move(topology)});
        }
        const Fed fed = feed(
            cycle, [&](double) { return test::map_of(*shape.shape); }, 0.5, 60);
        CAPTURE(shape.name, triangles, with_material);
        const bool sharp = std::string_view(shape.name) == "dogear" || std::string_view(shape.name) == "folded";
        CHECK(fed.change_m < (sharp ? 3.0 : 1.0) / 480);
      }
    }
  }
}

TEST_CASE("bending is counted across remeshes at every frame, with and without material coordinates", "[bending][remesh]") {
  const auto way = [](double t) { return test::arc(80 * ramp(t, 0.5)); };
  for (const std::size_t triangles : {446, 1333}) {
    for (const bool with_material : {true, false}) {
      std::vector<Meshed> cycle;
      for (std::uint64_t seed = 0; seed < 8; ++seed) cycle.push_back(meshed(triangles, seed, with_material));
      CAPTURE(triangles, with_material);
      const Fed fed = feed(cycle, way, 0.8, 60);
      CHECK(fed.change_m > 0.5 * 30 * kArea_m2);
      CHECK(fed.change_m < (with_material ? 1.1 : 1.3) * 30 * kArea_m2);
      CHECK(fed.unidentified == (with_material ? 0 : 46));  // known from the third in a row
    }
  }
}

TEST_CASE("after a cut in time the sheet is taken as it is", "[bending]") {
  const Meshed sheet = meshed(446);
  analysis::SheetAnalyzer analyzer(1, {});
  std::uint64_t next_id = 1;
  REQUIRE(analyzer.analyze(test::frame_of(sheet.mesh, sheet.topology, test::arc(0), 0), {}, next_id).bending.empty());
  auto frame = test::frame_of(sheet.mesh, sheet.topology, test::arc(80), 0.02);
  frame.reset_history = true;
  CHECK(analyzer.analyze(frame, {}, next_id).bending.empty());
}

}  // namespace bending_activity_test
