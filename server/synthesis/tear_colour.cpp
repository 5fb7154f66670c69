#include "server/synthesis/tear_colour.h"

#include <algorithm>
#include <cmath>
#include <complex>
#include <numbers>

#include "sound_db/dsp/fft.h"
#include "sound_db/dsp/filter.h"

namespace rustle::synthesis {
namespace {

constexpr int kOversampling = 8;    ///< of the spectrum against the filter's length
constexpr double kLeast = 1e-3;     ///< of the greatest magnitude: nulls have no minimum phase
constexpr double kTaperPart = 0.1;  ///< of the taps that fade out

/// Value at a place between 0 and 1 along evenly spaced values.
double at(std::span<const float> values, double place) {
  const double x = place * static_cast<double>(values.size() - 1);
  const auto k = std::min(static_cast<std::size_t>(x), values.size() - 2);
  return std::lerp(static_cast<double>(values[k]), static_cast<double>(values[k + 1]), x - static_cast<double>(k));
}

/// ln |C| for every bin of the transform, never below kLeast of its greatest.
std::vector<double> log_magnitudes(std::span<const float> emission, std::uint32_t rate_hz, int bins) {
  const auto low_pass = dsp::butterworth_lowpass(2, std::min(kTearLowPass_hz, 0.45 * rate_hz), rate_hz);
  std::vector<double> out(static_cast<std::size_t>(bins));
  double greatest = 0;
  for (std::size_t k = 0; k < out.size(); ++k) {
    const double place = static_cast<double>(k) / static_cast<double>(bins - 1);
    const double heard = emission.size() < 2 ? 1 : std::pow(std::max(at(emission, place), 0.0), kTearColour);
    out[k] = heard * dsp::magnitude(low_pass, place * rate_hz / 2, rate_hz);
    greatest = std::max(greatest, out[k]);
  }
  if (!(greatest > 0) || !std::isfinite(greatest)) return std::vector<double>(out.size(), 0.0);
  for (double& x : out) x = std::log(std::max(x / greatest, kLeast));
  return out;
}

}  // namespace

std::vector<float> tear_colour(std::span<const float> emission, std::uint32_t rate_hz) {
  const int taps = tear_colour_taps(rate_hz), size = kOversampling * taps;
  dsp::RealFft fft(size);
  const auto spectrum = fft.spectrum();
  const auto time = fft.time();
  const auto magnitudes = log_magnitudes(emission, rate_hz, fft.bins());
  for (std::size_t k = 0; k < spectrum.size(); ++k) spectrum[k] = {static_cast<float>(magnitudes[k]), 0};
  fft.inverse();  // the real cepstrum; folded onto positive times, it is that of minimum phase
  const auto half = static_cast<std::size_t>(size / 2);
  for (std::size_t n = 1; n < half; ++n) time[n] *= 2;
  std::fill(time.begin() + static_cast<std::ptrdiff_t>(half) + 1, time.end(), 0.0F);
  fft.forward();
  for (auto& bin : spectrum) bin = std::exp(bin);
  spectrum.front() = spectrum.front().real();
  spectrum.back() = spectrum.back().real();
  fft.inverse();
  std::vector<float> out(time.begin(), time.begin() + taps);
  const auto taper = static_cast<std::size_t>(kTaperPart * taps);
  for (std::size_t n = 0; n < taper; ++n) {
    const double left = (static_cast<double>(n) + 0.5) / static_cast<double>(taper);
    out[out.size() - 1 - n] *= static_cast<float>(0.5 - 0.5 * std::cos(std::numbers::pi * left));
  }
  double energy = 0;
  for (const float h : out) energy += static_cast<double>(h) * h;
  const auto scale = static_cast<float>(1 / std::sqrt(energy));
  for (float& h : out) h *= scale;
  return out;
}

}  // namespace rustle::synthesis
