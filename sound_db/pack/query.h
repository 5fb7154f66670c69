#pragma once

#include <cstdint>
#include <vector>

#include "sound_db/pack/sound_pack.h"

/// Which of a pack's sounds a resonator takes (P7).
namespace rustle::pack {

/// The spectrum of the grid point nearest in (l_r, l_c/2) by Euclidean distance, ties to the first; of (0,0) for a
/// constrained `wanted`. Null when the section has none of that kind.
const Spectrum* nearest_spectrum(const FrictionSection& section, const GridPoint& wanted);

/// The units of the nearest grid point as indices into section.units, rising; empty when there are none of that kind.
std::vector<std::uint32_t> nearest_variants(const CrumplingSection& section, const GridPoint& wanted);

inline constexpr std::uint32_t kNoUnit = UINT32_MAX;

/// One of `variants` by a random number in [0, 1), never `last` (the unit that sounded before; kNoUnit at the start) when
/// there is another. kNoUnit when there are none.
std::uint32_t choose_variant(const std::vector<std::uint32_t>& variants, double uniform, std::uint32_t last) noexcept;

}  // namespace rustle::pack
