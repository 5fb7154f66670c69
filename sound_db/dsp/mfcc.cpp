#include "sound_db/dsp/mfcc.h"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <numbers>

#include "sound_db/dsp/fft.h"
#include "sound_db/dsp/level.h"
#include "sound_db/dsp/window.h"

namespace rustle::dsp {

namespace {

constexpr double kEnergyFloor = 1e-10;

double mel(double frequency_hz) {
  return 2595.0 * std::log10(1.0 + frequency_hz / 700.0);
}

/// A triangle over the bins [first, first + weights.size()).
struct MelBand {
  std::size_t first = 0;
  std::vector<double> weights;
};

std::vector<MelBand> mel_bands(const MfccOptions& options, double rate_hz) {
  const double low = mel(options.low_hz), high = mel(std::min(options.high_hz, rate_hz / 2));
  std::vector<double> edges_hz(static_cast<std::size_t>(options.bands) + 2);
  for (std::size_t i = 0; i < edges_hz.size(); ++i) {
    const double at = low + (high - low) * static_cast<double>(i) / (options.bands + 1);
    edges_hz[i] = 700.0 * (std::pow(10.0, at / 2595.0) - 1.0);
  }
  std::vector<MelBand> bands(static_cast<std::size_t>(options.bands));
  const double bin_hz = rate_hz / options.fft_size;
  for (std::size_t b = 0; b < bands.size(); ++b) {
    for (int k = 0; k <= options.fft_size / 2; ++k) {
      const double up = (k * bin_hz - edges_hz[b]) / (edges_hz[b + 1] - edges_hz[b]);
      const double down = (edges_hz[b + 2] - k * bin_hz) / (edges_hz[b + 2] - edges_hz[b + 1]);
      const double weight = std::min(up, down);
      if (weight <= 0) continue;
      if (bands[b].weights.empty()) bands[b].first = static_cast<std::size_t>(k);
      bands[b].weights.push_back(weight);
    }
  }
  return bands;
}

/// [coefficients][bands].
std::vector<double> dct_matrix(int coefficients, int bands) {
  std::vector<double> matrix;
  for (int c = 0; c < coefficients; ++c) {
    const double scale = std::sqrt((c == 0 ? 1.0 : 2.0) / bands);
    for (int b = 0; b < bands; ++b) matrix.push_back(scale * std::cos(std::numbers::pi * c * (b + 0.5) / bands));
  }
  return matrix;
}

}  // namespace

Mfcc mfcc(std::span<const float> signal, double rate_hz, const MfccOptions& options) {
  assert(options.coefficients >= 1 && options.coefficients <= options.bands && options.hop >= 1);
  assert(options.low_hz < rate_hz / 2);
  const auto size = static_cast<std::size_t>(options.fft_size), hop = static_cast<std::size_t>(options.hop);
  RealFft fft(options.fft_size);
  std::vector<float> window(size);
  hann_window(window);
  const std::vector<MelBand> bands = mel_bands(options, rate_hz);
  const std::vector<double> dct = dct_matrix(options.coefficients, options.bands);

  Mfcc result;
  result.coefficients = options.coefficients;
  result.frames = signal.size() <= size ? 1 : static_cast<int>((signal.size() - size) / hop) + 1;
  result.values.reserve(static_cast<std::size_t>(result.frames) * static_cast<std::size_t>(result.coefficients));
  std::vector<double> power(static_cast<std::size_t>(fft.bins())), logarithms(bands.size());
  for (int frame = 0; frame < result.frames; ++frame) {
    const std::size_t start = static_cast<std::size_t>(frame) * hop;
    const auto block = fft.time();
    for (std::size_t n = 0; n < size; ++n) block[n] = start + n < signal.size() ? signal[start + n] * window[n] : 0.0f;
    fft.forward();
    for (std::size_t k = 0; k < power.size(); ++k) power[k] = std::norm(fft.spectrum()[k]);
    for (std::size_t b = 0; b < bands.size(); ++b) {
      double energy = 0;
      for (std::size_t k = 0; k < bands[b].weights.size(); ++k) energy += bands[b].weights[k] * power[bands[b].first + k];
      logarithms[b] = std::log(energy + kEnergyFloor);
    }
    for (std::size_t c = 0; c < static_cast<std::size_t>(options.coefficients); ++c) {
      double sum = 0;
      for (std::size_t b = 0; b < logarithms.size(); ++b) sum += dct[c * logarithms.size() + b] * logarithms[b];
      result.values.push_back(static_cast<float>(sum));
    }
  }
  return result;
}

MeanMfcc mean_mfcc(std::span<const float> signal, double rate_hz) {
  constexpr double kRms = 0.1, kRange_db = 30.0;
  MeanMfcc mean{};
  const double level = rms(signal);
  if (!(level > 0)) return mean;
  std::vector<float> scaled(signal.begin(), signal.end());
  for (float& x : scaled) x = static_cast<float>(x * (kRms / level));
  MfccOptions options;
  options.coefficients = kMeanMfccCoefficients;
  options.high_hz = 11000;
  const Mfcc all = mfcc(scaled, rate_hz, options);
  double loudest = all.frame(0)[0];
  for (int i = 0; i < all.frames; ++i) loudest = std::max<double>(loudest, all.frame(i)[0]);
  // Coefficient 0 is the sum of the bands' logarithms over √bands.
  const double least = loudest - std::sqrt(static_cast<double>(options.bands)) * kRange_db / 10 * std::log(10.0);
  int kept = 0;
  for (int i = 0; i < all.frames; ++i) {
    const auto frame = all.frame(i);
    if (!(frame[0] > least)) continue;
    for (std::size_t c = 0; c < mean.size(); ++c) mean[c] += frame[c];
    ++kept;
  }
  for (double& m : mean) m /= kept;
  return mean;
}

double mfcc_distance(const MeanMfcc& a, const MeanMfcc& b) {
  double sum = 0;
  for (std::size_t c = 1; c < a.size(); ++c) sum += (a[c] - b[c]) * (a[c] - b[c]);
  return std::sqrt(sum);
}

}  // namespace rustle::dsp
