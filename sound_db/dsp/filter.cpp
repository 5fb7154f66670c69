#include "sound_db/dsp/filter.h"

#include <cassert>
#include <cmath>
#include <complex>
#include <numbers>

namespace rustle::dsp {

namespace {

double warped(double frequency_hz, double rate_hz) {
  return std::tan(std::numbers::pi * frequency_hz / rate_hz);
}

/// Bilinear image (s = (1-z⁻¹)/(1+z⁻¹)) of (n2 s² + n1 s + n0) / (d2 s² + d1 s + d0).
Biquad bilinear(double n2, double n1, double n0, double d2, double d1, double d0) {
  const double a0 = d2 + d1 + d0;
  return {(n2 + n1 + n0) / a0, 2 * (n0 - n2) / a0, (n2 - n1 + n0) / a0, 2 * (d0 - d2) / a0, (d2 - d1 + d0) / a0};
}

/// First-order image of (n1 s + n0) / (s + d0), as a biquad without second-order terms.
Biquad bilinear_first(double n1, double n0, double d0) {
  const double a0 = 1 + d0;
  return {(n1 + n0) / a0, (n0 - n1) / a0, 0, (d0 - 1) / a0, 0};
}

Cascade butterworth(int order, double cutoff_hz, double rate_hz, bool high) {
  assert(order >= 1 && order <= 2 * kMaxSections && cutoff_hz > 0 && cutoff_hz < rate_hz / 2);
  const double w = warped(cutoff_hz, rate_hz);
  Cascade cascade;
  for (int pair = 0; pair < order / 2; ++pair) {
    // Poles of order n lie at angles π (2k + 1) / 2n from the imaginary axis.
    const double damping = 2 * std::sin(std::numbers::pi * (2 * pair + 1) / (2.0 * order));
    cascade.sections[cascade.count++] =
        high ? bilinear(1, 0, 0, 1, damping * w, w * w) : bilinear(0, 0, w * w, 1, damping * w, w * w);
  }
  if (order % 2) cascade.sections[cascade.count++] = high ? bilinear_first(1, 0, w) : bilinear_first(0, w, w);
  return cascade;
}

}  // namespace

Cascade butterworth_lowpass(int order, double cutoff_hz, double rate_hz) noexcept {
  return butterworth(order, cutoff_hz, rate_hz, false);
}

Cascade butterworth_highpass(int order, double cutoff_hz, double rate_hz) noexcept {
  return butterworth(order, cutoff_hz, rate_hz, true);
}

Cascade butterworth_bandpass(double low_hz, double high_hz, double rate_hz) noexcept {
  assert(low_hz > 0 && low_hz < high_hz && high_hz < rate_hz / 2);
  const double low = warped(low_hz, rate_hz), high = warped(high_hz, rate_hz);
  Cascade cascade;
  cascade.sections[0] = bilinear(0, high - low, 0, 1, high - low, low * high);
  cascade.count = 1;
  return cascade;
}

double magnitude(const Cascade& cascade, double frequency_hz, double rate_hz) noexcept {
  const std::complex<double> z1 = std::polar(1.0, -2 * std::numbers::pi * frequency_hz / rate_hz), z2 = z1 * z1;
  double product = 1;
  for (int i = 0; i < cascade.count; ++i) {
    const Biquad& s = cascade.sections[i];
    product *= std::abs((s.b0 + s.b1 * z1 + s.b2 * z2) / (1.0 + s.a1 * z1 + s.a2 * z2));
  }
  return product;
}

void filter(const Cascade& cascade, CascadeState& state, std::span<float> signal) noexcept {
  for (int i = 0; i < cascade.count; ++i) {
    const Biquad s = cascade.sections[i];
    auto [d1, d2] = state.delays[i];
    for (float& sample : signal) {
      const double x = sample, y = s.b0 * x + d1;
      d1 = s.b1 * x - s.a1 * y + d2;
      d2 = s.b2 * x - s.a2 * y;
      sample = static_cast<float>(y);
    }
    // Denormal numbers would slow the silence after a sound.
    state.delays[i] = {std::abs(d1) < 1e-30 ? 0.0 : d1, std::abs(d2) < 1e-30 ? 0.0 : d2};
  }
}

}  // namespace rustle::dsp
