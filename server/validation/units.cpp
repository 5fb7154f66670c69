#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "server/validation/groups.h"
#include "server/validation/measures.h"
#include "sound_db/generate/paper.h"
#include "sound_db/generate/sheet_response.h"

namespace rustle::validation {
namespace {

constexpr int kHits = 12;

struct BandDecay {
  double centre_hz = 0, t60_s = 0;
};

/// Median decays of single hits on a paper, in octaves' thirds.
std::vector<BandDecay> hit_decays(const generate::Paper& paper, std::uint64_t seed) {
  std::vector<std::vector<float>> hits;
  generate::Workspace workspace;
  for (int k = 0; k < kHits; ++k) {
    dsp::Random random(dsp::hash(seed, 3, static_cast<std::uint64_t>(k)));
    hits.push_back(generate::blow({}, paper, {}, static_cast<std::size_t>(0.8 * kRate_hz), kRate_hz, random, workspace));
  }
  std::vector<BandDecay> decays;
  for (double centre = 250; centre < 9000; centre *= std::sqrt(2.0)) {
    // The line through a band's decay needs several decay times of several reflections of noise: the mean of many hits.
    double sum = 0;
    int count = 0;
    for (const auto& hit : hits) {
      const double t60 = band_t60_s(hit, centre / 1.12, centre * 1.12);
      if (!std::isfinite(t60)) continue;
      sum += t60;
      ++count;
    }
    decays.push_back({centre, count > 0 ? sum / count : std::numeric_limits<double>::quiet_NaN()});
  }
  return decays;
}

}  // namespace

Findings units(const Setting& setting) {
  Findings found;
  if (!setting.pack->crumpling) return found;
  const auto& all = setting.pack->crumpling->units;
  std::vector<double> duration_s(all.size());
  run_all(setting, all.size(), [&](std::size_t k) {
    duration_s[k] = all[k].point.constrained() ? t60_s(all[k].samples) : last_within_30_db_s(all[k].samples);
  });
  double shortest = kUnbounded, longest = 0, longest_clac = 0;
  report::PlotSeries flaps{"flap: last 5 ms within 30 dB", {}, report::Ink::kCrumpling, report::PlotSeries::Style::kDots};
  report::PlotSeries clacs{"clac: T60", {}, report::Ink::kTearing, report::PlotSeries::Style::kRings};
  for (std::size_t k = 0; k < all.size(); ++k) {
    if (all[k].point.constrained()) {
      if (!(duration_s[k] <= longest_clac)) longest_clac = duration_s[k];
      clacs.points.push_back({1, 1000 * duration_s[k]});
    } else {
      shortest = std::min(shortest, duration_s[k]);
      longest = std::max(longest, duration_s[k]);
      flaps.points.push_back({100 * all[k].point.disc_radius_m(), 1000 * duration_s[k]});
    }
  }
  if (!flaps.points.empty()) {
    found.checks.push_back({"units/flap_shortest", 1000 * shortest, std::nullopt, between(80, 600, "ms"), "ms",
                            "from a flap's loudest 5 ms to its last within 30 dB, least of all flaps"});
    found.checks.push_back(
        {"units/flap_longest", 1000 * longest, std::nullopt, between(80, 600, "ms"), "ms", "the same, most of all flaps"});
  }
  if (!clacs.points.empty()) {
    found.checks.push_back(
        {"units/clac_t60", 1000 * longest_clac, std::nullopt, at_most(20, "ms"), "ms", "T60 of the clacs, the longest"});
  }
  report::Plot lengths;
  lengths.x = {"disc radius of the sheet (cm); clacs at 1", true, 0.8, 20, {}};
  lengths.y = {"time (ms)", true, 2, 1000, {}};
  lengths.series = {flaps, clacs};
  lengths.bands = {{0, kUnbounded, 80, 600, {report::Ink::kCrumpling, 0.10}},
                   {0, kUnbounded, 0, 20, {report::Ink::kTearing, 0.10}}};
  found.figures.push_back({"Long flaps, short clacs", "Every unit of the pack. Shaded: the bounds.", lengths});

  const generate::Paper* paper = setting.pack->origin == "generated" ? generate::find_paper(setting.material) : nullptr;
  if (paper == nullptr) return found;
  const auto decays = hit_decays(*paper, setting.seed);
  double worst = 0;
  report::PlotSeries measured{"single hits", {}, report::Ink::kCrumpling, report::PlotSeries::Style::kDots};
  report::PlotSeries law{"2.2 / (η f)", {}, report::Ink::kFriction, report::PlotSeries::Style::kDashed};
  report::PlotSeries low{"± 25 %", {}, report::Ink::kMuted, report::PlotSeries::Style::kDashed}, high = low;
  high.label.clear();
  for (const BandDecay& band : decays) {
    const double expected_s = 2.2 / (paper->loss_factor * band.centre_hz);
    const double off = std::abs(band.t60_s / expected_s - 1);
    worst = std::isfinite(off) ? std::max(worst, off) : kUnbounded;
    measured.points.push_back({band.centre_hz, 1000 * band.t60_s});
    law.points.push_back({band.centre_hz, 1000 * expected_s});
    low.points.push_back({band.centre_hz, 750 * expected_s});
    high.points.push_back({band.centre_hz, 1250 * expected_s});
  }
  found.checks.push_back(
      {"units/hit_decay", 100 * worst, std::nullopt, at_most(25, "%"), "%",
       fmt::format("greatest distance of a band's decay from T60 = 2.2/(η f), η = {:g}, single hits, 250 Hz to 8 kHz",
                   paper->loss_factor)});
  report::Plot plot;
  plot.x = {"frequency (Hz)", true, 200, 10000, {}};
  plot.y = {"T60 (ms)", true, 0, 0, {}};
  plot.series = {law, low, high, measured};
  found.figures.push_back({"Decay of single hits", "Bands a third of an octave wide; mean of the hits.", plot});
  return found;
}

}  // namespace rustle::validation
