#pragma once

#include <memory>

#include "server/synthesis/sound_model.h"

namespace rustle::synthesis {

inline constexpr double kUnrenewed_s = 0.25;  ///< a source that no cue renews for so long after its last control point ...
inline constexpr double kUnrenewedFade_s = 0.05;  ///< ... fades
inline constexpr double kLongestDelay_s = 0.17;   ///< of one path beyond the direct one: 58 m

/// Render half of paper friction (P8, P10; Schreck et al. 2016, eq. 6): random-phase blocks of N samples (RenderOptions::
/// friction_fft_size) under a sine window, overlapped by half; block k starts at sample k N/2 of the session.
///   X_c(ω) = √N Σ_sources a E(ω) Σ_paths g_pc B_pc(ω) e^{-iω τ_pc} Q_p(ω)
///   Q_p = γ_p P + √(1 - γ_p²) I_p,   γ_p = exp(-(ω σ_t)²/2)
/// E: the source's emission; a = gain · exp(σ n - σ²), n the slow random gain, Gaussian, below cutoff · v/v_ref; g the
/// path's gain; B: 1, or an ear's response to the path's direction; P: the source's random phases, I_p: those of one image,
/// by which the cross term of an extended source fades without changing its power. Phases come from a hash of (source,
/// block, bin), so a path that is k whole hops longer takes the phases and the amplitude of k blocks before, whole eighths
/// of a hop start its blocks later, real delays both, and only the rest, a sixteenth of a hop at most, goes into the phase.
/// The window widens each notch by half a bin rms. The two channels share their phases. Published: one P for all
/// sources, without σ_t and n. Controls are read at a block's start, what comes later not being known yet: the sound
/// follows them by N/2 samples. A source's first and last block are its fades.
/// \pre the FFT size is a power of two, 128 to 8192. [render worker]
std::unique_ptr<RenderModel> make_friction_noise(const RenderOptions& options);

}  // namespace rustle::synthesis
