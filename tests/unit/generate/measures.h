#pragma once

#include <algorithm>
#include <cmath>
#include <numbers>
#include <span>
#include <vector>

#include "sound_db/dsp/fft.h"
#include "sound_db/dsp/random.h"
#include "sound_db/dsp/statistics.h"
#include "sound_db/dsp/window.h"
#include "sound_db/generate/generate.h"
#include "sound_db/pack/query.h"

/// What sounds of paper are measured by in these tests, and the packs that they measure.
namespace rustle::generate {

inline constexpr double kRate_hz = 48000;

inline const Paper& printer() {
  return *find_paper("printer-paper");
}

/// Each material's pack over every second edge of the grid, printer paper's over the whole grid; made once.
inline const std::vector<pack::SoundPack>& packs() {
  static const std::vector<pack::SoundPack> made = [] {
    std::vector<pack::SoundPack> result;
    for (const Paper& paper : papers()) {
      Options options;
      if (paper.name != "printer-paper") {
        options.grid.clear();
        for (const double ruling_m : {0.025, 0.075, 0.10, 0.20, 0.30}) {
          for (const double edge_m : {0.025, 0.075, 0.10, 0.20, 0.30}) options.grid.push_back({ruling_m, 2 * edge_m});
        }
      }
      result.push_back(make_pack(paper, options));
    }
    return result;
  }();
  return made;
}

inline std::vector<double> energies(std::span<const float> signal, double window_s) {
  const auto size = static_cast<std::size_t>(window_s * kRate_hz);
  std::vector<double> result;
  for (std::size_t start = 0; start + size <= signal.size(); start += size) {
    double sum = 0;
    for (const float x : signal.subspan(start, size)) sum += static_cast<double>(x) * x;
    result.push_back(sum);
  }
  return result;
}

/// From the first to the last 5 ms within 40 dB of the loudest.
inline std::span<const float> trimmed(std::span<const float> signal) {
  const auto energy = energies(signal, 0.005);
  const double least = 1e-4 * *std::max_element(energy.begin(), energy.end());
  std::size_t first = energy.size(), last = 0;
  for (std::size_t i = 0; i < energy.size(); ++i) {
    if (energy[i] <= least) continue;
    first = std::min(first, i);
    last = i;
  }
  return signal.subspan(240 * first, 240 * (last + 1 - first));
}

inline double centroid_hz(std::span<const float> signal) {
  return dsp::spectral_centroid_hz(dsp::mean_magnitude(trimmed(signal), 1024, 256), kRate_hz);
}

inline double kurtosis(std::span<const float> signal) {
  return dsp::kurtosis(trimmed(signal));
}

/// From the start of the loudest 5 ms to the end of the last 5 ms within 30 dB of them.
inline double decay30_s(std::span<const float> signal) {
  const auto energy = energies(signal, 0.005);
  const auto loudest = std::max_element(energy.begin(), energy.end());
  std::size_t last = 0;
  for (std::size_t i = 0; i < energy.size(); ++i) {
    if (energy[i] > 1e-3 * *loudest) last = i;
  }
  return 0.005 * static_cast<double>(last + 1 - static_cast<std::size_t>(loudest - energy.begin()));
}

/// T60 of a decaying energy by backward integration (Schroeder), a line fitted from -5 to -25 dB.
inline double schroeder_t60_s(const std::vector<double>& power) {
  std::vector<double> level_db(power.size());
  double sum = 0;
  for (std::size_t n = power.size(); n-- > 0;) level_db[n] = sum += power[n];
  double count = 0, t = 0, d = 0, tt = 0, td = 0;
  for (std::size_t n = 0; n < power.size(); ++n) {
    const double db = 10 * std::log10(level_db[n] / sum + 1e-12), s = static_cast<double>(n) / kRate_hz;
    if (db > -5 || db < -25) continue;
    ++count, t += s, d += db, tt += s * s, td += s * db;
  }
  return -60 * (count * tt - t * t) / (count * td - t * d);
}

/// The same of a clip, from its loudest 2 ms on.
inline double t60_s(std::span<const float> signal) {
  const auto energy = energies(signal, 0.002);
  const auto loudest = static_cast<std::size_t>(std::max_element(energy.begin(), energy.end()) - energy.begin());
  std::vector<double> power;
  for (const float x : signal.subspan(96 * loudest)) power.push_back(static_cast<double>(x) * x);
  return schroeder_t60_s(power);
}

/// Rises of 6 dB over the 3 ms before, above -35 dB, at most one in 2 ms.
inline int onsets(std::span<const float> signal) {
  const auto energy = energies(signal, 0.0005);
  const double loudest = *std::max_element(energy.begin(), energy.end());
  int count = 0;
  std::size_t free_from = 0;
  for (std::size_t i = 1; i < energy.size(); ++i) {
    double before = 0;
    for (std::size_t k = 1; k <= 6 && k <= i; ++k) before += energy[i - k] / 6;
    if (energy[i] < 4 * (before + 1e-6 * loudest) || energy[i] < 3.2e-4 * loudest || i < free_from) continue;
    ++count;
    free_from = i + 4;
  }
  return count;
}

/// Friction noise as it is played (P8): random phases, sine windows half overlapped, the slow random gain.
inline std::vector<float> friction_noise(std::span<const float> magnitudes, double seconds,
                                         const pack::FrictionSection& section, dsp::Random random) {
  const auto size = 2 * (magnitudes.size() - 1), hop = size / 2;
  dsp::RealFft fft(static_cast<int>(size));
  std::vector<float> window(size), out(hop * (static_cast<std::size_t>(seconds * kRate_hz) / hop + 1));
  dsp::sine_window(window);
  for (std::size_t start = 0; start + size <= out.size(); start += hop) {
    for (std::size_t k = 0; k < magnitudes.size(); ++k) {
      const double phase = 2 * std::numbers::pi * random.uniform();
      const double m = k == 0 || k == hop ? 0.0 : std::sqrt(static_cast<double>(size)) * magnitudes[k];
      fft.spectrum()[k] = {static_cast<float>(m * std::cos(phase)), static_cast<float>(m * std::sin(phase))};
    }
    fft.inverse();
    for (std::size_t n = 0; n < size; ++n) out[start + n] += window[n] * fft.time()[n];
  }
  const double a = std::exp(-2 * std::numbers::pi * section.gain_cutoff_hz / kRate_hz), keep = 1 - a;
  const double deviation = std::sqrt(std::pow(keep, 4) * (1 + a * a) / std::pow(1 - a * a, 3));
  double first = 0, second = 0;
  const auto step = [&] {
    first = a * first + keep * random.normal();
    second = a * second + keep * first;
    return second / deviation;
  };
  for (int i = 0; i < static_cast<int>(8 / keep); ++i) step();
  for (float& x : out) {
    x *= static_cast<float>(std::exp(section.gain_sigma * step() - section.gain_sigma * section.gain_sigma));
  }
  return out;
}

inline double mean(const std::vector<double>& values) {
  double sum = 0;
  for (const double v : values) sum += v / static_cast<double>(values.size());
  return sum;
}

inline double median(std::vector<double> values) {
  std::nth_element(values.begin(), values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2), values.end());
  return values[values.size() / 2];
}

}  // namespace rustle::generate
