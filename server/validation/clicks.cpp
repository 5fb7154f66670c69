#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "server/validation/groups.h"
#include "server/validation/stage.h"
#include "sound_db/dsp/fft.h"
#include "sound_db/dsp/random.h"
#include "sound_db/dsp/window.h"

namespace rustle::validation {
namespace {

constexpr double kClicks_s = 12;
constexpr double kTone_hz = 1000, kDoppler_hz = 150;
constexpr int kFrames_per_s = 60;

/// A smooth random walk: a few sines with random phases, within ±1.
class Wander {
 public:
  explicit Wander(std::uint64_t seed) {
    dsp::Random random(seed);
    for (auto& [rate_hz, phase_rad] : parts_) {
      rate_hz = random.log_uniform(0.1, 1.2);
      phase_rad = random.uniform(0, 2 * std::numbers::pi);
    }
  }
  double at(double time_s) const {
    double sum = 0;
    for (const auto& [rate_hz, phase_rad] : parts_) sum += std::sin(2 * std::numbers::pi * rate_hz * time_s + phase_rad) / 4;
    return sum;
  }

 private:
  std::array<std::pair<double, double>, 4> parts_;
};

std::vector<float> tone() {
  std::vector<float> unit(static_cast<std::size_t>((kClicks_s + 1) * kRate_hz));
  for (std::size_t n = 0; n < unit.size(); ++n) {
    unit[n] = 0.1F * static_cast<float>(std::sin(2 * std::numbers::pi * kTone_hz * static_cast<double>(n) / kRate_hz));
  }
  return unit;
}

std::vector<float> heard_tone(std::uint64_t seed) {
  Stage stage(make_stage_pack(std::vector<float>(513, 0.0F), tone()), synthesis::Mode::kCorrected, above());
  std::array<Wander, 6> wander = {Wander(seed),     Wander(seed + 1), Wander(seed + 2),
                                  Wander(seed + 3), Wander(seed + 4), Wander(seed + 5)};
  stage.flap(stage_resonator({0, 0, 0.25}, sheet::Vec3d(0.6, 0, 0.8)), 0);
  for (int k = 0; k <= kClicks_s * kFrames_per_s; ++k) {
    const double t = static_cast<double>(k) / kFrames_per_s;
    spatial::Listener listener = above();
    listener.position_m = {0.9 + 0.5 * wander[0].at(t), 0.6 * wander[1].at(t), 0.8 + 0.4 * wander[2].at(t)};
    listener.forward = spatial::normalized(-listener.position_m, {0, 0, -1});
    stage.planner().listener(listener, t, 0, stage.cues());
    const spatial::Vec3 normal = spatial::normalized({1, 0.2 * wander[3].at(t), 0.2 * wander[4].at(t)}, {1, 0, 0});
    const std::array<synthesis::IdentifiedPlane, 2> planes = {
        synthesis::IdentifiedPlane{1, {{0, 0, 0.1 * wander[5].at(t)}, {0, 0, 1}, 1.0}},
        synthesis::IdentifiedPlane{2, {{-0.8 + 0.4 * wander[4].at(t), 0, 0}, normal, 0.5 + 0.4 * wander[3].at(t)}}};
    stage.planner().planes(planes, t, 0, stage.cues());
    if (k % 16 == 15) stage.hand_over();
    if (k == 0) stage.hand_over();
  }
  stage.hand_over();
  return stage.run(static_cast<synthesis::SampleTime>(kClicks_s * kRate_hz));
}

/// Power away from the tone over the tone's, in the worst of blocks of 0.34 s.
double spurious_db(const std::vector<float>& heard, std::vector<report::Point>* worst_spectrum) {
  constexpr std::size_t kSize = 16384;
  dsp::RealFft fft(static_cast<int>(kSize));
  std::vector<float> window(kSize);
  dsp::hann_window(window);
  double worst_db = -300;
  for (std::size_t from = 9600; from + kSize <= heard.size(); from += kSize / 2) {
    // The square of a Hann window falls fast enough to look 60 dB and more below the tone.
    for (std::size_t n = 0; n < kSize; ++n) fft.time()[n] = window[n] * window[n] * heard[from + n];
    fft.forward();
    double inside = 0, outside = 0;
    for (std::size_t k = 0; k < fft.spectrum().size(); ++k) {
      const double f = static_cast<double>(k) * kRate_hz / static_cast<double>(kSize);
      (std::abs(f - kTone_hz) < kDoppler_hz ? inside : outside) += std::norm(fft.spectrum()[k]);
    }
    const double db = 10 * std::log10(outside / inside);
    if (db <= worst_db) continue;
    worst_db = db;
    worst_spectrum->clear();
    for (std::size_t k = 4; k < fft.spectrum().size(); k += 2) {
      const double most =
          std::max(std::norm(fft.spectrum()[k]), std::norm(fft.spectrum()[k + 1 < fft.spectrum().size() ? k + 1 : k]));
      worst_spectrum->push_back(
          {static_cast<double>(k) * kRate_hz / static_cast<double>(kSize), 10 * std::log10(most / inside + 1e-20)});
    }
  }
  return worst_db;
}

}  // namespace

Findings clicks(const Setting& setting) {
  constexpr std::size_t kRuns = 2;
  std::array<double, kRuns> runs_db{};
  std::array<std::vector<report::Point>, kRuns> spectra;
  run_all(setting, kRuns, [&](std::size_t k) { runs_db[k] = spurious_db(heard_tone(setting.seed + 100 * k), &spectra[k]); });
  const std::size_t worst = runs_db[0] > runs_db[1] ? 0 : 1;
  Findings found;
  found.checks.push_back(
      {"clicks/tone", runs_db[worst], std::nullopt, at_most(-60, "dB"), "dB",
       fmt::format("a tone of {:.0f} Hz while listener, table and a wall move at random for {:.0f} s: power more than "
                   "{:.0f} Hz away from it, in the worst third of a second",
                   kTone_hz, kClicks_s, kDoppler_hz)});
  report::Plot plot;
  plot.x = {"frequency (Hz)", true, 20, 24000, {}};
  plot.y = {"power over the tone's (dB)", false, -140, 5, {}};
  plot.series = {{"worst third of a second", spectra[worst], report::Ink::kFriction}};
  plot.bands = {{kTone_hz - kDoppler_hz, kTone_hz + kDoppler_hz, -kUnbounded, kUnbounded, {report::Ink::kLevel, 0.18}}};
  found.figures.push_back({"A tone does not click", "Shaded: the tone and its Doppler shift.", plot});
  return found;
}

}  // namespace rustle::validation
