#include <algorithm>
#include <cmath>
#include <complex>
#include <map>
#include <numbers>
#include <utility>

#include <fmt/format.h>

#include "sound_db/build/compare.h"
#include "sound_db/dsp/fft.h"
#include "sound_db/dsp/filter.h"
#include "sound_db/dsp/level.h"
#include "sound_db/dsp/random.h"
#include "sound_db/dsp/window.h"
#include "sound_db/pack/query.h"

namespace rustle::build {

namespace {

constexpr double kSlide_s = 1.0, kCrumpling_s = 1.2;
constexpr int kCrumplings = 6;
constexpr double kShortestGap_s = 0.001, kLongestGap_s = 0.05;
constexpr double kEnergyExponent = 1.45, kLeastEnergy = 3e-3;
constexpr double kSmallFlaps = 0.06;               // part of the events
constexpr pack::GridPoint kSmallFlap{0.05, 0.05};  // the usual resonator of a crumpled sheet that is not held
constexpr double kBed_db = -10, kBed_s = 0.05;

std::string place(const pack::GridPoint& point) {
  return fmt::format("l_r {:g} cm, l_c {:g} cm", 100 * point.ruling_length_m, 100 * point.free_border_length_m);
}

std::vector<float> noise_of(const std::vector<float>& magnitudes, std::size_t samples, dsp::Random& random) {
  const int size = 2 * (static_cast<int>(magnitudes.size()) - 1);
  const auto block = static_cast<std::size_t>(size), hop = block / 2;
  dsp::RealFft fft(size);
  std::vector<float> window(block), out(samples + 2 * block, 0.0f);
  dsp::sine_window(window);
  // Magnitude 1 in every bin is noise of variance 1 per sample.
  const double scale = std::sqrt(static_cast<double>(size));
  for (std::size_t start = 0; start + block <= out.size(); start += hop) {
    for (std::size_t k = 0; k < magnitudes.size(); ++k) {
      const double phase = random.uniform(0, 2 * std::numbers::pi);
      const bool real = k == 0 || k + 1 == magnitudes.size();
      const std::complex<double> value = real ? std::numbers::sqrt2 * std::cos(phase) : std::polar(1.0, phase);
      fft.spectrum()[k] = std::complex<float>(scale * magnitudes[k] * value);
    }
    fft.inverse();
    for (std::size_t n = 0; n < block; ++n) out[start + n] += window[n] * fft.time()[n];
  }
  return {out.begin() + static_cast<std::ptrdiff_t>(hop), out.begin() + static_cast<std::ptrdiff_t>(hop + samples)};
}

void modulate(std::vector<float>& signal, const pack::FrictionSection& friction, double rate_hz, dsp::Random& random) {
  if (friction.gain_sigma <= 0) return;
  const std::size_t lead = static_cast<std::size_t>(rate_hz / 4);
  std::vector<float> slow(lead + signal.size());
  for (float& x : slow) x = static_cast<float>(random.normal());
  dsp::CascadeState state;
  dsp::filter(dsp::butterworth_lowpass(2, std::min(friction.gain_cutoff_hz, 0.4 * rate_hz), rate_hz), state, slow);
  const std::span<const float> steady = std::span(slow).subspan(lead);
  const double sigma = friction.gain_sigma, spread = dsp::rms(steady);
  for (std::size_t n = 0; n < signal.size(); ++n)
    signal[n] *= static_cast<float>(std::exp(sigma * steady[n] / spread - sigma * sigma));
}

/// A hand's push: the speed of least jerk, t² (1 - t)², 1 in the middle.
void pushed_from_rest_to_rest(std::vector<float>& signal) {
  for (std::size_t n = 0; n < signal.size(); ++n) {
    const double t = static_cast<double>(n) / static_cast<double>(signal.size()), rise = 4 * t * (1 - t);
    signal[n] *= static_cast<float>(rise * rise);
  }
}

std::vector<float> crumpling(const pack::CrumplingSection& section, const pack::FrictionSection* friction, double rate_hz,
                             dsp::Random random) {
  const auto clacs = pack::nearest_variants(section, {}), flaps = pack::nearest_variants(section, kSmallFlap);
  std::vector<float> out(static_cast<std::size_t>((kCrumpling_s + 2) * rate_hz), 0.0f);
  const auto length = static_cast<std::size_t>(kCrumpling_s * rate_hz);
  for (double t = random.log_uniform(kShortestGap_s, kLongestGap_s); t < kCrumpling_s;
       t += random.log_uniform(kShortestGap_s, kLongestGap_s)) {
    const double gain = std::sqrt(random.truncated_pareto(kEnergyExponent, kLeastEnergy, 1.0));
    const bool flap = !flaps.empty() && random.uniform() < kSmallFlaps;
    const auto& variants = flap ? flaps : clacs;
    const pack::Unit& unit = section.units[variants[random.index(static_cast<std::uint32_t>(variants.size()))]];
    const auto at = static_cast<std::size_t>(t * rate_hz);
    for (std::size_t n = 0; n < unit.samples.size() && at + n < length; ++n)
      out[at + n] += static_cast<float>(gain * unit.samples[n]);
  }
  out.resize(length);
  const pack::Spectrum* layers = friction ? pack::nearest_spectrum(*friction, kSmallFlap) : nullptr;
  if (!layers) return out;
  // Layers sliding over each other, as strong as the last 50 ms.
  std::vector<float> bed = noise_of(layers->magnitudes, length, random);
  modulate(bed, *friction, rate_hz, random);
  const double keep = std::exp(-1 / (kBed_s * rate_hz));
  double power = 0;
  for (std::size_t n = 0; n < length; ++n) {
    power = keep * power + (1 - keep) * static_cast<double>(out[n]) * out[n];
    bed[n] *= static_cast<float>(std::sqrt(power));
  }
  const double gain = dsp::db_to_gain(kBed_db) * dsp::rms(out) / std::max(1e-30, dsp::rms(bed));
  for (std::size_t n = 0; n < length; ++n) out[n] += static_cast<float>(gain * bed[n]);
  return out;
}

}  // namespace

std::vector<ClassifiedSound> pack_sounds(const pack::SoundPack& pack, std::uint64_t seed) {
  std::vector<ClassifiedSound> sounds;
  const double rate_hz = pack.rate_hz;
  if (pack.crumpling) {
    std::map<std::pair<double, double>, int> numbers;
    for (const pack::Unit& unit : pack.crumpling->units) {
      const int number = ++numbers[{unit.point.ruling_length_m, unit.point.free_border_length_m}];
      const bool clac = unit.point.constrained();
      sounds.push_back({clac ? SoundClass::kClac : SoundClass::kFlap,
                        clac ? fmt::format("clac ({})", number) : fmt::format("flap {} ({})", place(unit.point), number),
                        unit.samples});
    }
    if (!pack::nearest_variants(*pack.crumpling, {}).empty()) {
      for (int i = 0; i < kCrumplings; ++i) {
        const dsp::Random random(dsp::hash(seed, 1, static_cast<std::uint64_t>(i)));
        sounds.push_back({SoundClass::kCrumple, fmt::format("crumpling ({})", i + 1),
                          crumpling(*pack.crumpling, pack.friction ? &*pack.friction : nullptr, rate_hz, random)});
      }
    }
  }
  if (pack.friction) {
    for (std::size_t i = 0; i < pack.friction->spectra.size(); ++i) {
      const pack::Spectrum& spectrum = pack.friction->spectra[i];
      dsp::Random random(dsp::hash(seed, 2, i));
      std::vector<float> slide = noise_of(spectrum.magnitudes, static_cast<std::size_t>(kSlide_s * rate_hz), random);
      modulate(slide, *pack.friction, rate_hz, random);
      pushed_from_rest_to_rest(slide);
      sounds.push_back({SoundClass::kSlide, spectrum.point.constrained() ? "slide, flat" : "slide " + place(spectrum.point),
                        std::move(slide)});
    }
  }
  return sounds;
}

}  // namespace rustle::build
