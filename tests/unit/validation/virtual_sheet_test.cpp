#include "server/validation/virtual_sheet.h"

#include <algorithm>
#include <catch2/catch.hpp>
#include <cmath>

#include "sound_db/generate/generate.h"
#include "sound_db/pack/bent_strip.h"
#include "sound_db/pack/write.h"
#include "tests/unit/pack/example_pack.h"

namespace virtual_sheet_test {

using namespace rustle;
using namespace rustle::validation;

namespace {

std::vector<sheets::Point3> positions(const sheets::AnimatedSheet& sheet, double time_s) {
  std::vector<float> xyz(3 * sheet.mesh().material_coordinates.size());
  sheet.positions(time_s, xyz);
  std::vector<sheets::Point3> points;
  for (std::size_t v = 0; v < xyz.size(); v += 3) points.push_back({xyz[v], xyz[v + 1], xyz[v + 2]});
  return points;
}

double distance_m(const sheets::Point3& a, const sheets::Point3& b) {
  return std::hypot(a[0] - b[0], a[1] - b[1], a[2] - b[2]);
}

/// Greatest relative change of an edge's length against the material's.
double worst_stretch(const sheets::AnimatedSheet& sheet, double time_s) {
  const auto p = positions(sheet, time_s);
  const auto& mesh = sheet.mesh();
  double worst = 0;
  for (const auto& t : mesh.triangles) {
    for (int k = 0; k < 3; ++k) {
      const auto a = t[static_cast<std::size_t>(k)], b = t[static_cast<std::size_t>((k + 1) % 3)];
      const auto& ma = mesh.material_coordinates[a];
      const auto& mb = mesh.material_coordinates[b];
      const double rest = std::hypot(ma[0] - mb[0], ma[1] - mb[1]);
      worst = std::max(worst, std::abs(distance_m(p[a], p[b]) / rest - 1));
    }
  }
  return worst;
}

}  // namespace

TEST_CASE("Rubbed sheets stand on the table with two straight edges, keep their lengths and move at 0.1 m/s") {
  const auto check = [](const sheets::AnimatedSheet& sheet, double area_m2) {
    const auto p = positions(sheet, 0.3), later = positions(sheet, 0.3 + 1.0 / 60), back = positions(sheet, 4.3);
    double lowest = 1e9, highest = -1e9;
    int touching = 0;
    for (const auto& point : p) {
      lowest = std::min(lowest, point[2]);
      highest = std::max(highest, point[2]);
      touching += point[2] < 0.0021;
    }
    CHECK(lowest == Approx(0).margin(1e-6));
    CHECK(highest > 0.01);
    CHECK(touching > 10);
    CHECK(worst_stretch(sheet, 0.3) < 0.03);
    for (std::size_t v = 0; v < p.size(); ++v) {
      CHECK(distance_m(p[v], later[v]) * 60 == Approx(0.1).epsilon(0.001));
      CHECK(distance_m(p[v], back[v]) < 1e-6);
    }
    double area = 0;
    for (const auto& t : sheet.mesh().triangles) {
      const auto& a = sheet.mesh().material_coordinates[t[0]];
      const auto& b = sheet.mesh().material_coordinates[t[1]];
      const auto& c = sheet.mesh().material_coordinates[t[2]];
      area += 0.5 * std::abs((b[0] - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (b[1] - a[1]));
    }
    CHECK(area == Approx(area_m2).epsilon(0.001));
  };
  check(*make_rubbed(RubbedSheet{}, 5), 0.01);
  check(*make_rubbed(RubbedSheet{0.10, 0.20, 0.80, 1500}, 5), 0.02);
  check(*make_rubbed(Trapezoid::kCurvedBases, 5), 0.01);
  check(*make_rubbed(Trapezoid::kStraightBases, 5), 0.01);
}

TEST_CASE("Flapped sheets turn over at the times they say, as often as asked") {
  FlappedSheet options;
  options.reversals = 3;
  const auto sheet = make_flapped(options);
  const auto rise = [&](double time_s) {
    const auto p = positions(*sheet, time_s);
    double low = 1e9, high = -1e9;
    for (const auto& point : p) {
      low = std::min(low, point[2]);
      high = std::max(high, point[2]);
    }
    return high - low;
  };
  const double bent_m = pack::bent_strip(0.10, 0.10).rise_m;
  CHECK(rise(0) == Approx(bent_m).epsilon(0.01));
  for (int k = 0; k < 3; ++k) {
    CHECK(rise(options.zero_s(k)) < 0.01 * bent_m);
    CHECK(rise(options.zero_s(k) + 0.1) == Approx(bent_m).epsilon(0.01));
  }
}

TEST_CASE("What is played is what the pipeline makes: one event per reversal, the same again, silence for a sheet at rest") {
  const pack::TemporaryFolder folder;
  generate::Options few;
  few.grid = {{0.10, 0.20}};
  few.flaps = 1;
  few.clacs = 1;
  REQUIRE(pack::write(generate::make_pack(*generate::find_paper("printer-paper"), few), folder.path() / "printer-paper"));
  Setting setting;
  setting.packs = std::make_shared<pack::PackLibrary>(std::vector<std::filesystem::path>{folder.path()});

  FlappedSheet options;
  options.reversals = 2;
  options.triangles = 300;
  const auto sheet = make_flapped(options);
  Take take;
  take.sheet = sheet.get();
  take.frame_rate_hz = 120;
  const Heard once = play(setting, take), again = play(setting, take);
  CHECK(once.samples == again.samples);
  int started = 0;
  for (const auto& event : once.crumpling()) started += event.continues == 0;
  CHECK(started == 2);
  CHECK(once.between(0.0, 0.2) == std::vector<float>(9600, 0.0F));
  const auto sounding = once.between(0.3, 0.5);
  CHECK(std::any_of(sounding.begin(), sounding.end(), [](float x) { return std::abs(x) > 0.001F; }));

  const auto flat = make_rubbed(RubbedSheet{0.1, 0.1, 0, 300}, 0.5);
  take.sheet = flat.get();
  take.obstacles = {};
  const Heard free = play(setting, take);
  CHECK(std::all_of(free.samples.begin(), free.samples.end(), [](float x) { return x == 0; }));
  take.obstacles = {table()};
  const Heard touching = play(setting, take);
  CHECK(std::any_of(touching.samples.begin(), touching.samples.end(), [](float x) { return x != 0; }));
}

}  // namespace virtual_sheet_test
