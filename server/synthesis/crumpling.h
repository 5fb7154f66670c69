#pragma once

#include <memory>

#include "server/synthesis/sound_model.h"

namespace rustle::synthesis {

inline constexpr double kMaxCrumpling_db = 12.0;  ///< an event is never louder than this over what its unit was made for
inline constexpr double kRaiseWindow_s = 0.1;     ///< a later continuation starts a voice of its own
/// Vertices per area of an A4 sheet of 1333 triangles: turns the paper's Σ|ΔH| (1/m) into Σ A |ΔH| (m).
inline constexpr double kPublishedVertices_per_m2 = 11200.0;

/// Plan half of paper crumpling (P7, P9, P10): one unit per resonator of an event,
///   corrected  gain = min(A / A_ref, +12 dB) · clamp((a/a_ref)³, ±6 dB) · √(area share) / |H_ref|
///   published  gain = Σ|ΔH| / (A_ref · kPublishedVertices_per_m2) · (a / 5.6 cm)³ / |H_ref|
/// A is the event's amplitude in metres and A_ref what the unit was made for. The cap keeps the flip of a large constrained
/// region, whose clac was made for a millimetre, from exploding. Nearest (l_r, l_c/2), (0,0) when constrained, a variant
/// drawn from hash(seed, sheet, event, resonator), not the same twice running. Events wait until `release` reaches their
/// start, so that an event which continues a waiting one adds to its amplitude (the resonators of the larger are kept); one
/// that comes later raises its voices within 100 ms of its onset, and starts voices of its own after that. Order of release:
/// by start, then by event. Each event carries a burst of fine events, and bending that lasts feeds more of them (P13, see
/// fine_events.h); they are released likewise. [analysis worker]
std::unique_ptr<PlanModel> make_crumpling_plan(const PlanOptions& options);

}  // namespace rustle::synthesis
