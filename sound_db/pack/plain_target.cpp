#include <algorithm>
#include <cmath>
#include <complex>
#include <numbers>

#include "sound_db/dsp/fft.h"
#include "sound_db/dsp/random.h"
#include "sound_db/dsp/window.h"
#include "sound_db/pack/calibration.h"

namespace rustle::pack {

std::vector<float> plain_target(const ClothCorpus& corpus, double duration_s, const std::function<double(double)>& speed_at,
                                std::span<const PlainEvent> events, std::uint64_t seed) {
  const FrictionSpectra spectra(corpus.friction);
  const auto size = static_cast<std::size_t>(corpus.friction.fft_size), hop = size / 2;
  const auto count = static_cast<std::size_t>(duration_s * corpus.rate_hz);
  dsp::RealFft fft(static_cast<int>(size));
  dsp::Random random(seed);
  std::vector<float> window(size), magnitudes(corpus.friction.bins()), out(count + 2 * size);
  dsp::sine_window(window);
  // White noise of unit variance has |X|² = N in every bin.
  const auto scale = static_cast<float>(std::sqrt(static_cast<double>(size)));
  for (std::size_t at = 0; at < count + hop; at += hop) {
    const double speed = speed_at(static_cast<double>(at) / corpus.rate_hz);
    if (!(speed > 0)) continue;
    spectra.at(speed, magnitudes);
    for (std::size_t k = 0; k < magnitudes.size(); ++k) {
      const double phase = 2 * std::numbers::pi * random.uniform();
      const bool real = k == 0 || k + 1 == magnitudes.size();
      fft.spectrum()[k] =
          real ? std::complex<float>(phase < std::numbers::pi ? magnitudes[k] * scale : -magnitudes[k] * scale)
               : std::polar(magnitudes[k] * scale, static_cast<float>(phase));
    }
    fft.inverse();
    for (std::size_t n = 0; n < size; ++n) out[at + n] += fft.time()[n] * window[n];
  }
  // A block is centred on the time that its speed is of.
  std::vector<float> sound(out.begin() + static_cast<std::ptrdiff_t>(hop),
                           out.begin() + static_cast<std::ptrdiff_t>(hop + count));
  for (const PlainEvent& event : events) {
    if (!corpus.crumpling || event.unit >= corpus.crumpling->units.size()) continue;
    const auto& samples = corpus.crumpling->units[event.unit].samples;
    const auto first = static_cast<std::size_t>(std::max(0.0, event.time_s * corpus.rate_hz));
    for (std::size_t n = 0; n < samples.size() && first + n < sound.size(); ++n) {
      sound[first + n] += static_cast<float>(event.gain * static_cast<double>(samples[n]));
    }
  }
  return sound;
}

std::vector<float> plain_calibration_target(const ClothCorpus& corpus, std::uint64_t seed) {
  constexpr double kDuration_s = 30, kPopsPerSecond = 15;
  struct Stroke {
    double from_s, length_s, peak_m_per_s;
  };
  dsp::Random random(seed);
  const double slow = corpus.friction.speeds_m_per_s.front(), fast = corpus.friction.speeds_m_per_s.back();
  std::vector<Stroke> strokes;
  std::vector<PlainEvent> events;
  const auto units = corpus.crumpling ? static_cast<std::uint32_t>(corpus.crumpling->units.size()) : 0U;
  for (double t = 0.2; t < kDuration_s - 1;) {
    const Stroke stroke{t, random.uniform(0.3, 1.2), slow < fast ? random.log_uniform(slow, fast) : slow};
    strokes.push_back(stroke);
    const bool crumples = units > 0 && random.uniform() < 0.4;
    for (double at = t; crumples && at < t + stroke.length_s; at -= std::log(1 - random.uniform()) / kPopsPerSecond) {
      events.push_back({at, random.index(units), random.uniform(0.5, 1.5)});
    }
    t += stroke.length_s + random.uniform(0.0, 0.3);
  }
  const auto speed_at = [&](double t) {
    const auto after =
        std::upper_bound(strokes.begin(), strokes.end(), t, [](double time, const Stroke& s) { return time < s.from_s; });
    if (after == strokes.begin()) return 0.0;
    const Stroke& stroke = *(after - 1);
    const double x = (t - stroke.from_s) / stroke.length_s;
    return x < 1 ? stroke.peak_m_per_s * 16 * x * x * (1 - x) * (1 - x) : 0.0;
  };
  return plain_target(corpus, kDuration_s, speed_at, events, seed);
}

EnergyHistogram usual_event_amplitudes() {
  constexpr double kLeast_m = 0.004, kMost_m = 0.4, kExponent = 1.6;
  constexpr int kCount = 1000;
  std::vector<double> amplitudes;
  const double power = 1 - kExponent, least = std::pow(kLeast_m, power), most = std::pow(kMost_m, power);
  for (int i = 0; i < kCount; ++i) amplitudes.push_back(std::pow(least + i / (kCount - 1.0) * (most - least), 1 / power));
  return energy_histogram(amplitudes);
}

}  // namespace rustle::pack
