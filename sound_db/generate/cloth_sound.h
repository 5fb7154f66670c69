#pragma once

#include <cstdint>
#include <vector>

#include "sound_db/dsp/random.h"
#include "sound_db/generate/cloth_material.h"
#include "sound_db/generate/cloth_motion.h"

/// The sound of generated cloth. Each is deterministic in its arguments.
namespace rustle::generate {

/// Sliding: noise in blocks of 512 samples whose bands follow the speed, irregular in loudness, place and tilt; ribs with a
/// wale spacing make it pulse at speed / spacing, each rib with a click of its own. RMS level · (s/0.5)^exponent.
std::vector<float> cloth_friction(const ClothMaterial& material, const ClothMotion& motion, double rate_hz,
                                  dsp::Random random);

/// A burst of one to a few pops within about 20 ms, their energies a power law over four decades, drawn; peak at most about
/// material.pop_level · gain. From its onset to where it has died away.
std::vector<float> cloth_pops(const ClothMaterial& material, double rate_hz, dsp::Random& random, double gain = 1);

/// Bursts at a rate that follows the motion's crumpling, louder where there is more of it.
std::vector<float> cloth_crumpling(const ClothMaterial& material, const ClothMotion& motion, double rate_hz,
                                   dsp::Random random);

/// Both, and a quiet room around them: as a microphone would have recorded the motion.
std::vector<float> cloth_recording(const ClothMaterial& material, const ClothMotion& motion, double rate_hz,
                                   std::uint64_t seed);

}  // namespace rustle::generate
