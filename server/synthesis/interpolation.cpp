#include "server/synthesis/interpolation.h"

#include <algorithm>
#include <cstring>

#include "server/sheet/simd.h"

namespace rustle::synthesis {
namespace {

constexpr int kBlock = 16;
static_assert(kQuantum % kBlock == 0);

constexpr float kFractionUnit = 0x1.0p-24F;  ///< fractions count in these where they are floats

#if defined(__x86_64__)
const bool kWideRegisters = __builtin_cpu_supports("avx512f") != 0;  ///< thirty-two of sixteen floats
#else
constexpr bool kWideRegisters = false;
#endif
using Lanes = float __attribute__((vector_size(kBlock * sizeof(float))));
using FourLanes = float __attribute__((vector_size(4 * sizeof(float))));
constexpr std::size_t kAhead = 6;  ///< taps by which samples are called for early

/// A_k[m], m < kQuantum + 3.
using ShiftedSums = std::array<std::array<float, kQuantum + 4>, 4>;

template <class L>
[[gnu::always_inline]] inline void load(L& to, const float* x) noexcept {
  std::memcpy(&to, x, sizeof to);
}
template <class L>
[[gnu::always_inline]] inline void store(float* to, const L& x) noexcept {
  std::memcpy(to, &x, sizeof x);
}

/// Has the quantum that a tap reads brought to the nearest cache, line by line.
template <class Tap>
[[gnu::always_inline]] inline void call_for(std::span<Tap> taps, std::size_t at) noexcept {
  const float* x = taps[std::min(at, taps.size() - 1)].x;
  for (std::size_t line = 0; line <= kQuantum; line += 16) __builtin_prefetch(x + line);
}

/// Both kinds of taps in kBlocks blocks of the quantum from `from` on; still ones into sums. kLast: the sums' ends too.
template <std::size_t kBlocks, bool kLast>
[[gnu::always_inline]] inline void add_blocks(std::span<WholeTap> whole, std::span<StillTap> still, std::size_t from,
                                              ShiftedSums& sums, float* out) noexcept {
  std::array<Lanes, kBlocks> w;
  std::array<std::array<Lanes, kBlocks>, 4> a{};
  std::array<FourLanes, 4> ends{};
  const auto add_whole = [&](WholeTap & tap) __attribute__((always_inline)) {
    for (std::size_t b = 0; b < kBlocks; ++b) {
      Lanes x;
      load(x, tap.x + from + b * kBlock);
      w[b] += tap.gain * x;
    }
    if constexpr (kLast) tap.x += kQuantum;
  };
  const auto add_still = [&](StillTap & tap) __attribute__((always_inline)) {
    for (std::size_t b = 0; b < kBlocks; ++b) {
      Lanes x;
      load(x, tap.x + from + b * kBlock);
      for (std::size_t k = 0; k < 4; ++k) a[k][b] += tap.weights_gain[k] * x;
    }
    if constexpr (kLast) {
      FourLanes x;
      load(x, tap.x + kQuantum - 1);
      for (std::size_t k = 1; k < 4; ++k) ends[k] += tap.weights_gain[k] * x;
      tap.x += kQuantum;
    }
  };
  for (std::size_t b = 0; b < kBlocks; ++b) load(w[b], out + from + b * kBlock);
  const std::size_t both = std::min(whole.size(), still.size());
  for (std::size_t i = 0; i < both; ++i) {
    call_for(still, i + kAhead);
    call_for(whole, i + kAhead);
    add_still(still[i]);
    add_whole(whole[i]);
  }
  for (std::size_t i = both; i < still.size(); ++i) {
    call_for(still, i + kAhead);
    add_still(still[i]);
  }
  for (std::size_t i = both; i < whole.size(); ++i) add_whole(whole[i]);
  for (std::size_t b = 0; b < kBlocks; ++b) {
    store(out + from + b * kBlock, w[b]);
    for (std::size_t k = 0; k < 4; ++k) store(&sums[k][from + b * kBlock], a[k][b]);
  }
  if constexpr (kLast) {
    for (std::size_t k = 1; k < 4; ++k) store(&sums[k][kQuantum - 1], ends[k]);
  }
}

template <std::size_t kBlocks>
[[gnu::always_inline]] inline void add_taps_in(std::span<WholeTap> whole, std::span<StillTap> still, float* out) noexcept {
  constexpr std::size_t kLastFrom = kQuantum - kBlocks * kBlock;
  ShiftedSums sums;
  for (std::size_t from = 0; from < kLastFrom; from += kBlocks * kBlock)
    add_blocks<kBlocks, false>(whole, still, from, sums, out);
  add_blocks<kBlocks, true>(whole, still, kLastFrom, sums, out);
  for (std::size_t n = 0; n < kQuantum; ++n) out[n] += (sums[0][n] + sums[1][n + 1]) + (sums[2][n + 2] + sums[3][n + 3]);
}

/// With a quantum of every sum in registers at once, where they are enough and wide.
RUSTLE_SIMD void add_taps_wide(std::span<WholeTap> whole, std::span<StillTap> still, float* out) noexcept {
  add_taps_in<kQuantum / kBlock>(whole, still, out);
}

/// A block at a time, its sums in sixteen registers.
RUSTLE_SIMD void add_taps_narrow(std::span<WholeTap> whole, std::span<StillTap> still, float* out) noexcept {
  add_taps_in<1>(whole, still, out);
}

/// One tap by itself.
RUSTLE_SIMD void add_one(StillTap& tap, float* __restrict out) noexcept {
  const float* x = tap.x;
  const auto w = tap.weights_gain;
  for (int n = 0; n < kQuantum; ++n) out[n] += (w[0] * x[n] + w[1] * x[n + 1]) + (w[2] * x[n + 2] + w[3] * x[n + 3]);
  tap.x += kQuantum;
}

/// Where a block begins and what it is scaled by.
struct Block {
  const float* x;  ///< the sample before the position of its first output sample
  std::uint32_t fraction;
  std::uint32_t slide;
  float gain;
  float slope;
};

inline float as_float(std::uint32_t fraction) noexcept {
  return static_cast<float>(static_cast<std::int32_t>(fraction >> 8)) * kFractionUnit;
}

/// What x[0..3] give at 1 + f.
[[gnu::always_inline]] inline float cubic(const std::array<float, 4>& x, float f) noexcept {
  const float outer = (x[3] - x[0]) * (1.0F / 6);
  const float inner = (x[1] - x[2]) * 0.5F;
  const float treble = kTreble * ((x[1] + x[2]) - (x[0] + x[3]));
  const float c3 = outer + inner;
  const float c2 = ((x[0] + x[2]) * 0.5F - x[1]) - treble;
  const float c1 = (x[2] - x[1]) - (c2 + c3);
  return x[1] + f * (c1 + f * (c2 + f * c3));
}

/// kBlock output samples that read neighbouring samples.
[[gnu::always_inline]] inline void add_even_block(const Block& block, float* __restrict out) noexcept {
  const float* x = block.x;
  for (int n = 0; n < kBlock; ++n) {
    const float f = as_float(block.fraction + static_cast<std::uint32_t>(n) * block.slide);
    out[n] += (block.gain + block.slope * static_cast<float>(n)) * cubic({x[n], x[n + 1], x[n + 2], x[n + 3]}, f);
  }
}

/// The same where the position's fraction passes a whole sample once, so that those from `later` on read `carry` further.
[[gnu::always_inline]] inline void add_carried_block(const Block& block, int carry, int later,
                                                     float* __restrict out) noexcept {
  const float* x = block.x;
  const float* y = block.x + carry;
  for (int n = 0; n < kBlock; ++n) {
    const std::array<float, 4> near{x[n], x[n + 1], x[n + 2], x[n + 3]};
    const std::array<float, 4> far{y[n], y[n + 1], y[n + 2], y[n + 3]};
    const std::array<float, 4> read{n >= later ? far[0] : near[0], n >= later ? far[1] : near[1],
                                    n >= later ? far[2] : near[2], n >= later ? far[3] : near[3]};
    const float f = as_float(block.fraction + static_cast<std::uint32_t>(n) * block.slide);
    out[n] += (block.gain + block.slope * static_cast<float>(n)) * cubic(read, f);
  }
}

/// The first step of `slide` that carries the fraction to another whole sample. \pre slide ≠ 0
inline int carried_at(std::uint32_t fraction, std::int32_t slide) noexcept {
  const auto from = static_cast<Position>(fraction);
  const Position steps = slide > 0 ? (kWholeSample - from + slide - 1) / slide : from / -Position{slide} + 1;
  return static_cast<int>(steps);
}

}  // namespace

std::array<float, 4> weights(Position fraction, float gain) noexcept {
  const double f = static_cast<double>(fraction) / static_cast<double>(kWholeSample);
  const double g = static_cast<double>(gain);
  const double treble = static_cast<double>(kTreble) * f * (1 - f);
  return {static_cast<float>(g * (-f * (f - 1) * (f - 2) / 6 - treble)),
          static_cast<float>(g * ((f + 1) * (f - 1) * (f - 2) / 2 + treble)),
          static_cast<float>(g * (-(f + 1) * f * (f - 2) / 2 + treble)),
          static_cast<float>(g * ((f + 1) * f * (f - 1) / 6 - treble))};
}

void add_taps(std::span<WholeTap> whole, std::span<StillTap> still, float* out) noexcept {
  if (whole.empty() && still.size() == 1) {
    add_one(still.front(), out);
  } else if (kWideRegisters) {
    add_taps_wide(whole, still, out);
  } else {
    add_taps_narrow(whole, still, out);
  }
}

RUSTLE_SIMD void add_moving(const MovingTap& tap, float* out) noexcept {
  Position at = tap.first;
  for (int from = 0; from < kQuantum; from += kBlock, at += Position{kBlock} * tap.slide) {
    const Position whole = at >> 32;
    const Position carried = ((at + Position{kBlock - 1} * tap.slide) >> 32) - whole;
    const Block block{tap.x + whole + from - 1, static_cast<std::uint32_t>(at), static_cast<std::uint32_t>(tap.slide),
                      tap.gain + tap.slope * static_cast<float>(from), tap.slope};
    if (carried == 0) {
      add_even_block(block, out + from);
    } else if (carried == 1 || carried == -1) {
      add_carried_block(block, static_cast<int>(carried), carried_at(block.fraction, tap.slide), out + from);
    } else {
      for (int n = 0; n < kBlock; ++n) {
        const Position position = at + Position{n} * tap.slide;
        const float* x = tap.x + (position >> 32) + from + n - 1;
        out[from + n] += (block.gain + block.slope * static_cast<float>(n)) *
                         cubic({x[0], x[1], x[2], x[3]}, as_float(static_cast<std::uint32_t>(position)));
      }
    }
  }
}

}  // namespace rustle::synthesis
