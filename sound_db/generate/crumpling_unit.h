#pragma once

#include <vector>

#include "sound_db/dsp/random.h"
#include "sound_db/generate/paper.h"
#include "sound_db/generate/sheet_response.h"
#include "sound_db/pack/sound_pack.h"

namespace rustle::generate {

inline constexpr double kFlapCompression = 0.10;

/// Corner of a flap's spectrum, b the paper's brightness times 5200 (l_r / 0.1)^-0.4 (l_c / 0.2)^-0.33 Hz, levelled_off()
/// from 10 kHz: facets of a few centimetres flap no brighter than real ones.
double flap_corner_hz(const Paper& paper, const pack::GridPoint& point);

/// Centroid that every flap of this size has: that of the noise with this corner, its low cut and slope, 50 Hz to 15 kHz.
double flap_centroid_hz(const Paper& paper, const pack::GridPoint& point);

/// From the unit's start to its snap: the sheet is on its way to its new shape for an eighth of the period of its lowest
/// mode, held within 3-25 ms, so that the picture stays with the sound.
double flap_way_s(const Paper& paper, const pack::GridPoint& point);

/// A flap: the sheet's whole bend (10 %) reversed.
///   the way   a rustle that swells, and a few small facets that turn before the rest; H passes through 0 as it starts
///   the snap  the sheet comes to rest in its new shape: three blows within 2 ms, the loudest of the unit
///   after     facets that turn late, crackle x 24 x size of them, log-uniform over 4-350 ms (x size), energies Pareto 1.4,
///             fading with time, all together crackle times the snap and none above a quarter of it; each in one of seven
///             parts of the sheet, which answer with blow(), their corners and formants scattered around the sheet's
///   beneath   9 dB below, its lowest modes; 8 dB (÷ crackle) below, noise of the moving sheet under a slow random gain
/// A first-order shelf at 3 kHz then brings the whole to flap_centroid_hz. 200-800 ms; peak √size, size = a / a(10 x 10 cm).
/// \pre point is not constrained
std::vector<float> flap(const Paper& paper, const pack::GridPoint& point, double rate_hz, dsp::Random random,
                        Workspace& workspace);

/// A clac: one to four facets of 5-25 mm, their centres b 8000 (ℓ / 5 mm)^-0.86 Hz, energies ∝ ℓ times Pareto 1.4, each a
/// crack about a millisecond long and its ring, T60 = 2.2 / (η f) and no more than 13 ms; 26 dB below, layers that rub for 8
/// ms. A shelf at 3 kHz brings its centroid half way (in octaves) to b^¾ 4.25 kHz, within 3.8-6.8 kHz, where real ones lie.
/// Its peak is 11 dB below that of the 10 x 10 cm flap, give or take 3 dB.
std::vector<float> clac(const Paper& paper, double rate_hz, dsp::Random random, Workspace& workspace);

}  // namespace rustle::generate
