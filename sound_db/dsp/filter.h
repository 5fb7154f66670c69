#pragma once

#include <array>
#include <span>

namespace rustle::dsp {

/// Second-order section H(z) = (b0 + b1 z⁻¹ + b2 z⁻²) / (1 + a1 z⁻¹ + a2 z⁻²).
struct Biquad {
  double b0 = 1, b1 = 0, b2 = 0, a1 = 0, a2 = 0;
};

inline constexpr int kMaxSections = 8;

/// Sections in series.
struct Cascade {
  std::array<Biquad, kMaxSections> sections;
  int count = 0;
};

/// Memory of a cascade (transposed direct form II), all zero at rest.
struct CascadeState {
  std::array<std::array<double, 2>, kMaxSections> delays{};
};

/// Butterworth filters by the bilinear transform with the cut-off warped to its place: -3.01 dB at cutoff_hz.
/// \pre 1 ≤ order ≤ 16, 0 < cutoff_hz < rate_hz / 2
Cascade butterworth_lowpass(int order, double cutoff_hz, double rate_hz) noexcept;
Cascade butterworth_highpass(int order, double cutoff_hz, double rate_hz) noexcept;
/// Band-pass of one pole pair, 0 dB at √(low high) (warped), -3.01 dB at both edges.
/// \pre 0 < low_hz < high_hz < rate_hz / 2
Cascade butterworth_bandpass(double low_hz, double high_hz, double rate_hz) noexcept;

/// |H| at frequency_hz.
double magnitude(const Cascade& cascade, double frequency_hz, double rate_hz) noexcept;

/// Filters in place, going on from `state`. Allocation-free, any thread.
void filter(const Cascade& cascade, CascadeState& state, std::span<float> signal) noexcept;

}  // namespace rustle::dsp
