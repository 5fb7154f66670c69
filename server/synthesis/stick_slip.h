#pragma once

#include <cstdint>
#include <vector>

#include "server/synthesis/cue.h"

/// What a sheet that stuck does before it slides evenly (P8): it comes loose in slips, each a burst of the friction's own
/// noise, the first the strongest.
namespace rustle::synthesis {

inline constexpr double kStuckRatio = 0.02;    ///< below this share of the reference speed a contact sticks
inline constexpr double kLooseRatio = 0.05;    ///< from this share on a contact that stuck has come loose
inline constexpr double kSlipsLast_s = 0.050;  ///< from the first slip on
inline constexpr double kSlipDecay_s = 0.003;  ///< of one slip's amplitude by 1/e
inline constexpr double kSlip_s = 0.015;       ///< one slip

/// One slip after the sheet came loose.
struct Slip {
  SampleTime after = 0;  ///< samples
  double gain = 1;       ///< against even sliding
};

/// The slips of one coming loose: the first at once, then gaps drawn log-uniformly from 4 to 16 ms, gains 2 exp(-t/20 ms).
/// From the seed alone. Allocates; pure.
std::vector<Slip> slips(std::uint64_t seed, double rate_hz);

/// The sound of a slip: one block of random-phase noise of the given emission, as even sliding sounds, that comes up within
/// 0.2 ms and dies away by kSlipDecay_s. \pre emission has a power of two plus one elements, at least 65
std::vector<float> slip_unit(const std::vector<float>& emission, double rate_hz, std::uint64_t seed);

}  // namespace rustle::synthesis
