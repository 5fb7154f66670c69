#include <catch2/catch.hpp>
#include <cmath>

#include "sound_db/dsp/level.h"
#include "sound_db/generate/friction_spectrum.h"
#include "sound_db/generate/generate.h"
#include "sound_db/pack/check.h"
#include "sound_db/pack/emission.h"
#include "sound_db/pack/levels.h"
#include "sound_db/pack/load.h"
#include "sound_db/pack/query.h"
#include "tests/unit/generate/measures.h"
#include "tests/unit/pack/example_pack.h"

namespace test_generate {

using namespace rustle;
using namespace rustle::generate;

namespace {

Options few_points() {
  Options options;
  options.grid = {{0.05, 0.10}, {0.10, 0.20}, {0.10, 0.25}, {0.20, 0.40}};
  options.clacs = 4;
  return options;
}

}  // namespace

TEST_CASE("the same bits whatever the number of threads, and whatever else is generated") {
  Options one = few_points(), two = few_points(), fewer = few_points();
  one.threads = 1;
  two.threads = 2;
  fewer.grid = {{0.10, 0.20}};
  const auto a = make_pack(printer(), one), b = make_pack(printer(), two), c = make_pack(printer(), fewer);
  REQUIRE(a.crumpling->units.size() == 16);
  for (std::size_t i = 0; i < a.crumpling->units.size(); ++i) {
    REQUIRE(a.crumpling->units[i].samples == b.crumpling->units[i].samples);
  }
  for (std::size_t i = 0; i < a.friction->spectra.size(); ++i) {
    REQUIRE(a.friction->spectra[i].magnitudes == b.friction->spectra[i].magnitudes);
  }
  const auto i = pack::nearest_variants(*a.crumpling, {0.1, 0.2}), k = pack::nearest_variants(*c.crumpling, {0.1, 0.2});
  for (std::size_t v = 0; v < 3; ++v) CHECK(a.crumpling->units[i[v]].samples == c.crumpling->units[k[v]].samples);
  two.seed = 2;
  CHECK(make_pack(printer(), two).crumpling->units[0].samples != a.crumpling->units[0].samples);
}

TEST_CASE("the reference events have their levels, for every material and with or without them in the grid") {
  for (const Paper& paper : papers()) {
    const auto made = make_pack(paper, few_points());
    CHECK(*pack::reference_flap_peak_dbfs(*made.crumpling) == Approx(-20).margin(0.01));
    CHECK(*pack::reference_friction_dbfs(*made.friction) == Approx(-32).margin(0.01));
    // By the definition: each of the three variants as played at 1 m on the axis, and ten seconds of sliding.
    const auto variants = pack::nearest_variants(*made.crumpling, {0.1, 0.2});
    REQUIRE(variants.size() == 3);
    for (const auto v : variants) CHECK(dsp::peak_dbfs(made.crumpling->units[v].samples) == Approx(-20).margin(0.05));
    const pack::FrictionSection& friction = *made.friction;
    const auto emission = pack::emission_spectrum(friction, *pack::nearest_spectrum(friction, {0.1, 0.2}), 513, 48000);
    CHECK(dsp::rms_dbfs(friction_noise(emission, 10, friction, dsp::Random(5))) == Approx(-32).margin(0.5));
    Options other = few_points();
    other.grid = {{0.05, 0.10}};
    const auto without = make_pack(paper, other);
    CHECK(without.friction->spectra[1].magnitudes == made.friction->spectra[1].magnitudes);
  }
}

TEST_CASE("modes of a strip: bending alone when long and straight, higher when curved") {
  const auto flat = strip_modes_hz(printer(), 1.0, 0.1, 1e-6, 2000), curved = strip_modes_hz(printer(), 1.0, 0.1, 0.1, 2000);
  // kx = 0, ky = π / edge: the curvature plays no part, the moved air does.
  const double ky = std::numbers::pi / 0.1;
  const double expected = std::sqrt(4e-4 * std::pow(ky, 4) / (0.080 + 2 * 1.2 / ky)) / (2 * std::numbers::pi);
  CHECK(flat.front() == Approx(expected).epsilon(1e-6));
  CHECK(curved.front() == Approx(expected).epsilon(1e-6));
  CHECK(curved.size() < flat.size());
}

TEST_CASE("a generated pack is written, passes its check and loads") {
  const pack::TemporaryFolder folder;
  const auto path = folder.path() / "banknote";
  double last = 0;
  bool rising = true;
  const auto written = write_pack("banknote", path, [&](double part) {
    rising = rising && part >= last;
    last = part;
  });
  REQUIRE(written);
  CHECK(rising);
  CHECK(last == Approx(1));
  for (const pack::Finding& finding : pack::check(path)) FAIL_CHECK(finding.what.text());
  const auto loaded = pack::load(path, 48000);
  REQUIRE(loaded);
  CHECK((*loaded)->crumpling->units.size() == 81 * 3 + 16);
  CHECK((*loaded)->friction->spectra.size() == 82);
  CHECK(*pack::reference_flap_peak_dbfs(*(*loaded)->crumpling) == Approx(-20).margin(0.05));
  const auto unknown = write_pack("granite", path);
  REQUIRE_FALSE(unknown);
  CHECK(unknown.error().text().find("printer-paper") != std::string::npos);
}

}  // namespace test_generate
