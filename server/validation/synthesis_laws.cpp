#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <complex>
#include <numbers>

#include "server/validation/groups.h"
#include "server/validation/measures.h"
#include "server/validation/stage.h"
#include "sound_db/dsp/level.h"
#include "sound_db/dsp/random.h"

namespace rustle::validation {
namespace {

constexpr int kFft = 1024;
constexpr std::size_t kHop = kFft / 2;
constexpr int kGeometries = 100;
constexpr double kNoise_s = 20;
constexpr std::array<int, 5> kCounts = {1, 2, 4, 8, 16};

std::vector<float> white() {
  return std::vector<float>(kFft / 2 + 1, static_cast<float>(dsp::db_to_gain(-32)));
}

/// Depth in dB, peak to peak, of the power's component at the hop rate.
double ripple_db(std::span<const float> samples) {
  std::complex<double> fundamental = 0;
  double power = 0;
  for (std::size_t n = 10 * kHop; n < samples.size() / kHop * kHop; ++n) {
    const double square = static_cast<double>(samples[n]) * samples[n];
    power += square;
    fundamental += square * std::polar(1.0, 2 * std::numbers::pi * static_cast<double>(n % kHop) / kHop);
  }
  const double depth = 2 * std::abs(fundamental) / power;
  return 10 * std::log10((1 + depth) / (1 - depth));
}

double sliding_db(int sources, synthesis::Mode mode) {
  Stage stage(make_stage_pack(white(), {1.0F}), mode, above());
  stage.slide(std::vector<observation::Resonator>(static_cast<std::size_t>(sources), stage_resonator()), kNoise_s + 1);
  stage.hand_over();
  const auto samples = stage.run(static_cast<synthesis::SampleTime>(kNoise_s * kRate_hz));
  return dsp::rms_dbfs(std::span(samples).subspan(4800));
}

struct Agreement {
  double delay_ms = 0;
  double worst_db = 0;  ///< over the bands that are at least four bins wide and within 20 dB of the loudest
};

/// White noise by eq. 6 beside the impulse response by eq. 5, above a table.
Agreement agreement(std::uint64_t seed) {
  constexpr int kSize = 4096;
  dsp::Random random(dsp::hash(seed, 6));
  const double height_m = std::pow(10, random.uniform(-2, 0.3));
  const sheet::Vec3d normal = sheet::Vec3d(random.normal(), random.normal(), random.normal()).normalized();
  const auto resonator = stage_resonator({0, 0, height_m}, normal);
  spatial::Listener listener = above();
  listener.position_m = {random.uniform(-2, 2), random.uniform(-2, 2), random.uniform(0.05, 2)};
  const synthesis::IdentifiedPlane plane{1, {}};
  const auto pack = make_stage_pack(std::vector<float>(kFft / 2 + 1, 0.1F), {1.0F});
  Stage noise(pack, synthesis::Mode::kCorrected, listener, seed), impulse(pack, synthesis::Mode::kCorrected, listener, seed);
  for (Stage* stage : {&noise, &impulse}) stage->planner().planes(std::span(&plane, 1), 0, 0, stage->cues());
  noise.slide({resonator}, kNoise_s + 1);
  impulse.flap(resonator, 0.1);
  noise.hand_over();
  impulse.hand_over();
  const auto heard = noise.run(static_cast<synthesis::SampleTime>(kNoise_s * kRate_hz));
  const auto by_eq6 = power_density(std::span(heard).subspan(9600), kSize);
  const auto response = impulse.run(kRate_hz / 2);
  // The response is short: its spectrum as it stands, without a window.
  std::vector<double> by_eq5(by_eq6.size(), 0.0);
  const auto first = std::find_if(response.begin(), response.end(), [](float x) { return x != 0; });
  for (std::size_t k = 0; k < by_eq5.size(); ++k) {
    std::complex<double> sum = 0;
    for (auto at = first; at != response.end(); ++at) {
      if (*at == 0) continue;
      sum += static_cast<double>(*at) *
             std::polar(1.0, -2 * std::numbers::pi * static_cast<double>(k) * static_cast<double>(at - first) / kSize);
    }
    by_eq5[k] = 0.01 * std::norm(sum);
  }
  Agreement result;
  const double distance_m = spatial::norm(listener.position_m - spatial::Vec3{0, 0, height_m});
  result.delay_ms = (spatial::norm(listener.position_m - spatial::Vec3{0, 0, -height_m}) - distance_m) / 0.343;
  const double bin_hz = static_cast<double>(kRate_hz) / kFft;
  std::vector<double> difference_db, level_db;
  for (double centre = 500; centre < 12000; centre *= std::cbrt(2.0)) {
    const double low = centre * std::pow(2, -1.0 / 6), high = centre * std::pow(2, 1.0 / 6);
    if (high - low < 4 * bin_hz) continue;
    const double a = band_power(by_eq6, low, high), b = band_power(by_eq5, low, high);
    difference_db.push_back(10 * std::log10(a / b));
    level_db.push_back(10 * std::log10(b));
  }
  const double loudest = *std::max_element(level_db.begin(), level_db.end());
  for (std::size_t k = 0; k < level_db.size(); ++k) {
    if (level_db[k] > loudest - 20) result.worst_db = std::max(result.worst_db, std::abs(difference_db[k]));
  }
  return result;
}

}  // namespace

Findings synthesis_laws(const Setting& setting) {
  std::array<double, 2> ripples_db{};
  std::array<double, kCounts.size()> corrected_db{}, published_db{};
  std::vector<Agreement> agreements(kGeometries);
  const std::size_t levels = ripples_db.size() + 2 * kCounts.size();
  run_all(setting, levels + agreements.size(), [&](std::size_t k) {
    if (k < ripples_db.size()) {
      const auto mode = k == 0 ? synthesis::Mode::kCorrected : synthesis::Mode::kPublished;
      Stage stage(make_stage_pack(white(), {1.0F}), mode, above());
      stage.slide({stage_resonator()}, 2 * kNoise_s + 1);
      stage.hand_over();
      ripples_db[k] = ripple_db(stage.run(static_cast<synthesis::SampleTime>(2 * kNoise_s * kRate_hz)));
    } else if (k < levels) {
      const std::size_t which = (k - ripples_db.size()) / 2;
      const bool printed = (k - ripples_db.size()) % 2 == 1;
      (printed ? published_db : corrected_db)[which] =
          sliding_db(kCounts[which], printed ? synthesis::Mode::kPublished : synthesis::Mode::kCorrected);
    } else {
      agreements[k - levels] = agreement(setting.seed + k - levels);
    }
  });

  Findings found;
  found.checks.push_back({"synthesis/hop_ripple", ripples_db[0], std::nullopt, at_most(0.3, "dB"), "dB",
                          "peak to peak of the level at the hop rate", ripples_db[1]});
  found.checks.push_back({"synthesis/eight_sources", corrected_db[3] - corrected_db[0], std::nullopt, around(9, 0.3, "dB"),
                          "dB", "eight equal friction sources over one: powers add", published_db[3] - published_db[0]});
  double worst_db = 0;
  report::PlotSeries points{"a geometry", {}, report::Ink::kFriction, report::PlotSeries::Style::kDots};
  for (const Agreement& one : agreements) {
    worst_db = std::max(worst_db, one.worst_db);
    points.points.push_back({one.delay_ms, one.worst_db});
  }
  found.checks.push_back(
      {"synthesis/eq5_eq6", worst_db, std::nullopt, at_most(0.5, "dB"), "dB",
       fmt::format("greatest difference between friction by eq. 6 and crumpling by eq. 5 in third octaves at "
                   "least four bins wide, within 20 dB of the loudest, over {} random geometries",
                   kGeometries)});

  report::Plot adding;
  adding.x = {"equal sources", true, 0.9, 18, {{1, "1"}, {2, "2"}, {4, "4"}, {8, "8"}, {16, "16"}}};
  adding.y = {"level over one (dB)", false, 0, 26, {}};
  report::PlotSeries mine{"ours", {}, report::Ink::kCrumpling, report::PlotSeries::Style::kDots};
  report::PlotSeries printed{"one phase for all, as printed", {}, report::Ink::kMuted, report::PlotSeries::Style::kCrosses};
  report::PlotSeries law{"10 log N", {}, report::Ink::kFriction, report::PlotSeries::Style::kDashed};
  for (std::size_t k = 0; k < kCounts.size(); ++k) {
    const double count = kCounts[k];
    mine.points.push_back({count, corrected_db[k] - corrected_db[0]});
    printed.points.push_back({count, published_db[k] - published_db[0]});
    law.points.push_back({count, 10 * std::log10(count)});
  }
  adding.series = {law, printed, mine};
  found.figures.push_back(
      {"Powers of friction sources add", "White sources of equal level at one place, 20 s each.", adding});

  report::Plot eq;
  eq.x = {"delay of the image (ms)", true, 0, 0, {}};
  eq.y = {"greatest difference (dB)", false, 0, 0.75, {}};
  eq.series = {points};
  eq.bands = {{0, kUnbounded, 0, 0.5, {report::Ink::kLevel, 0.14}}};
  found.figures.push_back(
      {"Eq. 6 beside eq. 5",
       "White noise spatialized in frequency beside an impulse spatialized in time: random heights above a "
       "table, normals and listeners. Shaded: the bound.",
       eq});
  return found;
}

}  // namespace rustle::validation
