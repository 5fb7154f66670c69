#pragma once

#include <memory>

#include "server/synthesis/sound_model.h"

namespace rustle::synthesis {

inline constexpr double kVoiceRamp_s = 0.002;  ///< of a raised and of a stolen voice, rounded up to whole quanta
inline constexpr int kFadingVoices = 64;       ///< stolen voices that may fade beside the sounding ones

/// Render half of paper crumpling (P9; Schreck et al. 2016, eq. 5): units played whole, from their sample, through one tap
/// per path and channel,
///   out(n) = Σ_p gain_p(n) · u(n - onset - delay_p(n))        u by 4-point interpolation
/// Gains and delays are computed at the ends of each quantum and go straight in between; a delay that jumps by more than 8
/// samples is cross-faded. Paths below -100 dB are left out. A voice's emitter goes along with its sheet as
/// EmitterMotionCues tell. Above max_voices the voice that is quietest over the next 10 ms goes, faded. Voices are summed
/// in an order that their cues fix; binaural ones go through EarFilters, each ear at its own delay; for every instruction
/// set the same bits come out. Units are read, never owned. [render worker]
std::unique_ptr<RenderModel> make_voices(const RenderOptions& options);

}  // namespace rustle::synthesis
