#pragma once

#include <memory>

#include "server/synthesis/sound_model.h"

namespace rustle::synthesis {

inline constexpr double kMaxSpeedRatio = 100.0;  ///< speeds above 100 times the pack's reference sound no louder
inline constexpr double kLeastRamp_s = 0.005;    ///< no control point is reached faster
inline constexpr double kMostLoadFactor = 31.6;  ///< a contact that is pressed harder sounds no louder
inline constexpr double kFrictionEnd_s = 0.02;   ///< how long the sources of an ended sheet fade

/// Plan half of paper friction (P7, P8, P10): one source per resonator of each contact,
///   corrected  gain = (v/v_ref)^exponent · clamp((a/a_ref)³, ±6 dB) · √(area share) · √(contact share) · load factor
///   published  gain = (v/v_ref) · (a / 5.6 cm)³
/// The load factor is √(F / (σ g A)), at most 30 dB, for a contact of area A that is pressed by a force F the simulator
/// sent, σ the sheet's mass per area: what rubs does the work µ F v. It is 1 where no force is known, as where a sheet lies
/// under its own weight. with control points at the frames' times, straight in between. A contact or resonator that is
/// missing from an observation has faded out by its time; one that appears has come up from the frame before. A source is
/// (sheet, episode, place of the resonator in the contact's list); its noise is seeded by them and the session's seed. A
/// sheet that was given another pack has sources of its own for it: the old ones fade while they come up. Corrected, a
/// contact that stuck comes loose in slips (stick_slip.h), which are units of their own. [analysis worker]
std::unique_ptr<PlanModel> make_friction_plan(const PlanOptions& options);

}  // namespace rustle::synthesis
