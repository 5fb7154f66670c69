#pragma once

#include <vector>

#include "sound_db/pack/sound_pack.h"

/// What a resonator emits, from what was heard of it at the pack's recording geometry (P10). On the dipole's axis, 1 m away
/// without reflections, the emission is heard as it stands.
namespace rustle::pack {

inline constexpr double kSoundSpeed_m_per_s = 343.0;
inline constexpr double kLeastImageHeight_m = 0.002;  ///< of a source above the plane that mirrors it

/// Where one dipole over a reflecting plane and its listener are: the plane is z = 0, the dipole points up at mean height
/// height_m, the heights of its parts having the standard deviation height_spread_m.
struct DipoleOverPlane {
  double height_m = 0;
  double height_spread_m = 0;
  double listener_distance_m = 1;  ///< from the foot of the dipole on the plane
  double listener_elevation_deg = 30;
};

/// |H| of the direct path and its image (Schreck et al. 2016, eq. 6 without a³), the cross term losing coherence over the
/// extent of the source (P10):
///   |H|² = g₀² + g₁² + 2 g₀ g₁ cos(ω Δt) exp(-(ω σ_t)²/2),   σ_t = spread ∂Δt/∂h,   g = cosθ/R
double transfer_magnitude(const DipoleOverPlane& dipole, double frequency_hz) noexcept;

/// |H_ref|, what the recording of a spectrum at `point` is divided by, for one frequency each. Bent sheet over a plane:
/// transfer_magnitude, never below 0.3 of its RMS over 0-24 kHz, lest a notch of the recording become a peak. Flat sheet, or
/// no plane: cosθ/R.
std::vector<double> reference_transfer(const RecordingGeometry& geometry, const GridPoint& point,
                                       const std::vector<double>& frequencies_hz);

/// Emission magnitudes for `bins` bins at `rate_hz`: heard / |H_ref|, at the section's reference speed.
/// \pre spectrum.magnitudes has section.fft_size / 2 + 1 bins at section.rate_hz; bins ≥ 2
std::vector<float> emission_spectrum(const FrictionSection& section, const Spectrum& spectrum, int bins, double rate_hz);

/// The gain that turns units as heard at the section's geometry into emission: R/cosθ (units are recorded without a plane).
double emission_gain(const RecordingGeometry& geometry) noexcept;

}  // namespace rustle::pack
