#pragma once

#include <cstdint>

#include "server/synthesis/nonblocking.h"
#include "sound_db/dsp/random.h"

/// How strong the noise of a tear is along the way that it has torn (T4). What is here depends on the seed and on the torn
/// length s alone, so a tear that goes twice as fast has every break in half the time.
namespace rustle::synthesis {

inline constexpr double kReferenceTearSpeed_m_per_s = 0.1;  ///< v0
inline constexpr double kMostTearSpeed_m_per_s = 10;        ///< faster tears sound no louder and no faster
inline constexpr double kTearBed = 0.77;                    ///< b: part of the mean power that is steady fibre noise
inline constexpr double kTearBurst_m = 1e-4;                ///< ℓ: over which a break's power decays
inline constexpr double kTearLeastGap_m = 3e-5;             ///< between breaks: p(gap) ∝ 1/gap ...
inline constexpr double kTearMostGap_m = 1e-2;              ///< ... to this
inline constexpr double kTearPersistence = 0.85;            ///< ρ: short gaps come together
inline constexpr double kTearExponent = 1.25;               ///< of p(E) ∝ E^-exponent
inline constexpr double kTearEnergyRange = 1e3;             ///< E_max / E_min
inline constexpr double kPublishedAlpha = 100;              ///< α of r^α
inline constexpr double kPublishedHold_m = 1e-3;            ///< r is held for this over the speed

/// A break of fibres.
struct TearBreak {
  double at_m = 0;    ///< s_k, torn length at which it happens
  double energy = 0;  ///< E_k, mean 1
};

/// The breaks of one tear, one after the other: gaps are log-uniform, their ranks an autoregressive Gaussian sequence of
/// correlation ρ through its distribution function. Allocation-free, any thread.
class TearBreaks {
 public:
  explicit TearBreaks(std::uint64_t seed) noexcept;
  TearBreak next() noexcept RUSTLE_NONBLOCKING;

 private:
  dsp::Random random_;
  double rank_;
  double at_m_ = 0;
};

/// g(s) of unit mean square:
///   g² = b + (1-b) (δ̄/ℓ) Σ_k E_k exp(-(s - s_k)/ℓ)   over the breaks with s_k ≤ s; δ̄ the mean gap
class TearGate {
 public:
  explicit TearGate(std::uint64_t seed) noexcept : breaks_(seed), next_(breaks_.next()) {}
  /// Goes on by step_m ≥ 0 and returns g there.
  double advance(double step_m) noexcept RUSTLE_NONBLOCKING;

 private:
  TearBreaks breaks_;
  TearBreak next_;
  double torn_m_ = 0;
  double power_ = 0;  ///< Σ E_k exp(-(s - s_k)/ℓ)
};

/// The gate as printed, r^α of unit mean square (by √(2α+1)): r, uniform, is new after every kPublishedHold_m, which is a
/// time inversely proportional to speed.
class PublishedTearGate {
 public:
  explicit PublishedTearGate(std::uint64_t seed) noexcept : random_(seed) { draw(); }
  double advance(double step_m) noexcept RUSTLE_NONBLOCKING;

 private:
  void draw() noexcept;

  dsp::Random random_;
  double held_m_ = 0;
  double gate_ = 0;
};

}  // namespace rustle::synthesis
