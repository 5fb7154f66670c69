#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "sound_db/dsp/fft.h"

/// Features of the short units that cloth sound is cut into (An et al. 2012, 4.2 and 4.3; C3).
namespace rustle::dsp {

inline constexpr int kUnitFeatures = 3;  ///< of a unit of one channel: N in eq. 6

/// Samples of a unit of `unit_s` at a rate: even, for the FFT is as long; 1/240 s: 200 at 48 kHz, 400 at 96, 184 at 44.1.
int unit_length(double unit_s, double rate_hz) noexcept;

/// f(x) = DCT(log(mel(x))) (eq. 6) of one unit: Hann window over it, FFT of its length, mean square in three rectangular
/// bands that are equally wide in mel(f) = 2595 log10(1 + f/700) from 0 to 20 kHz at every rate, ln(mean square + 1e-10),
/// orthonormal DCT-II. 5 dB more moves the first feature by 2.0. The same signal has the same features at every rate.
/// Construction allocates; one object serves one thread at a time.
class UnitFeatures {
 public:
  /// \pre unit_samples is even, at least 16
  UnitFeatures(int unit_samples, double rate_hz);

  int unit_samples() const noexcept { return fft_.size(); }

  /// Allocates nothing, takes no lock.
  /// \pre unit.size() == unit_samples(), features.size() == kUnitFeatures
  void operator()(std::span<const float> unit, std::span<float> features) noexcept;

 private:
  /// Shares of the bins [first, first + weights.size()) that lie in a band; the FFT's scale is in them.
  struct Band {
    std::size_t first = 0;
    std::vector<float> weights;
  };
  RealFft fft_;
  std::vector<float> window_;
  std::array<Band, kUnitFeatures> bands_;
};

/// Features of the whole units of a signal, [units][kUnitFeatures]; a last part of a unit is left out. Allocates.
std::vector<float> unit_features(std::span<const float> signal, int unit_samples, double rate_hz);

/// Taps of a Gaussian of σ = width/4 at the offsets -⌊width/2⌋ .. ⌊width/2⌋ (causal: .. 0), sum one; oldest first.
std::vector<double> gaussian_taps(int width, bool causal);

/// Temporal filtering: every dimension d of [units][dims] with a Gaussian of widths[d % widths.size()] units. Recordings do
/// not mix: recording r has the units [first_unit[r], first_unit[r + 1]). At its ends the taps that are left are normalised
/// to one.
/// \pre features.size() == first_unit.back() * dims; first_unit rises from 0
std::vector<float> filtered_features(std::span<const float> features, int dims, std::span<const int> widths,
                                     std::span<const std::uint32_t> first_unit, bool causal);

/// The causal filter unit by unit, the same bits as filtered_features. Construction allocates.
class CausalFeatureFilter {
 public:
  /// \pre dims ≥ 1, widths is not empty, each ≥ 1
  CausalFeatureFilter(int dims, std::span<const int> widths);

  /// The filtered features of the unit that `features` are of. Allocates nothing.
  /// \pre features.size() == filtered.size() == dims
  void push(std::span<const float> features, std::span<float> filtered) noexcept;
  /// The next unit is the first of a recording.
  void reset() noexcept { count_ = 0; }

 private:
  std::vector<std::vector<double>> taps_;  ///< [dims]
  std::vector<float> past_;                ///< [depth][dims], a ring
  std::size_t depth_ = 1;
  std::size_t count_ = 0;  ///< units pushed
};

}  // namespace rustle::dsp
