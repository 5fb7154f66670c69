#include "server/validation/measures.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include "server/validation/check.h"
#include "sound_db/dsp/fft.h"
#include "sound_db/dsp/filter.h"
#include "sound_db/dsp/statistics.h"
#include "sound_db/dsp/window.h"

namespace rustle::validation {
namespace {

std::vector<double> window_energies(std::span<const float> samples, std::size_t window) {
  std::vector<double> energies;
  for (std::size_t from = 0; from < samples.size(); from += window) {
    double sum = 0;
    for (const float x : samples.subspan(from, std::min(window, samples.size() - from))) sum += static_cast<double>(x) * x;
    energies.push_back(sum);
  }
  return energies;
}

std::size_t loudest(const std::vector<double>& energies) {
  return static_cast<std::size_t>(std::max_element(energies.begin(), energies.end()) - energies.begin());
}

std::vector<double> ranks(std::span<const double> values) {
  std::vector<std::size_t> order(values.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) { return values[a] < values[b]; });
  std::vector<double> rank(values.size());
  for (std::size_t i = 0, j; i < order.size(); i = j) {
    for (j = i; j < order.size() && values[order[j]] == values[order[i]];) ++j;
    for (std::size_t k = i; k < j; ++k) rank[order[k]] = 0.5 * static_cast<double>(i + j - 1);
  }
  return rank;
}

}  // namespace

std::vector<float> spectrum_of(std::span<const float> samples, double skip_s) {
  const auto skip = static_cast<std::size_t>(skip_s * kRate_hz);
  if (samples.size() > 2 * skip) samples = samples.subspan(skip, samples.size() - 2 * skip);
  return dsp::mean_magnitude(samples);
}

double distance(std::span<const float> a, std::span<const float> b) {
  return dsp::quadratic_form_distance(dsp::spectrum_histogram(a), dsp::spectrum_histogram(b));
}

double centroid_hz(std::span<const float> spectrum) {
  return dsp::spectral_centroid_hz(spectrum, kRate_hz);
}

std::vector<double> power_density(std::span<const float> samples, int size) {
  dsp::RealFft fft(size);
  const auto length = static_cast<std::size_t>(size);
  std::vector<float> window(length);
  dsp::hann_window(window);
  std::vector<double> power(static_cast<std::size_t>(fft.bins()), 0.0);
  int blocks = 0;
  for (std::size_t from = 0; from == 0 || from + length <= samples.size(); from += length / 2, ++blocks) {
    for (std::size_t n = 0; n < length; ++n)
      fft.time()[n] = from + n < samples.size() ? window[n] * samples[from + n] : 0.0F;
    fft.forward();
    for (std::size_t k = 0; k < power.size(); ++k) power[k] += std::norm(fft.spectrum()[k]);
  }
  for (double& p : power) p /= 0.375 * size * blocks;
  return power;
}

double band_power(std::span<const double> density, double from_hz, double to_hz) {
  const double bin_hz = kRate_hz / 2.0 / static_cast<double>(density.size() - 1);
  double sum = 0;
  for (auto k = static_cast<std::size_t>(std::ceil(from_hz / bin_hz));
       k < density.size() && static_cast<double>(k) * bin_hz < to_hz; ++k) {
    sum += density[k];
  }
  return sum * bin_hz;
}

std::vector<report::Point> smoothed_db(std::span<const float> spectrum, double from_hz, double to_hz) {
  std::vector<double> power(spectrum.size());
  std::transform(spectrum.begin(), spectrum.end(), power.begin(), [](float m) { return static_cast<double>(m) * m; });
  const double bin_hz = kRate_hz / 2.0 / static_cast<double>(spectrum.size() - 1);
  std::vector<report::Point> points;
  double top_db = -1e9;
  for (double f = from_hz; f <= to_hz; f *= std::pow(2.0, 1.0 / 12)) {
    const double half = std::max(std::pow(2.0, 1.0 / 12), 1 + 1.1 * bin_hz / f);
    const double mean = band_power(power, f / half, f * half) / (f * half - f / half);
    points.push_back({f, 10 * std::log10(mean + 1e-30)});
    top_db = std::max(top_db, points.back().y);
  }
  for (report::Point& p : points) p.y -= top_db;
  return points;
}

double t60_s(std::span<const float> samples) {
  constexpr std::size_t kWindow = kRate_hz / 500;
  if (samples.empty()) return std::numeric_limits<double>::quiet_NaN();
  const auto part = samples.subspan(loudest(window_energies(samples, kWindow)) * kWindow);
  std::vector<double> left(part.size() + 1, 0.0);
  for (std::size_t n = part.size(); n-- > 0;) left[n] = left[n + 1] + static_cast<double>(part[n]) * part[n];
  double count = 0, t = 0, tt = 0, d = 0, td = 0;
  bool reached = false;
  for (std::size_t n = 0; n < part.size(); ++n) {
    const double db = 10 * std::log10(left[n] / left[0] + 1e-12);
    if (db > -5) continue;
    if (db < -25) {
      reached = true;
      break;
    }
    const double time_s = static_cast<double>(n) / kRate_hz;
    count += 1;
    t += time_s;
    tt += time_s * time_s;
    d += db;
    td += time_s * db;
  }
  const double slope_db_per_s = (count * td - t * d) / (count * tt - t * t);
  return reached && count >= 8 && slope_db_per_s < 0 ? -60 / slope_db_per_s : std::numeric_limits<double>::quiet_NaN();
}

double band_t60_s(std::span<const float> samples, double low_hz, double high_hz) {
  // Backward in time, so that the filter's own ringing lies before the onset.
  std::vector<float> band(samples.rbegin(), samples.rend());
  dsp::CascadeState state;
  dsp::filter(dsp::butterworth_bandpass(low_hz, high_hz, kRate_hz), state, band);
  dsp::CascadeState again;
  dsp::filter(dsp::butterworth_bandpass(low_hz, high_hz, kRate_hz), again, band);
  std::reverse(band.begin(), band.end());
  return t60_s(band);
}

double last_within_30_db_s(std::span<const float> samples) {
  constexpr std::size_t kWindow = kRate_hz / 200;
  const auto energies = window_energies(samples, kWindow);
  if (energies.empty()) return 0;
  const std::size_t top = loudest(energies);
  std::size_t last = top;
  for (std::size_t k = top; k < energies.size(); ++k) {
    if (energies[k] > 1e-3 * energies[top]) last = k;
  }
  return static_cast<double>((last - top + 1) * kWindow) / kRate_hz;
}

PowerLaw fitted_power_law(std::span<const double> values, double low, double high) {
  double sum = 0;
  int count = 0;
  for (const double v : values) {
    if (v < low || v > high) continue;
    sum += std::log(v / low);
    ++count;
  }
  if (count == 0) return {std::numeric_limits<double>::quiet_NaN(), 0};
  const double mean = sum / count, range = std::log(high / low);
  // The likelihood is concave in the exponent: its slope has one zero.
  const auto slope = [&](double a) {
    const double b = 1 - a;
    const double expected = std::abs(b) < 1e-9 ? range / 2 : range / (1 - std::exp(-b * range)) - 1 / b;
    return expected - mean;
  };
  double from = -4, to = 8;
  for (int k = 0; k < 80; ++k) {
    const double middle = 0.5 * (from + to);
    (slope(middle) > 0 ? from : to) = middle;
  }
  return {0.5 * (from + to), count};
}

double rank_correlation(std::span<const double> x, std::span<const double> y) {
  const auto a = ranks(x), b = ranks(y);
  const double mean = 0.5 * (static_cast<double>(a.size()) - 1);
  double ab = 0, aa = 0, bb = 0;
  for (std::size_t k = 0; k < a.size(); ++k) {
    ab += (a[k] - mean) * (b[k] - mean);
    aa += (a[k] - mean) * (a[k] - mean);
    bb += (b[k] - mean) * (b[k] - mean);
  }
  return aa > 0 && bb > 0 ? ab / std::sqrt(aa * bb) : 0;
}

}  // namespace rustle::validation
