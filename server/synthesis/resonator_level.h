#pragma once

#include <cstddef>
#include <vector>

#include "server/observation/observation.h"
#include "server/spatial/dipole.h"
#include "server/synthesis/sound_model.h"

/// How loud a resonator is and how it radiates (P10). Pure. [analysis worker]
namespace rustle::synthesis {

inline constexpr double kSizeLimit_db = 6.0;          ///< of the corrected size factor
inline constexpr double kPublishedRadius_m = 0.0564;  ///< of the 10 x 10 cm sheet: where the printed a³ counts as 1
inline constexpr std::size_t kMaxResonators = 8;      ///< of one event or contact, the largest by area

/// Corrected: clamp((a/a_ref)³, ±6 dB), 1 for constrained units (radius_ref_m 0), since the unit already contains the size
/// it was recorded at. Published: a³, over that of the 10 x 10 cm sheet.
double size_factor(Mode mode, double radius_m, double reference_radius_m) noexcept;

/// One of an event's resonators and its part of the amplitude.
struct Share {
  std::size_t index = 0;  ///< in the event's list
  double amplitude = 1;   ///< corrected: √(area / total area), so that resonators share the event's power; published: 1
};

/// The kMaxResonators largest, in the event's order.
std::vector<Share> shares(Mode mode, const std::vector<observation::Resonator>& resonators);

/// The resonator as a dipole. Corrected: |cos θ| held above the spread of the normals and -20 dB, heights spread by the
/// covariance, no image in a touched plane. Published: a point without any of these.
spatial::Emitter emitter_of(Mode mode, const observation::Resonator& resonator) noexcept;

/// The resonator assumed where an event names none: constrained, horizontal.
observation::Resonator bare_resonator(const sheet::Vec3d& position_m, double area_m2);

}  // namespace rustle::synthesis
