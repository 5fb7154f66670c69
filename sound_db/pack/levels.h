#pragma once

#include <optional>

#include "sound_db/pack/sound_pack.h"

/// The reference events that fix loudness: heard at 1 m on the axis without reflections.
namespace rustle::pack {

inline constexpr double kReferenceFlapPeak_dbfs = -20.0;
inline constexpr double kReferenceFriction_dbfs = -32.0;
inline constexpr GridPoint kReferencePoint{0.10, 0.20};  ///< the 10 x 10 cm sheet

/// Mean over the variants of the peak of the reference sheet's flap (whole bend reversed); nothing without units.
std::optional<double> reference_flap_peak_dbfs(const CrumplingSection& section);

/// RMS of the reference sheet's friction at 0.1 m/s; nothing without spectra.
std::optional<double> reference_friction_dbfs(const FrictionSection& section);

}  // namespace rustle::pack
