#pragma once

#include <array>
#include <cstdint>
#include <span>

#include "server/synthesis/cue.h"
#include "server/synthesis/nonblocking.h"

/// Reading a sound at any position by 4-point (cubic) interpolation, a quantum at a time: at the position i + f, 0 ≤ f < 1,
///   y = Σ_k w_k(f) x[i-1+k]
///   w = -f(f-1)(f-2)/6, (f+1)(f-1)(f-2)/2, -(f+1)f(f-2)/2, (f+1)f(f-1)/6   (Lagrange)
///       + b f(1-f) (-1, 1, 1, -1)
/// Lagrange's polynomial alone loses 0.53 dB at 10 kHz of 48 half way between samples; the second line gives back 0.15 dB
/// there and moves a tone of 1 kHz by 0.002 dB. Every sum is in one order, so that all instruction sets give the same bits.
/// Pure. [render worker]
namespace rustle::synthesis {

inline constexpr float kTreble = 0.03F;  ///< b

/// Positions in a sound: 2⁻³² samples.
using Position = std::int64_t;
inline constexpr Position kWholeSample = Position{1} << 32;

/// A reading of whole samples.
struct WholeTap {
  const float* x = nullptr;
  float gain = 0;
};

/// A reading that neither moves nor changes its gain.
struct StillTap {
  const float* x = nullptr;             ///< the first of the four samples that the first output sample is made of
  std::array<float, 4> weights_gain{};  ///< w · gain
};

/// w(fraction) · gain; exactly (0, gain, 0, 0) where the fraction is 0.
std::array<float, 4> weights(Position fraction, float gain) noexcept RUSTLE_NONBLOCKING;

/// Adds what taps read, in one pass over their samples, and moves them a quantum on:
///   W[n] = out[n] + Σ_whole gain x[n],   A_k[m] = Σ_still weights_gain[k] x[m],
///   out[n] = W[n] + ((A_0[n] + A_1[n+1]) + (A_2[n+2] + A_3[n+3])),
/// Σ tap after tap. Each sample is loaded once, the four shifts coming after the sum over taps, not before.
/// \pre x of a whole tap and out have kQuantum samples, x of a still one kQuantum + 3
void add_taps(std::span<WholeTap> whole, std::span<StillTap> still, float* out) noexcept RUSTLE_NONBLOCKING;

/// A reading that moves at an even pace while its gain goes straight.
struct MovingTap {
  const float* x = nullptr;  ///< sample 0; readings need it from ⌊position⌋ - 1 to ⌊position⌋ + 2, and touch one beside
  Position first = 0;        ///< position of the first output sample
  std::int32_t slide = 0;  ///< step of the position less one sample
  float gain = 0;          ///< at the first output sample
  float slope = 0;         ///< per sample
};

/// out[n] += (gain + slope n) · y(first + n (1 + slide)).
/// \pre |slide| ≤ kWholeSample / 8, out has kQuantum samples
void add_moving(const MovingTap& tap, float* out) noexcept RUSTLE_NONBLOCKING;

}  // namespace rustle::synthesis
