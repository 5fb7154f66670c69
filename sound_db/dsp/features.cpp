#include "sound_db/dsp/features.h"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <vector>

#include "sound_db/dsp/statistics.h"

namespace rustle::dsp {

namespace {

/// Energy of each whole block; of all when there is not one.
std::vector<double> block_energies(std::span<const float> signal, std::size_t block) {
  const std::size_t blocks = std::max<std::size_t>(1, signal.size() / block);
  std::vector<double> energies(blocks, 0.0);
  for (std::size_t b = 0; b < blocks; ++b) {
    const std::size_t end = blocks == 1 ? std::min(signal.size(), 2 * block) : (b + 1) * block;
    for (std::size_t n = b * block; n < end; ++n) energies[b] += static_cast<double>(signal[n]) * signal[n];
  }
  return energies;
}

std::size_t block_samples(double window_s, double rate_hz) {
  return std::max<std::size_t>(1, static_cast<std::size_t>(window_s * rate_hz));
}

}  // namespace

std::span<const float> without_silence(std::span<const float> signal, double rate_hz, double below_peak_db,
                                       double window_s) {
  const std::size_t block = block_samples(window_s, rate_hz);
  const std::vector<double> energies = block_energies(signal, block);
  const double loudest = *std::max_element(energies.begin(), energies.end());
  if (!(loudest > 0)) return {};
  const auto heard = [&](double e) { return e > loudest * std::pow(10.0, -below_peak_db / 10); };
  const auto first = std::find_if(energies.begin(), energies.end(), heard) - energies.begin();
  const auto after = energies.rend() - std::find_if(energies.rbegin(), energies.rend(), heard);
  const std::size_t from = static_cast<std::size_t>(first) * block;
  return signal.subspan(from, std::min(signal.size(), static_cast<std::size_t>(after) * block) - from);
}

double spectral_bandwidth_hz(std::span<const float> magnitudes, double rate_hz, double low_hz, double high_hz) {
  const double centroid_hz = spectral_centroid_hz(magnitudes, rate_hz, low_hz, high_hz);
  const double bin_hz = rate_hz / 2 / static_cast<double>(magnitudes.size() - 1);
  double weighted = 0, total = 0;
  for (std::size_t k = 0; k < magnitudes.size(); ++k) {
    const double frequency_hz = bin_hz * static_cast<double>(k);
    if (frequency_hz < low_hz || frequency_hz > high_hz) continue;
    weighted += (frequency_hz - centroid_hz) * (frequency_hz - centroid_hz) * magnitudes[k];
    total += magnitudes[k];
  }
  return total > 0 ? std::sqrt(weighted / total) : 0.0;
}

double decay_time_s(std::span<const float> signal, double rate_hz, double drop_db, double window_s) {
  const std::vector<double> energies = block_energies(signal, block_samples(window_s, rate_hz));
  const auto loudest = std::max_element(energies.begin(), energies.end());
  const double least = *loudest * std::pow(10.0, -drop_db / 10);
  const auto last = std::find_if(energies.rbegin(), energies.rend(), [&](double e) { return e > least; });
  return last == energies.rend() ? 0.0
                                 : static_cast<double>(energies.rend() - last - (loudest - energies.begin())) * window_s;
}

SoundFeatures sound_features(std::span<const float> signal, double rate_hz) {
  SoundFeatures features;
  const auto sound = without_silence(signal, rate_hz);
  if (sound.empty()) return features;
  const std::vector<float> spectrum = mean_magnitude(sound, 1024, 256);
  features.centroid_hz = spectral_centroid_hz(spectrum, rate_hz);
  features.bandwidth_hz = spectral_bandwidth_hz(spectrum, rate_hz);
  features.decay_s = decay_time_s(sound, rate_hz);
  features.kurtosis = kurtosis(sound);
  features.mfcc = mean_mfcc(sound, rate_hz);
  return features;
}

}  // namespace rustle::dsp
