#pragma once

#include <memory>

#include "server/synthesis/sound_model.h"

namespace rustle::synthesis {

inline constexpr double kTearUnrenewed_s = 0.25;      ///< a tip that no cue renews for so long ...
inline constexpr double kTearUnrenewedFade_s = 0.05;  ///< ... stops within this

/// Render half of tearing (T4, T6; Lejemble et al. 2015, section 5): per tip
///   y(n) = gain (v/v0) w(n) g(s),   s = ∫ v dt the torn length
/// w: white Gaussian noise, seeded by the tip; g: TearGate, or as printed PublishedTearGate (tear_gate.h); v straight
/// between control points. y goes through the cue's colour, one filter fading into the next between control points, then
/// along its paths (SourcePaths). Above max_tears, a new tip takes the place of one that rests, else it is not begun.
/// [render worker]
std::unique_ptr<RenderModel> make_tear_noise(const RenderOptions& options);

}  // namespace rustle::synthesis
