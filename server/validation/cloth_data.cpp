#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <complex>
#include <map>
#include <numbers>

#include "server/validation/groups.h"
#include "sound_db/dsp/fft.h"
#include "sound_db/dsp/level.h"
#include "sound_db/dsp/random.h"
#include "sound_db/dsp/statistics.h"
#include "sound_db/dsp/thin_plate_spline.h"
#include "sound_db/dsp/unit_features.h"
#include "sound_db/pack/calibration.h"
#include "sound_db/pack/cloth_corpus.h"
#include "sound_db/pack/spectra.h"

namespace rustle::validation {
namespace {

constexpr std::array<std::string_view, 4> kMaterials = {"cotton", "polyester", "windbreaker", "corduroy"};
constexpr double kSweep_s = 5;

class Checks {
 public:
  explicit Checks(Findings& findings) : findings_(findings) {}
  void operator()(std::string name, double ours, Bound bound, std::string unit, std::string meaning) {
    findings_.checks.push_back(
        {"cloth_data/" + std::move(name), ours, std::nullopt, std::move(bound), std::move(unit), std::move(meaning)});
  }

 private:
  Findings& findings_;
};

/// Two bands 80 Hz wide at 1 and 3 kHz over a floor of -50 dB, at 0.2 and 0.6 m/s.
pack::FrictionSweep two_bands() {
  pack::FrictionSweep sweep;
  sweep.speeds_m_per_s = {0.2, 0.6};
  const double bin_hz = kRate_hz / static_cast<double>(sweep.fft_size);
  for (const double centre_hz : {1000.0, 3000.0}) {
    for (std::size_t k = 0; k < sweep.bins(); ++k) {
      const double z = (static_cast<double>(k) * bin_hz - centre_hz) / 80;
      sweep.magnitudes.push_back(static_cast<float>(std::exp(-0.5 * z * z) + dsp::db_to_gain(-50)));
    }
    sweep.rms.push_back(pack::noise_rms(sweep.spectrum(sweep.rms.size())));
  }
  return sweep;
}

void check_blend(Checks& check) {
  const pack::FrictionSweep sweep = two_bands();
  const pack::FrictionSpectra spectra(sweep);
  std::vector<float> magnitudes(sweep.bins());
  spectra.at(0.4, magnitudes);
  double inside = 0, all = 0;
  for (std::size_t k = 0; k < magnitudes.size(); ++k) {
    const double power = static_cast<double>(magnitudes[k]) * magnitudes[k];
    const double frequency_hz = static_cast<double>(k) * kRate_hz / sweep.fft_size;
    all += power;
    if (std::abs(frequency_hz - 2000) < 300) inside += power;
  }
  check("blend/half_way", inside / all, at_least(0.95), "",
        "share of the power within 300 Hz of half way between two bands, half way between their speeds (eqs. 1-3)");
  double worst = 0;
  for (double alpha = 0; alpha <= 1; alpha += 0.05) {
    spectra.at(0.2 + 0.4 * alpha, magnitudes);
    const double linear = (1 - alpha) * sweep.rms[0] + alpha * sweep.rms[1];
    worst = std::max(worst, std::abs(20 * std::log10(pack::noise_rms(magnitudes) / linear)));
  }
  check("blend/level", worst, at_most(0.01, "dB"), "dB", "largest difference of the level from linear in speed");
}

void check_warp(Checks& check, std::uint64_t seed) {
  constexpr int kDims = 3, kNodes = 400;
  dsp::Random random(dsp::hash(seed, 31));
  std::vector<double> nodes, targets, image(kDims);
  for (int i = 0; i < kNodes * kDims; ++i) {
    nodes.push_back(2 * random.normal() - 10);
    targets.push_back(0.8 * nodes.back() + 3 + 0.6 * std::sin(nodes.back()) + 0.2 * random.normal());
  }
  const auto exact = dsp::fit_thin_plate_spline(nodes, targets, kDims, 0);
  const auto stiff = dsp::fit_thin_plate_spline(nodes, targets, kDims, 1e12);
  double worst = 0, bending = 0;
  for (std::size_t i = 0; i < nodes.size(); i += kDims) {
    dsp::warp(exact, std::span<const double>(nodes).subspan(i, kDims), image);
    for (std::size_t d = 0; d < kDims; ++d) worst = std::max(worst, std::abs(image[d] - targets[i + d]));
    // An affine map takes the middle of two points to the middle of their images.
    const std::size_t j = nodes.size() - kDims - i;
    std::vector<double> a(kDims), b(kDims), middle(kDims), between(kDims);
    for (std::size_t d = 0; d < kDims; ++d) between[d] = (nodes[i + d] + nodes[j + d]) / 2;
    dsp::warp(stiff, std::span<const double>(nodes).subspan(i, kDims), a);
    dsp::warp(stiff, std::span<const double>(nodes).subspan(j, kDims), b);
    dsp::warp(stiff, std::span<const double>(between), middle);
    for (std::size_t d = 0; d < kDims; ++d) bending = std::max(bending, std::abs(middle[d] - (a[d] + b[d]) / 2));
  }
  check("warp/exact", worst, at_most(1e-6), "", "largest miss of 400 distinct correspondences without regularization (C4)");
  check("warp/affine", bending, at_most(1e-6), "", "largest bend of the warp with endless regularization");
}

void check_features(Checks& check, std::uint64_t seed) {
  dsp::Random random(dsp::hash(seed, 32));
  std::vector<float> quiet(48000), loud;
  for (float& x : quiet) x = static_cast<float>(0.05 * random.normal());
  loud = quiet;
  for (float& x : loud) x *= static_cast<float>(dsp::db_to_gain(5));
  const auto a = dsp::unit_features(quiet, 200, kRate_hz), b = dsp::unit_features(loud, 200, kRate_hz);
  double moved = 0;
  for (std::size_t i = 0; i < a.size(); i += dsp::kUnitFeatures) moved += b[i] - a[i];
  moved *= dsp::kUnitFeatures / static_cast<double>(a.size());
  check("features/5_db", moved, around(2, 0.01), "", "what 5 dB more move the first feature by (C3): d_max of the paper");
}

/// Centre of the strongest band, a tenth wide, of the envelope's spectrum between low_hz and high_hz.
double pulse_hz(std::span<const float> sound, double low_hz, double high_hz) {
  std::size_t size = 2;
  while (2 * size <= sound.size()) size *= 2;
  dsp::RealFft fft(static_cast<int>(size));
  double mean = 0;
  for (std::size_t n = 0; n < size; ++n) mean += std::abs(sound[n]) / static_cast<double>(size);
  for (std::size_t n = 0; n < size; ++n) {
    const double window = 0.5 - 0.5 * std::cos(2 * std::numbers::pi * static_cast<double>(n) / static_cast<double>(size));
    fft.time()[n] = static_cast<float>((std::abs(sound[n]) - mean) * window);
  }
  fft.forward();
  const double step_hz = kRate_hz / static_cast<double>(size);
  const auto moments = [&](double from_hz, double to_hz) {
    double power = 0, weighted = 0;
    for (auto k = static_cast<std::size_t>(from_hz / step_hz); k <= static_cast<std::size_t>(to_hz / step_hz); ++k) {
      const double p = std::norm(fft.spectrum()[k]);
      power += p;
      weighted += p * static_cast<double>(k) * step_hz;
    }
    return std::pair(power, weighted / power);
  };
  double best_hz = low_hz, most = 0;
  for (double f = low_hz * 1.05; f < high_hz / 1.05; f *= 1.01) {
    const double density = moments(f / 1.05, f * 1.05).first / f;
    if (density <= most) continue;
    most = density;
    best_hz = f;
  }
  return moments(best_hz / 1.15, best_hz * 1.15).second;
}

/// Friction from the slowest measured speed to the fastest, rising exponentially.
std::vector<float> sweep_sound(const pack::ClothCorpus& corpus, std::uint64_t seed) {
  const double slow = corpus.friction.speeds_m_per_s.front(), fast = corpus.friction.speeds_m_per_s.back();
  const auto speed_at = [&](double t) { return slow * std::pow(fast / slow, std::clamp(t / kSweep_s, 0.0, 1.0)); };
  return pack::plain_target(corpus, kSweep_s, speed_at, {}, seed);
}

std::vector<float> whole(const pack::ClothCorpus& corpus) {
  std::vector<float> sound;
  for (const auto& recording : corpus.recordings) {
    sound.insert(sound.end(), recording.channels[0].begin(), recording.channels[0].end());
  }
  return sound;
}

/// Steady pulses of the pack's ribs are in its corpus: of the units that move at one speed nothing is known but their pulse,
/// so that the strongest pulse of each loud stretch gives a speed, which must lie within what hands do.
void check_ribs(Checks& check, const std::string& name, const pack::ClothCorpus& corpus) {
  if (!(corpus.wale_spacing_m > 0)) return;
  std::vector<double> speeds;
  for (const auto& recording : corpus.recordings) {
    const auto& sound = recording.channels[0];
    if (sound.size() < 16384) continue;
    speeds.push_back(pulse_hz(std::span(sound).subspan(sound.size() / 2 - 8192, 16384), 40, 1500) * corpus.wale_spacing_m);
  }
  if (speeds.empty()) return;
  std::nth_element(speeds.begin(), speeds.begin() + static_cast<std::ptrdiff_t>(speeds.size() / 2), speeds.end());
  check("pulse_" + name, speeds[speeds.size() / 2], between(0.04, 1.6, "m/s"), "m/s",
        "median speed that the pulses of the corpus mean: pulse rate times wale spacing");
}

}  // namespace

Findings cloth_data(const Setting& setting) {
  Findings findings;
  Checks check(findings);
  check_blend(check);
  check_warp(check, setting.seed);
  check_features(check, setting.seed);
  std::map<std::string, std::vector<double>> spectra;
  Pictures pictures;
  pictures.rows = 2;
  for (std::size_t i = 0; i < kMaterials.size(); ++i) {
    const std::string name(kMaterials[i]);
    setting.progress(static_cast<double>(i) / kMaterials.size());
    const auto loaded = setting.packs->load(name, "", kRate_hz);
    if (!loaded || !(*loaded)->cloth) {
      findings.notices.push_back(fmt::format("There is no pack of {}: its sounds were not looked at.", name));
      continue;
    }
    const pack::ClothCorpus& corpus = *(*loaded)->cloth;
    const std::vector<float> sound = whole(corpus);
    const auto magnitudes = dsp::mean_magnitude(sound);
    spectra[name] = dsp::spectrum_histogram(magnitudes);
    const bool recorded_range = name == "cotton";
    check("centroid_" + name, dsp::spectral_centroid_hz(magnitudes, kRate_hz),
          recorded_range ? between(600, 4200, "Hz") : shown(), "Hz",
          recorded_range ? "of the corpus; recorded cloth has 0.6 to 4.2 kHz" : "of the corpus");
    const auto& sweep = corpus.friction;
    const double octaves = std::log2(sweep.speeds_m_per_s.back() / sweep.speeds_m_per_s.front());
    check("slope_" + name, 20 * std::log10(sweep.rms.back() / sweep.rms.front()) / octaves, between(3, 7, "dB"), "dB",
          "how much louder friction is at twice the speed");
    check_ribs(check, name, corpus);
    pictures.pictures.push_back(
        {fmt::format("{}, {:.2g} to {:.2g} m/s", name, sweep.speeds_m_per_s.front(), sweep.speeds_m_per_s.back()),
         sweep_sound(corpus, setting.seed), static_cast<double>(kRate_hz), 100});
  }
  for (auto a = spectra.begin(); a != spectra.end(); ++a) {
    for (auto b = std::next(a); b != spectra.end(); ++b) {
      check(fmt::format("apart_{}_{}", a->first, b->first), dsp::quadratic_form_distance(a->second, b->second),
            at_least(0.03), "", "quadratic-form distance of two materials' corpora");
    }
  }
  if (!pictures.pictures.empty()) {
    findings.figures.push_back({"Figure 3 of An et al. 2012: friction by speed",
                                "A sweep of each material's friction model, from slow to fast: bands of polyester and nylon "
                                "rise with speed, those of cotton and corduroy hardly do.",
                                std::move(pictures)});
  }
  return findings;
}

}  // namespace rustle::validation
