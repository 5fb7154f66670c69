#include "server/synthesis/noise_spectrum.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>

#include "server/sheet/simd.h"

namespace rustle::synthesis {
namespace {

using Lanes = float __attribute__((vector_size(kBinLanes * sizeof(float))));
using Words = std::uint32_t __attribute__((vector_size(kBinLanes * sizeof(float))));
constexpr std::uint32_t kStride = 0x9E3779B9;
constexpr std::uint32_t kDraws = 16;  ///< quarter turns in 32 bits

/// exp(-i k φ) of 2 kBinLanes bins, and the turn that leads to the next ones.
struct Rotor {
  BinLanes re[2], im[2];
  float turn_re = 0, turn_im = 0;
};

void make_rotor(double amplitude, double radians_per_bin, Rotor& rotor) noexcept {
  alignas(64) std::array<float, 2 * kBinLanes> re{}, im{};
  re[0] = static_cast<float>(amplitude);
  double c = std::cos(radians_per_bin), s = -std::sin(radians_per_bin);
  for (std::size_t known = 1; known < re.size(); known *= 2) {
    const auto p = static_cast<float>(c), q = static_cast<float>(s);
    for (std::size_t j = 0; j < known; ++j) {
      re[known + j] = re[j] * p - im[j] * q;
      im[known + j] = re[j] * q + im[j] * p;
    }
    const double twice = c * c - s * s;
    s = 2 * c * s;
    c = twice;
  }
  std::memcpy(&rotor.re[0].at, re.data(), sizeof rotor.re);
  std::memcpy(&rotor.im[0].at, im.data(), sizeof rotor.im);
  rotor.turn_re = static_cast<float>(c);
  rotor.turn_im = static_cast<float>(s);
}

/// The rotor, two groups further.
inline __attribute__((always_inline)) void turn(Rotor& r) noexcept {
  for (int k = 0; k < 2; ++k) {
    const BinLanes re{r.re[k].at * r.turn_re - r.im[k].at * r.turn_im};
    r.im[k].at = r.re[k].at * r.turn_im + r.im[k].at * r.turn_re;
    r.re[k] = re;
  }
}

/// Runs `sink(group, re, im)` over all groups. Two groups at a time: one waits for the other's turn.
template <class Sink>
inline __attribute__((always_inline)) void rotate(const Rotor& rotor, std::size_t groups, const Sink& sink) noexcept {
  Rotor now = rotor;
  for (std::size_t g = 0; g < groups; g += 2) {
    sink(g, now.re[0], now.im[0]);
    sink(g + 1, now.re[1], now.im[1]);
    turn(now);
  }
}

RUSTLE_SIMD void add_rotating(const Rotor& rotor, std::size_t groups, BinLanes* re, BinLanes* im) noexcept {
  rotate(
      rotor, groups, [&](std::size_t g, const BinLanes& a, const BinLanes& b) __attribute__((always_inline)) {
        re[g].at += a.at;
        im[g].at += b.at;
      });
}

/// √x of lanes in [0, 1] within 0.2 % of it, by one of Newton's steps, since the processors' own root is not pipelined.
inline __attribute__((always_inline)) void square_root(BinLanes& x) noexcept {
  BinLanes inverse{reinterpret_cast<Lanes>(0x5F3759DFU - (reinterpret_cast<Words>(x.at) >> 1))};
  inverse.at *= 1.5F - 0.5F * x.at * inverse.at * inverse.at;
  x.at *= inverse.at;
}

RUSTLE_SIMD void add_rotating(const Rotor& rotor, const BinLanes* gamma, const BinLanes* rest, std::size_t groups,
                              BinLanes* shared_re, BinLanes* shared_im, BinLanes* own_re, BinLanes* own_im) noexcept {
  rotate(
      rotor, groups, [&](std::size_t g, const BinLanes& a, const BinLanes& b) __attribute__((always_inline)) {
        shared_re[g].at += gamma[g].at * a.at;
        shared_im[g].at += gamma[g].at * b.at;
        own_re[g].at += rest[g].at * a.at;
        own_im[g].at += rest[g].at * b.at;
      });
}

/// gamma_k of the groups one after the other: gamma of the group that comes, and what leads to the next.
struct Falling {
  BinLanes value, ratio;
  float shrink = 0;
};

Falling make_falling(double x) noexcept {
  const double first = std::exp(-0.5 * x * x), step = first * first;
  double shrink = first;  // first^(2 kBinLanes)
  for (std::size_t k = 1; k < 2 * kBinLanes; k *= 2) shrink *= shrink;
  double power = first;  // first^(kBinLanes²)
  for (std::size_t k = 1; k < kBinLanes * kBinLanes; k *= 2) power *= power;
  Falling out;
  double v = 1, fall = first, r = power;
  for (std::size_t j = 0; j < kBinLanes; ++j) {
    out.value.at[j] = static_cast<float>(v);
    out.ratio.at[j] = static_cast<float>(r);
    v *= fall;
    fall *= step;
    r *= shrink;
  }
  out.shrink = static_cast<float>(power * power);
  return out;
}

/// gamma and rest of the group that comes; goes on to the next.
inline __attribute__((always_inline)) void next(Falling& falling, BinLanes& gamma, BinLanes& rest) noexcept {
  gamma = falling.value;
  rest.at = 1.0F - gamma.at * gamma.at;
  square_root(rest);
  falling.value.at *= falling.ratio.at;
  falling.ratio.at *= falling.shrink;
}

RUSTLE_SIMD void fill_falling(const Falling& first, std::size_t groups, BinLanes* gamma, BinLanes* rest) noexcept {
  Falling falling = first;
  for (std::size_t g = 0; g < groups; ++g) next(falling, gamma[g], rest[g]);
}

RUSTLE_SIMD void add_product_groups(const BinLanes* a, const BinLanes* b, const BinLanes* p, const BinLanes* q,
                                    std::size_t groups, BinLanes* re, BinLanes* im) noexcept {
  for (std::size_t g = 0; g < groups; ++g) {
    re[g].at += a[g].at * p[g].at - b[g].at * q[g].at;
    im[g].at += a[g].at * q[g].at + b[g].at * p[g].at;
  }
}

/// Two random bits per bin for kDraws groups at a time, each drawn from (seed, bin) alone.
class QuarterTurns {
 public:
  explicit inline __attribute__((always_inline)) QuarterTurns(std::uint64_t seed) noexcept
      : high_(static_cast<std::uint32_t>(seed >> 32)) {
    for (std::size_t j = 0; j < kBinLanes; ++j)
      draws_[j] = static_cast<std::uint32_t>(j) * kStride + static_cast<std::uint32_t>(seed);
  }
  /// Bits of the next kDraws groups, the first group's lowest.
  inline __attribute__((always_inline)) void draw(Words& bits) noexcept {
    bits = (draws_ ^ (draws_ >> 16)) * 0x85EBCA6BU + high_;
    bits = (bits ^ (bits >> 13)) * 0xC2B2AE35U;
    bits ^= bits >> 16;
    draws_ += kDraws * kStride;
  }

 private:
  Words draws_{};
  std::uint32_t high_;
};

/// x + i y turned by as many quarters as the lowest two bits say.
inline __attribute__((always_inline)) void turn_quarters(const BinLanes& x, const BinLanes& y, const Words& bits,
                                                         BinLanes& re, BinLanes& im) noexcept {
  const Words p = reinterpret_cast<Words>(x.at), q = reinterpret_cast<Words>(y.at);
  const Words quarter = -(bits & 1U), half = bits << 31, sign = (bits << 30) & 0x80000000U;
  const Words exchanged = (p ^ q) & quarter;
  re.at = reinterpret_cast<Lanes>(p ^ exchanged ^ sign ^ half);
  im.at = reinterpret_cast<Lanes>(q ^ exchanged ^ sign);
}

inline __attribute__((always_inline)) void load(BinLanes& out, const float* from) noexcept {
  std::memcpy(&out.at, from, sizeof out.at);
}

RUSTLE_SIMD void add_turned_groups(std::uint64_t seed, const float* e, const BinLanes* a, const BinLanes* b,
                                   std::size_t groups, BinLanes* re, BinLanes* im) noexcept {
  QuarterTurns turns(seed);
  for (std::size_t first = 0; first < groups; first += kDraws) {
    Words bits;
    turns.draw(bits);
    const std::size_t end = std::min(groups, first + kDraws);
    for (std::size_t g = first; g < end; ++g, bits >>= 2) {
      BinLanes magnitude, u, v;
      load(magnitude, e + g * kBinLanes);
      turn_quarters({magnitude.at * a[g].at}, {magnitude.at * b[g].at}, bits, u, v);
      re[g].at += u.at;
      im[g].at += v.at;
    }
  }
}

RUSTLE_SIMD void add_turned_level(std::uint64_t seed, const float* e, float amplitude, std::size_t groups, BinLanes* re,
                                  BinLanes* im) noexcept {
  QuarterTurns turns(seed);
  for (std::size_t first = 0; first < groups; first += kDraws) {
    Words bits;
    turns.draw(bits);
    const std::size_t end = std::min(groups, first + kDraws);
    for (std::size_t g = first; g < end; ++g, bits >>= 2) {
      BinLanes x, u, v;
      load(x, e + g * kBinLanes);
      x.at *= amplitude;
      turn_quarters(x, {}, bits, u, v);
      re[g].at += u.at;
      im[g].at += v.at;
    }
  }
}

RUSTLE_SIMD void add_turned_rotor(std::uint64_t seed, const float* e, const Rotor& rotor, std::size_t groups, BinLanes* re,
                                  BinLanes* im) noexcept {
  QuarterTurns turns(seed);
  Rotor now = rotor;
  for (std::size_t first = 0; first < groups; first += kDraws) {
    Words bits;
    turns.draw(bits);
    const std::size_t end = std::min(groups, first + kDraws);
    for (std::size_t g = first; g < end; g += 2) {
      for (std::size_t k = 0; k < 2; ++k, bits >>= 2) {
        BinLanes magnitude, u, v;
        load(magnitude, e + (g + k) * kBinLanes);
        turn_quarters({magnitude.at * now.re[k].at}, {magnitude.at * now.im[k].at}, bits, u, v);
        re[g + k].at += u.at;
        im[g + k].at += v.at;
      }
      turn(now);
    }
  }
}

RUSTLE_SIMD void add_turned_falling(std::uint64_t seed, std::uint64_t own_seed, const float* e, const Rotor& rotor,
                                    const Falling& coherence, std::size_t groups, BinLanes* re, BinLanes* im) noexcept {
  QuarterTurns turns(seed), own_turns(own_seed);
  Rotor now = rotor;
  Falling falling = coherence;
  for (std::size_t first = 0; first < groups; first += kDraws) {
    Words bits, own_bits;
    turns.draw(bits);
    own_turns.draw(own_bits);
    const std::size_t end = std::min(groups, first + kDraws);
    for (std::size_t g = first; g < end; g += 2) {
      for (std::size_t k = 0; k < 2; ++k, bits >>= 2, own_bits >>= 2) {
        BinLanes magnitude, gamma, rest, u, v, own_u, own_v;
        load(magnitude, e + (g + k) * kBinLanes);
        next(falling, gamma, rest);
        const BinLanes x{magnitude.at * now.re[k].at}, y{magnitude.at * now.im[k].at};
        turn_quarters(x, y, bits, u, v);
        turn_quarters(x, y, own_bits, own_u, own_v);
        re[g + k].at += gamma.at * u.at + rest.at * own_u.at;
        im[g + k].at += gamma.at * v.at + rest.at * own_v.at;
      }
      turn(now);
    }
  }
}

}  // namespace

void set_zero(ComplexBins& out) noexcept {
  std::fill(out.re.begin(), out.re.end(), BinLanes{});
  std::fill(out.im.begin(), out.im.end(), BinLanes{});
}

void coherence(double x, RealBins& gamma, RealBins& rest) noexcept {
  fill_falling(make_falling(x), gamma.value.size(), gamma.value.data(), rest.value.data());
}

void add_delayed(double amplitude, double radians_per_bin, ComplexBins& out) noexcept {
  if (radians_per_bin == 0) {
    for (BinLanes& re : out.re) re.at += static_cast<float>(amplitude);
    return;
  }
  Rotor rotor;
  make_rotor(amplitude, radians_per_bin, rotor);
  add_rotating(rotor, out.re.size(), out.re.data(), out.im.data());
}

void add_delayed(double amplitude, double radians_per_bin, const RealBins& gamma, const RealBins& rest, ComplexBins& shared,
                 ComplexBins& own) noexcept {
  Rotor rotor;
  make_rotor(amplitude, radians_per_bin, rotor);
  add_rotating(rotor, gamma.value.data(), rest.value.data(), own.re.size(), shared.re.data(), shared.im.data(),
               own.re.data(), own.im.data());
}

void add_product(const ComplexBins& a, const ComplexBins& b, ComplexBins& out) noexcept {
  add_product_groups(a.re.data(), a.im.data(), b.re.data(), b.im.data(), out.re.size(), out.re.data(), out.im.data());
}

void add_turned(std::uint64_t seed, const float* magnitudes, const ComplexBins& transfer, ComplexBins& out) noexcept {
  add_turned_groups(seed, magnitudes, transfer.re.data(), transfer.im.data(), out.re.size(), out.re.data(), out.im.data());
}

void add_turned_delayed(std::uint64_t seed, const float* magnitudes, double amplitude, double radians_per_bin,
                        ComplexBins& out) noexcept {
  if (radians_per_bin == 0) {
    add_turned_level(seed, magnitudes, static_cast<float>(amplitude), out.re.size(), out.re.data(), out.im.data());
    return;
  }
  Rotor rotor;
  make_rotor(amplitude, radians_per_bin, rotor);
  add_turned_rotor(seed, magnitudes, rotor, out.re.size(), out.re.data(), out.im.data());
}

void add_turned_delayed(std::uint64_t seed, std::uint64_t own_seed, const float* magnitudes, double amplitude,
                        double radians_per_bin, double x, ComplexBins& out) noexcept {
  Rotor rotor;
  make_rotor(amplitude, radians_per_bin, rotor);
  add_turned_falling(seed, own_seed, magnitudes, rotor, make_falling(x), out.re.size(), out.re.data(), out.im.data());
}

}  // namespace rustle::synthesis
