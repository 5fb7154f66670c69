#pragma once

#include <cmath>
#include <cstdint>
#include <numbers>

/// Random numbers that depend on a seed and nothing else: the same on every machine and for every order of evaluation.
namespace rustle::dsp {

/// Bijective mixing of 64 bits (the finalizer of SplitMix64: Steele, Lea, Flood 2014).
constexpr std::uint64_t mix(std::uint64_t x) noexcept {
  x = (x ^ (x >> 30)) * 0xbf58476d1ce4e5b9ULL;
  x = (x ^ (x >> 27)) * 0x94d049bb133111ebULL;
  return x ^ (x >> 31);
}

/// A number for (seed, a, b) without any state: seeds of streams, or a draw that any thread may repeat.
constexpr std::uint64_t hash(std::uint64_t seed, std::uint64_t a, std::uint64_t b = 0) noexcept {
  constexpr std::uint64_t kGolden = 0x9e3779b97f4a7c15ULL;
  return mix(mix(mix(seed + kGolden) + a + kGolden) + b + kGolden);
}

/// The upper 53 bits as a number in [0, 1).
constexpr double to_uniform(std::uint64_t bits) noexcept {
  return static_cast<double>(bits >> 11) * 0x1.0p-53;
}

/// A stream of random numbers (SplitMix64): eight bytes of state, copied freely. Allocation-free, any thread.
class Random {
 public:
  constexpr explicit Random(std::uint64_t seed) noexcept : state_(mix(seed)) {}

  constexpr std::uint64_t next() noexcept { return mix(state_ += 0x9e3779b97f4a7c15ULL); }
  /// In [0, 1).
  constexpr double uniform() noexcept { return to_uniform(next()); }
  constexpr double uniform(double low, double high) noexcept { return low + (high - low) * uniform(); }
  /// An integer in [0, count).
  /// \pre count > 0
  constexpr std::uint32_t index(std::uint32_t count) noexcept {
    return static_cast<std::uint32_t>(((next() >> 32) * count) >> 32);
  }
  /// Standard normal (Box and Muller); takes two draws each time.
  double normal() noexcept {
    const double radius = std::sqrt(-2.0 * std::log(1.0 - uniform()));
    return radius * std::cos(2 * std::numbers::pi * uniform());
  }
  double log_uniform(double low, double high) noexcept { return low * std::pow(high / low, uniform()); }
  /// Density ∝ x^-exponent on [low, high]: energies of breaks and aftershocks.
  double truncated_pareto(double exponent, double low, double high) noexcept {
    const double power = 1.0 - exponent;
    if (std::abs(power) < 1e-9) return log_uniform(low, high);
    const double from = std::pow(low, power);
    return std::pow(from + uniform() * (std::pow(high, power) - from), 1.0 / power);
  }

 private:
  std::uint64_t state_;
};

}  // namespace rustle::dsp
