#include <catch2/catch.hpp>

#include "sound_db/dsp/filter.h"
#include "sound_db/dsp/level.h"
#include "sound_db/generate/crumpling_unit.h"
#include "tests/unit/generate/measures.h"

namespace crumpling_units_test {

using namespace rustle;
using namespace rustle::generate;
using pack::GridPoint;

namespace {

/// Mean over the variants at a point of what `measure` says of a unit.
template <class Measure>
double of_variants(const pack::SoundPack& pack, const GridPoint& point, const Measure& measure) {
  std::vector<double> values;
  for (const auto v : pack::nearest_variants(*pack.crumpling, point))
    values.push_back(measure(pack.crumpling->units[v].samples));
  return mean(values);
}

double unit_centroid_hz(std::span<const float> unit) {
  return dsp::spectral_centroid_hz(dsp::mean_magnitude(unit, 1024, 256), kRate_hz);
}

std::vector<double> mean_histogram(const pack::SoundPack& pack, const GridPoint& point) {
  std::vector<double> sum(256, 0.0);
  const auto variants = pack::nearest_variants(*pack.crumpling, point);
  for (const auto v : variants) {
    const auto one = dsp::spectrum_histogram(dsp::mean_magnitude(pack.crumpling->units[v].samples, 1024, 256));
    for (std::size_t k = 0; k < sum.size(); ++k) sum[k] += one[k] / static_cast<double>(variants.size());
  }
  return sum;
}

}  // namespace

TEST_CASE("units last 200-800 ms, clacs a few; finite, quiet at both ends, no two alike") {
  for (const auto& pack : packs()) {
    std::vector<std::vector<float>> seen;
    for (const pack::Unit& unit : pack.crumpling->units) {
      INFO(pack.material << " " << unit.file);
      const double seconds = static_cast<double>(unit.samples.size()) / kRate_hz;
      CHECK((unit.point.constrained() ? seconds <= 0.05 : (seconds >= 0.2 && seconds <= 0.8)));
      const double peak = dsp::peak(unit.samples);
      REQUIRE(std::isfinite(peak));
      CHECK(peak < 0.9);
      CHECK(std::abs(unit.samples.front()) < 0.02 * peak);
      CHECK(std::abs(unit.samples.back()) < 0.001 * peak);
      seen.emplace_back(unit.samples.begin(), unit.samples.begin() + 960);
    }
    std::sort(seen.begin(), seen.end());
    CHECK(std::adjacent_find(seen.begin(), seen.end()) == seen.end());
  }
}

TEST_CASE("a flap rustles from its first milliseconds on, and snaps when the sheet has arrived, 3-25 ms later") {
  for (const auto& pack : packs()) {
    const Paper& paper = *find_paper(pack.material);
    for (const pack::Unit& unit : pack.crumpling->units) {
      if (unit.point.constrained()) continue;
      INFO(pack.material << " " << unit.file);
      const double way_s = flap_way_s(paper, unit.point), peak = dsp::peak(unit.samples);
      CHECK((way_s >= 0.003 && way_s <= 0.025));
      const auto loudest = std::max_element(unit.samples.begin(), unit.samples.end(),
                                            [](float a, float b) { return std::abs(a) < std::abs(b); });
      const double snap_s = static_cast<double>(loudest - unit.samples.begin()) / kRate_hz;
      CHECK(snap_s > way_s - 0.0001);
      CHECK(snap_s < way_s + 0.012);
      const std::span<const float> all = unit.samples, way = all.first(static_cast<std::size_t>(way_s * kRate_hz) - 1);
      CHECK(dsp::peak(way) < 0.4 * peak);
      CHECK(dsp::rms(way) > 0.002 * peak);
      CHECK(dsp::peak(all.first(144)) > 0.001 * peak);
      CHECK(dsp::rms(all.subspan(4800, 2400)) > 0.001 * peak);
    }
  }
  // A stiffer sheet and a smaller one are there sooner.
  CHECK(flap_way_s(printer(), {0.1, 0.1}) < flap_way_s(printer(), {0.1, 0.2}));
  CHECK(flap_way_s(*find_paper("banknote"), {0.1, 0.14}) < flap_way_s(*find_paper("tracing-paper"), {0.1, 0.14}));
}

TEST_CASE("flaps fall 30 dB below their loudest 5 ms after 80-600 ms; clacs have T60 under 20 ms") {
  for (const auto& pack : packs()) {
    for (const pack::Unit& unit : pack.crumpling->units) {
      INFO(pack.material << " " << unit.file);
      if (unit.point.constrained()) {
        CHECK(t60_s(unit.samples) < 0.020);
      } else {
        const double decay_s = decay30_s(unit.samples);
        CHECK((decay_s >= 0.080 && decay_s <= 0.600));
      }
    }
  }
}

TEST_CASE("a single blow decays in every band with T60 = 2.2 / (loss factor x frequency)") {
  Workspace workspace;
  for (const Paper& paper : papers()) {
    std::vector<std::vector<float>> blows;
    for (std::uint64_t i = 0; i < 16; ++i) {
      dsp::Random random(dsp::hash(11, i));
      blows.push_back(blow({}, paper, {}, 36000, kRate_hz, random, workspace));
    }
    for (const double f : {150.0, 300.0, 600.0, 1200.0, 2400.0, 4800.0, 9600.0}) {
      // Steep: lower bands ring longer.
      const auto above = dsp::butterworth_highpass(6, f / 1.15, kRate_hz),
                 below = dsp::butterworth_lowpass(6, f * 1.15, kRate_hz);
      std::vector<double> power(blows.front().size(), 0.0);
      for (std::vector<float> heard : blows) {
        dsp::CascadeState above_state, below_state;
        dsp::filter(above, above_state, heard);
        dsp::filter(below, below_state, heard);
        for (std::size_t n = 0; n < power.size(); ++n) power[n] += static_cast<double>(heard[n]) * heard[n];
      }
      INFO(paper.name << " at " << f << " Hz");
      CHECK(schroeder_t60_s(power) == Approx(2.2 / (paper.loss_factor * f)).epsilon(0.25));
    }
  }
}

TEST_CASE("a flap's centroid falls with l_r and with l_c, each step of the grid ten times the scatter of the variants") {
  const pack::SoundPack& pack = packs().front();
  const auto grid = full_grid();
  std::vector<double> centroids_hz;
  double scatter = 0, least_step = 1;
  for (const GridPoint& point : grid) {
    centroids_hz.push_back(of_variants(pack, point, unit_centroid_hz));
    CHECK(centroids_hz.back() == Approx(flap_centroid_hz(printer(), point)).epsilon(0.01));
    for (const auto v : pack::nearest_variants(*pack.crumpling, point)) {
      const double off = unit_centroid_hz(pack.crumpling->units[v].samples) / centroids_hz.back() - 1;
      scatter = std::max(scatter, std::abs(off));
    }
  }
  for (std::size_t i = 0; i < 81; ++i) {
    if (i % 9 < 8) least_step = std::min(least_step, 1 - centroids_hz[i + 1] / centroids_hz[i]);
    if (i < 72) least_step = std::min(least_step, 1 - centroids_hz[i + 9] / centroids_hz[i]);
  }
  INFO("least step " << 100 * least_step << " %, scatter " << 100 * scatter << " %");
  CHECK(least_step > 0.012);
  CHECK(least_step > 10 * scatter);
}

TEST_CASE("flaps of the three materials differ by more than variants of one") {
  const auto distance = [](std::size_t a, std::size_t b, const GridPoint& point) {
    return dsp::quadratic_form_distance(mean_histogram(packs()[a], point), mean_histogram(packs()[b], point));
  };
  std::vector<double> between_variants, printer_tracing, printer_banknote, tracing_banknote;
  std::array<std::vector<double>, 3> centroids_hz, crackles;
  for (const auto& unit : packs()[1].crumpling->units) {
    const GridPoint& point = unit.point;
    if (point.constrained()) continue;
    printer_tracing.push_back(distance(0, 1, point));
    printer_banknote.push_back(distance(0, 2, point));
    tracing_banknote.push_back(distance(1, 2, point));
    for (std::size_t m = 0; m < 3; ++m) {
      const auto variants = pack::nearest_variants(*packs()[m].crumpling, point);
      const auto& units = packs()[m].crumpling->units;
      // A third of it: the distances above are between means of three.
      between_variants.push_back(dsp::spectrum_distance(units[variants[0]].samples, units[variants[1]].samples) /
                                 std::sqrt(3));
      centroids_hz[m].push_back(of_variants(packs()[m], point, unit_centroid_hz));
      crackles[m].push_back(of_variants(packs()[m], point, [](std::span<const float> u) { return 1.0 * onsets(u); }));
    }
  }
  const double floor = median(between_variants);
  INFO("variants " << floor << ", printer to tracing " << median(printer_tracing) << ", to banknote "
                   << median(printer_banknote) << ", tracing to banknote " << median(tracing_banknote));
  CHECK(median(printer_tracing) > 2 * floor);
  CHECK(median(printer_banknote) > 2 * floor);
  CHECK(median(tracing_banknote) > 4 * floor);
  for (const auto* distances : {&printer_tracing, &printer_banknote, &tracing_banknote}) {
    CHECK(*std::min_element(distances->begin(), distances->end()) > floor);
  }
  for (std::size_t i = 0; i < centroids_hz[0].size(); ++i) {
    CHECK(centroids_hz[1][i] > 1.02 * centroids_hz[0][i]);
    CHECK(centroids_hz[2][i] < 0.98 * centroids_hz[0][i]);
  }
  INFO("onsets " << mean(crackles[0]) << " " << mean(crackles[1]) << " " << mean(crackles[2]));
  CHECK(mean(crackles[1]) > 1.1 * mean(crackles[0]));
  CHECK(mean(crackles[2]) < mean(crackles[0]));
}

TEST_CASE("clacs vary in brightness and level, tracing paper's are the brightest and banknotes' the dullest") {
  std::array<double, 3> means{};
  for (std::size_t m = 0; m < 3; ++m) {
    std::vector<double> centroids, peaks_db;
    for (const auto v : pack::nearest_variants(*packs()[m].crumpling, {})) {
      centroids.push_back(centroid_hz(packs()[m].crumpling->units[v].samples));
      peaks_db.push_back(dsp::peak_dbfs(packs()[m].crumpling->units[v].samples));
    }
    CHECK(centroids.size() == 16);
    const auto [dullest, brightest] = std::minmax_element(centroids.begin(), centroids.end());
    CHECK(*brightest > 1.2 * *dullest);
    const auto [quietest, loudest] = std::minmax_element(peaks_db.begin(), peaks_db.end());
    CHECK((*loudest - *quietest > 5 && *loudest - *quietest <= 12.001));
    CHECK(mean(peaks_db) == Approx(-31).margin(2));
    means[m] = mean(centroids);
  }
  CHECK(means[1] > 1.1 * means[0]);
  CHECK(means[2] < 0.93 * means[0]);
}

}  // namespace crumpling_units_test
