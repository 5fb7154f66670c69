#pragma once

#include <memory>

#include "server/synthesis/sound_model.h"

namespace rustle::synthesis {

inline constexpr double kReferenceTear_dbfs = -32;             ///< RMS at kReferenceTearSpeed_m_per_s, 1 m on the axis
inline constexpr double kReferenceGrammage_kg_per_m2 = 0.080;  ///< printer paper's, which that level is for
inline constexpr double kLeastTearRamp_s = 0.005;              ///< no control point is reached faster
inline constexpr double kTearEnd_s = 0.02;                     ///< how long the tips of an ended sheet fade

/// Plan half of tearing (T4, T6): one source per tip, at the tip, with the normal of the resonator there,
///   corrected  gain = -32 dBFS · grammage / (80 g/m²), coloured by the friction spectrum of that resonator (tear_colour.h)
///   published  gain = -32 dBFS
/// with control points at the frames' times, straight in between: what a tip goes between two frames it is heard to go over
/// the time from the frame before to the frame after. Of several resonators the largest that is not constrained counts. A
/// tip that is missing from an observation has stopped by its time. A source is (sheet, tip, how often that began); its
/// noise and breaks are seeded by them and the session's seed. [analysis worker]
std::unique_ptr<PlanModel> make_tearing_plan(const PlanOptions& options);

}  // namespace rustle::synthesis
