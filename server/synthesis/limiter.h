#pragma once

#include <cstdint>
#include <span>

#include "server/synthesis/nonblocking.h"

namespace rustle::synthesis {

inline constexpr double kLimiterKnee_db = -3.0;
inline constexpr double kLimiterRelease_s = 0.1;

/// Holds the last sum within ±1, all channels alike, without delay.
///   curve    y(p) = p up to T = -3 dBFS, above T + (1-T) tanh((p-T)/(1-T)),   p the largest channel's |sample|
///   gain     g = min(y(p)/p, 1 - (1 - g_before) e^{-1/(rate · 0.1 s)}): instant attack, 100 ms release
/// A signal that stays at or below the knee passes bit for bit. Samples that are not finite become 0 and are counted. What
/// comes out depends on the samples alone, not on how they are grouped.
class Limiter {
 public:
  /// [control] \pre rate_hz > 0
  explicit Limiter(double rate_hz) noexcept;

  /// In place on `samples` samples of each channel. [render worker]
  /// \pre every channel has `samples` samples
  void process(std::span<float* const> channels, std::size_t samples) noexcept RUSTLE_NONBLOCKING;

  std::uint64_t not_finite() const noexcept { return not_finite_; }
  /// Samples that were turned down.
  std::uint64_t limited() const noexcept { return limited_; }

 private:
  float keep_;
  float gain_ = 1;
  std::uint64_t not_finite_ = 0;
  std::uint64_t limited_ = 0;
};

}  // namespace rustle::synthesis
