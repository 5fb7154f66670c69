#pragma once

#include <cstdint>
#include <span>
#include <vector>

/// What the sheet at a tear's tip makes of the tear's noise (T4, T6). Allocates. [analysis worker]
namespace rustle::synthesis {

inline constexpr double kTearLowPass_hz = 10000;  ///< of two poles: recorded tears fall above 8 kHz
inline constexpr double kTearColour = 0.25;       ///< part of the resonator's level differences that the tear takes on

/// Taps of the filter.
constexpr int tear_colour_taps(std::uint32_t rate_hz) noexcept {
  return rate_hz <= 50000 ? 256 : 512;
}

/// Filter of minimum phase, which keeps what is sudden sudden, and of unit energy, which keeps the level of white noise:
///   |C(f)| ∝ E(f)^kTearColour · |L(f)|      E: the resonator's friction spectrum, L: Butterworth's low-pass
/// A quarter of the spectrum's decibels: friction's own source has a part in them. With a quarter, tears at the tip of a
/// 10 x 10 cm cone stay flat within 3 dB from 1 to 8 kHz, as recorded tears are, and the size of a cone is still heard.
/// `emission`: magnitudes evenly from 0 to half of the rate, or empty: the low-pass alone.
std::vector<float> tear_colour(std::span<const float> emission, std::uint32_t rate_hz);

}  // namespace rustle::synthesis
