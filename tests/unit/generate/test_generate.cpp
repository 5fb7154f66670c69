#include <catch2/catch.hpp>
#include <cmath>
#include <map>

#include "sound_db/dsp/level.h"
#include "sound_db/dsp/statistics.h"
#include "sound_db/generate/crumpling_unit.h"
#include "sound_db/generate/friction_spectrum.h"
#include "sound_db/generate/generate.h"
#include "sound_db/pack/bent_strip.h"
#include "sound_db/pack/check.h"
#include "sound_db/pack/emission.h"
#include "sound_db/pack/levels.h"
#include "sound_db/pack/load.h"
#include "sound_db/pack/query.h"
#include "sound_db/pack/spectra.h"
#include "tests/unit/pack/example_pack.h"

using namespace rustle;
using namespace rustle::generate;
using pack::GridPoint;

namespace {

const Paper& printer() {
  return *find_paper("printer-paper");
}

Options few_points() {
  Options options;
  options.grid = {{0.05, 0.10}, {0.10, 0.20}, {0.10, 0.25}, {0.20, 0.40}};
  options.clacs = 4;
  return options;
}

/// Mean over four variants of a flap's centroid.
double flap_centroid_hz(const Paper& paper, const GridPoint& point) {
  Workspace workspace;
  double sum = 0;
  for (std::uint64_t i = 0; i < 4; ++i) {
    const auto unit = flap(paper, point, 48000, dsp::Random(dsp::hash(3, i)), workspace);
    sum += dsp::spectral_centroid_hz(dsp::mean_magnitude(unit, 1024, 256), 48000) / 4;
  }
  return sum;
}

/// S = h [ (1 + (f/f_c)²)^-1 + 0.05 ], f_c = 6500 (l_r / 0.1)^-0.75 [(1 + (l_c / 0.2)²) / 2]^-0.55 Hz, h a high-pass at 250
/// Hz.
std::vector<float> bandless(const GridPoint& point) {
  const double border = point.free_border_length_m / 0.2;
  const double corner_hz = 6500 * std::pow(point.ruling_length_m / 0.1, -0.75) * std::pow((1 + border * border) / 2, -0.55);
  std::vector<float> magnitudes{0};
  for (int k = 1; k <= 512; ++k) {
    const double f = 46.875 * k, low = 250 / f, high = f / corner_hz;
    magnitudes.push_back(static_cast<float>((1 / (1 + high * high) + 0.05) / std::sqrt(1 + low * low)));
  }
  return magnitudes;
}

std::vector<double> frequencies_hz() {
  std::vector<double> result;
  for (int k = 0; k <= 512; ++k) result.push_back(46.875 * k);
  return result;
}

/// Histogram of a bent sheet's friction heard 1 m away, 30° above its table, from the pack's spectrum for `stored`.
std::vector<double> played(const pack::FrictionSection& section, const GridPoint& sheet, double compression = 0.30) {
  const auto emission = pack::emission_spectrum(section, *pack::nearest_spectrum(section, sheet), 513, 48000);
  const auto strip = pack::bent_strip(sheet.free_border_length_m / 2, compression);
  const pack::DipoleOverPlane dipole{strip.mean_height_m, strip.height_spread_m, 1.0, 30.0};
  std::vector<float> heard;
  const auto f = frequencies_hz();
  for (std::size_t k = 0; k < f.size(); ++k)
    heard.push_back(static_cast<float>(emission[k] * pack::transfer_magnitude(dipole, f[k])));
  return dsp::spectrum_histogram(heard);
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
    // By the definition: peaks of the three variants as played at 1 m on the axis.
    double peak_db = 0;
    const auto variants = pack::nearest_variants(*made.crumpling, {0.1, 0.2});
    REQUIRE(variants.size() == 3);
    for (const auto v : variants) peak_db += dsp::peak_dbfs(made.crumpling->units[v].samples) / 3;
    CHECK(peak_db == Approx(-20).margin(0.01));
    Options other = few_points();
    other.grid = {{0.05, 0.10}};
    const auto without = make_pack(paper, other);
    CHECK(without.friction->spectra[1].magnitudes == made.friction->spectra[1].magnitudes);
  }
}

TEST_CASE("units last 200-800 ms, clacs a few; they are finite, quiet at both ends, and no two alike") {
  const auto made = make_pack(printer(), few_points());
  for (const pack::Unit& unit : made.crumpling->units) {
    const double seconds = static_cast<double>(unit.samples.size()) / 48000;
    CHECK((unit.point.constrained() ? seconds <= 0.05 : (seconds >= 0.2 && seconds <= 0.8)));
    const double peak = dsp::peak(unit.samples);
    REQUIRE(std::isfinite(peak));
    CHECK(peak < 0.9);
    CHECK(std::abs(unit.samples.front()) < 0.02 * peak);
    CHECK(std::abs(unit.samples.back()) < 0.001 * peak);
    for (const pack::Unit& other : made.crumpling->units) {
      if (&other != &unit) CHECK(other.samples != unit.samples);
    }
  }
}

TEST_CASE("the snap comes within 3 ms of the unit's start, and aftershocks follow") {
  Workspace workspace;
  int early = 0;
  for (std::uint64_t i = 0; i < 10; ++i) {
    const auto unit = flap(printer(), {0.1, 0.2}, 48000, dsp::Random(i), workspace);
    std::size_t onset = 0;
    while (std::abs(unit[onset]) < 0.25 * dsp::peak(unit)) ++onset;
    early += onset < 144;
    CHECK(dsp::rms_dbfs(std::span(unit).subspan(4800, 2400)) > dsp::peak_dbfs(unit) - 60);
  }
  CHECK(early >= 9);
}

TEST_CASE("a flap's centroid falls as the sheet grows, and lies among real ones") {
  double above = 1e9;
  for (const double edge_m : {0.025, 0.05, 0.10, 0.20, 0.30}) {
    const double centroid = flap_centroid_hz(printer(), {edge_m, 2 * edge_m});
    INFO(edge_m << " m: " << centroid << " Hz");
    CHECK(centroid < above);
    CHECK((centroid > 2500 && centroid < 8500));
    above = centroid;
  }
  const double reference = flap_centroid_hz(printer(), {0.1, 0.2});
  CHECK((reference > 3400 && reference < 7200));
  CHECK(flap_centroid_hz(*find_paper("tracing-paper"), {0.1, 0.2}) > reference);
  CHECK(flap_centroid_hz(*find_paper("banknote"), {0.1, 0.2}) < reference);
}

TEST_CASE("friction spectra fall in centroid with size, and every two neighbours of the grid differ") {
  const auto grid = full_grid();
  REQUIRE(grid.size() == 81);
  std::vector<std::vector<double>> histograms;
  std::vector<double> centroids_hz;
  for (const GridPoint& point : grid) {
    const auto heard = friction_heard(printer(), point, 513, 48000);
    histograms.push_back(dsp::spectrum_histogram(heard));
    centroids_hz.push_back(dsp::spectral_centroid_hz(heard, 48000));
  }
  for (std::size_t r = 0; r < 9; ++r) {
    for (std::size_t c = 0; c < 9; ++c) {
      INFO("row " << r << " column " << c);
      for (const std::size_t next : {9 * r + c + 1, 9 * (r + 1) + c}) {
        if (next >= 81 || (next == 9 * r + c + 1 && c == 8)) continue;
        CHECK(dsp::quadratic_form_distance(histograms[9 * r + c], histograms[next]) > 0.003);
        CHECK(centroids_hz[next] < 1.02 * centroids_hz[9 * r + c]);
      }
    }
  }
  // The two ends of the grid lie where the law without its bands puts them.
  for (const std::size_t end : {std::size_t{0}, std::size_t{80}}) {
    CHECK(centroids_hz[end] == Approx(dsp::spectral_centroid_hz(bandless(grid[end]), 48000)).epsilon(0.05));
  }
}

TEST_CASE("a flat sheet is 11 dB below a bent one, near white") {
  const auto flat = friction_heard(printer(), {}, 513, 48000), bent = friction_heard(printer(), {0.1, 0.2}, 513, 48000);
  const auto level_db = [](const std::vector<float>& m) {
    double power = 0;
    int count = 0;
    for (std::size_t k = 3; k < 341; ++k, ++count) power += m[k] * m[k];
    return 10 * std::log10(power / count);
  };
  CHECK(level_db(bent) - level_db(flat) == Approx(11).margin(0.2));
  CHECK(dsp::gain_to_db(flat[300] / flat[40]) > -4);
  CHECK(dsp::quadratic_form_distance(dsp::spectrum_histogram(flat), dsp::spectrum_histogram(bent)) > 0.05);
}

TEST_CASE("Table 1: distances by ruling length and by free border within 0.05 of the paper's") {
  Options options;
  options.grid = {{0.05, 0.2}, {0.1, 0.2}, {0.2, 0.2}, {0.1, 0.1}, {0.1, 0.4}};
  options.flaps = 1;
  const auto made = make_pack(printer(), options);
  const auto& section = *made.friction;
  const auto distance = [&](GridPoint a, GridPoint b) {
    return dsp::quadratic_form_distance(played(section, a), played(section, b));
  };
  CHECK(distance({0.05, 0.2}, {0.1, 0.2}) == Approx(0.10).margin(0.05));
  CHECK(distance({0.1, 0.2}, {0.2, 0.2}) == Approx(0.07).margin(0.05));
  CHECK(distance({0.05, 0.2}, {0.2, 0.2}) == Approx(0.16).margin(0.05));
  CHECK(distance({0.1, 0.1}, {0.1, 0.2}) == Approx(0.04).margin(0.05));
  CHECK(distance({0.1, 0.2}, {0.1, 0.4}) == Approx(0.12).margin(0.05));
  CHECK(distance({0.1, 0.1}, {0.1, 0.4}) == Approx(0.13).margin(0.05));
  for (const auto& [a, b] : {std::pair{0.2, 0.4}, std::pair{0.4, 0.8}, std::pair{0.2, 0.8}}) {
    const double d = dsp::quadratic_form_distance(played(section, {0.1, 0.2}, a), played(section, {0.1, 0.2}, b));
    INFO(a << " to " << b << ": " << d);
    CHECK((d > 0 && d <= 0.09));
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
  CHECK((*loaded)->crumpling->units.size() == 81 * 3 + 8);
  CHECK((*loaded)->friction->spectra.size() == 82);
  CHECK(*pack::reference_flap_peak_dbfs(*(*loaded)->crumpling) == Approx(-20).margin(0.05));
  const auto unknown = write_pack("granite", path);
  REQUIRE_FALSE(unknown);
  CHECK(unknown.error().text().find("printer-paper") != std::string::npos);
}
