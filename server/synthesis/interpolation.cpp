#include "server/synthesis/interpolation.h"

#include "server/sheet/simd.h"

namespace rustle::synthesis {
namespace {

constexpr int kBlock = 16;
static_assert(kQuantum % kBlock == 0);

constexpr float kFractionUnit = 0x1.0p-24F;  ///< fractions count in these where they are floats

constexpr std::size_t kTogether = 4;  ///< taps added in one pass over the output, each after the other all the same

template <std::size_t kTaps>
[[gnu::always_inline]] inline void add_whole_taps(const WholeTap* taps, float* __restrict out) noexcept {
  std::array<const float*, kTaps> x;
  std::array<float, kTaps> gain;
  for (std::size_t k = 0; k < kTaps; ++k) {
    x[k] = taps[k].x;
    gain[k] = taps[k].gain;
  }
  for (int n = 0; n < kQuantum; ++n) {
    float sum = out[n];
    for (std::size_t k = 0; k < kTaps; ++k) sum += gain[k] * x[k][n];
    out[n] = sum;
  }
}

template <std::size_t kTaps>
[[gnu::always_inline]] inline void add_still_taps(const StillTap* taps, float* __restrict out) noexcept {
  std::array<const float*, kTaps> x;
  std::array<std::array<float, 4>, kTaps> w;
  for (std::size_t k = 0; k < kTaps; ++k) {
    x[k] = taps[k].x;
    w[k] = taps[k].weights_gain;
  }
  for (int n = 0; n < kQuantum; ++n) {
    float sum = out[n];
    for (std::size_t k = 0; k < kTaps; ++k) {
      sum += (w[k][0] * x[k][n] + w[k][1] * x[k][n + 1]) + (w[k][2] * x[k][n + 2] + w[k][3] * x[k][n + 3]);
    }
    out[n] = sum;
  }
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

RUSTLE_SIMD void add_whole(std::span<const WholeTap> taps, float* out) noexcept {
  const WholeTap* tap = taps.data();
  std::size_t left = taps.size();
  for (; left >= kTogether; left -= kTogether, tap += kTogether) add_whole_taps<kTogether>(tap, out);
  for (; left > 0; --left, ++tap) add_whole_taps<1>(tap, out);
}

RUSTLE_SIMD void add_still(std::span<const StillTap> taps, float* out) noexcept {
  const StillTap* tap = taps.data();
  std::size_t left = taps.size();
  for (; left >= kTogether; left -= kTogether, tap += kTogether) add_still_taps<kTogether>(tap, out);
  for (; left > 0; --left, ++tap) add_still_taps<1>(tap, out);
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
