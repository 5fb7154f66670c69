#pragma once

#include <vector>

#include "sound_db/generate/paper.h"
#include "sound_db/pack/sound_pack.h"

namespace rustle::generate {

inline constexpr double kFrictionCompression = 0.30;

/// Corner of a bent sheet's friction, b √(f_l² + (1 kHz)²), f_l = 6500 (l_r / 0.1)^-0.75 [(1 + (l_c / 0.2)²) / 2]^-0.55 Hz,
/// b the paper's brightness. The lowest corner keeps the largest sheets as bright as the dullest real slides.
double friction_corner_hz(const Paper& paper, const pack::GridPoint& point);

/// Friction at 0.1 m/s as heard on a table, 1 m away, 30° up, for `bins` bins at `rate_hz`; amplitudes relative to the bent
/// 10 x 10 cm sheet, whose RMS over 100 Hz to 16 kHz is 1:
///   S = h [ banding (1 + (f/f_c)²)^-1 + hiss ],  h a high-pass at 250 Hz,  amplitude ∝ √a,
///   hiss = 0.05 b min(1, f_c / b 3 kHz)^⅕
/// banding: 3 dB rms √(0.04 / η) from the curved sheet's modes, faded out from 2.5 to 6 kHz; a power of f keeps the centroid
/// (50 Hz to 15 kHz) where it is without banding, so that it falls with l_r and with l_c. Flat (0,0):
/// h (1 + (f / b 14 kHz)²)^-½, 11 dB below.
std::vector<float> friction_heard(const Paper& paper, const pack::GridPoint& point, int bins, double rate_hz);

}  // namespace rustle::generate
