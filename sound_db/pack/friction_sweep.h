#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "sound_db/dsp/spectrum_blend.h"

namespace rustle::pack {

inline constexpr double kFrictionClip_s = 0.050;  ///< of cloth's friction noise; the hop is half of it

/// FFT size of a clip at a rate: a multiple of 2, its hop a whole number of samples; 2400 at 48 kHz.
int friction_clip_length(double rate_hz) noexcept;

/// The speed whose friction a simulated one sounds of, s ← (s / divisor)^exponent in m/s: brings cloth that slides faster
/// than was measured into range, and with an exponent above 1 subdues its slow contacts (An et al. 2012, section 5, where
/// characters have a divisor of 4). 1 and 1: the same.
struct SpeedCompression {
  double divisor = 1;
  double exponent = 1;
  double operator()(double speed_m_per_s) const noexcept;
  friend bool operator==(const SpeedCompression&, const SpeedCompression&) = default;
};

/// What cloth sounds like sliding at some speeds (An et al. 2012, section 2): spectra A_i at speeds s_i, of a patch of a
/// known area. Magnitudes are as in Spectrum: white noise of unit variance per sample has magnitude 1 in every bin, so that
/// the same sound has the same RMS, √(mean M²), at every FFT size.
struct FrictionSweep {
  std::string file;                      ///< of the spectra, [speeds][bins]
  std::vector<double> speeds_m_per_s;    ///< rising, above 0, at least one
  std::uint32_t fft_size = 2400;         ///< friction_clip_length(rate) as loaded
  std::vector<float> magnitudes;         ///< [speeds][fft_size / 2 + 1], the manifest's gain applied
  std::vector<double> rms;               ///< [speeds] of each spectrum's noise
  double patch_area_m2 = 0.01;           ///< A_patch of the vertex gain √(A_v / A_patch) (C1)
  double speed_threshold_m_per_s = 0.0;  ///< s_thresh: what has not yet been faster is silent
  SpeedCompression compression;          ///< of the sheet's speeds; the spectra's are not
  std::size_t bins() const noexcept { return fft_size / 2 + 1; }
  std::span<const float> spectrum(std::size_t speed) const noexcept {
    return std::span(magnitudes).subspan(speed * bins(), bins());
  }
  friend bool operator==(const FrictionSweep&, const FrictionSweep&) = default;
};

/// RMS of a patch's sound at a speed: linear between the measured speeds, (s/s₀)² below the slowest, constant above the
/// fastest, 0 at rest. Allocates nothing.
double friction_rms(const FrictionSweep& sweep, double speed_m_per_s) noexcept;

/// A(f, s) (eqs. 1-3) at any speed: between two measured ones their inverse CDFs are blended (SpectrumBlend) and the result
/// is given friction_rms; below the slowest and above the fastest their spectra with friction_rms.
class FrictionSpectra {
 public:
  /// Allocates. `sweep` outlives this.
  explicit FrictionSpectra(const FrictionSweep& sweep);

  /// Magnitudes at a speed; zeros at 0 and below. O(bins), allocates nothing, any thread.
  /// \pre out.size() == sweep.bins()
  void at(double speed_m_per_s, std::span<float> out) const noexcept;

 private:
  const FrictionSweep& sweep_;
  std::vector<dsp::SpectrumBlend> blends_;  ///< between neighbouring speeds
};

}  // namespace rustle::pack
