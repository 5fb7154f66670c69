#include "sound_db/dsp/statistics.h"

#include <algorithm>
#include <cassert>
#include <cmath>

#include "sound_db/dsp/fft.h"
#include "sound_db/dsp/window.h"

namespace rustle::dsp {

std::vector<float> mean_magnitude(std::span<const float> signal, int fft_size, int hop) {
  RealFft fft(fft_size);
  const auto size = static_cast<std::size_t>(fft_size);
  std::vector<float> window(size);
  hann_window(window);
  std::vector<double> sum(static_cast<std::size_t>(fft.bins()), 0.0);
  int blocks = 0;
  for (std::size_t start = 0; start == 0 || start + size <= signal.size(); start += static_cast<std::size_t>(hop)) {
    for (std::size_t n = 0; n < size; ++n) fft.time()[n] = start + n < signal.size() ? signal[start + n] * window[n] : 0.0f;
    fft.forward();
    for (std::size_t k = 0; k < sum.size(); ++k) sum[k] += std::abs(fft.spectrum()[k]);
    ++blocks;
  }
  std::vector<float> mean(sum.size());
  std::transform(sum.begin(), sum.end(), mean.begin(), [blocks](double s) { return static_cast<float>(s / blocks); });
  return mean;
}

std::vector<double> spectrum_histogram(std::span<const float> magnitudes, int bins) {
  assert(!magnitudes.empty() && bins >= 2);
  std::vector<double> cumulative(magnitudes.size() + 1, 0.0);
  for (std::size_t k = 0; k < magnitudes.size(); ++k) cumulative[k + 1] = cumulative[k] + std::abs(magnitudes[k]);
  const double total = cumulative.back();
  std::vector<double> histogram(static_cast<std::size_t>(bins), 1.0 / bins);
  if (!(total > 0)) return histogram;
  double below = 0;
  for (int b = 0; b < bins; ++b) {
    const double edge = static_cast<double>(magnitudes.size()) * (b + 1) / bins;
    const auto k = std::min(static_cast<std::size_t>(edge), magnitudes.size() - 1);
    const double above = cumulative[k] + (cumulative[k + 1] - cumulative[k]) * (edge - static_cast<double>(k));
    histogram[static_cast<std::size_t>(b)] = (above - below) / total;
    below = above;
  }
  return histogram;
}

double quadratic_form_distance(std::span<const double> p, std::span<const double> q) {
  assert(p.size() == q.size() && p.size() >= 2);
  double difference = 0, sum = 0;
  for (std::size_t k = 0; k + 1 < p.size(); ++k) {
    difference += p[k] - q[k];
    sum += difference * difference;
  }
  return std::sqrt(2.0 / static_cast<double>(p.size() - 1) * sum);
}

double spectrum_distance(std::span<const float> a, std::span<const float> b) {
  return quadratic_form_distance(spectrum_histogram(mean_magnitude(a)), spectrum_histogram(mean_magnitude(b)));
}

double spectral_centroid_hz(std::span<const float> magnitudes, double rate_hz, double low_hz, double high_hz) {
  assert(magnitudes.size() >= 2);
  const double bin_hz = rate_hz / 2 / static_cast<double>(magnitudes.size() - 1);
  double weighted = 0, total = 0;
  for (std::size_t k = 0; k < magnitudes.size(); ++k) {
    const double frequency_hz = bin_hz * static_cast<double>(k);
    if (frequency_hz < low_hz || frequency_hz > high_hz) continue;
    weighted += frequency_hz * magnitudes[k];
    total += magnitudes[k];
  }
  return total > 0 ? weighted / total : 0.0;
}

double kurtosis(std::span<const float> signal) {
  const auto count = static_cast<double>(signal.size());
  double mean = 0;
  for (const float x : signal) mean += x / count;
  double second = 0, fourth = 0;
  for (const float x : signal) {
    const double square = (x - mean) * (x - mean);
    second += square / count;
    fourth += square * square / count;
  }
  return second > 0 ? fourth / (second * second) : 0.0;
}

}  // namespace rustle::dsp
