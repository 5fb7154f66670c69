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

/// Runs `sink(group, re, im)` over all groups. Two groups at a time: one waits for the other's turn.
template <class Sink>
inline __attribute__((always_inline)) void rotate(const Rotor& rotor, std::size_t groups, const Sink& sink) noexcept {
  BinLanes a = rotor.re[0], b = rotor.im[0], c = rotor.re[1], d = rotor.im[1];
  const float p = rotor.turn_re, q = rotor.turn_im;
  for (std::size_t g = 0; g < groups; g += 2) {
    sink(g, a, b);
    sink(g + 1, c, d);
    const BinLanes next_a{a.at * p - b.at * q}, next_c{c.at * p - d.at * q};
    b.at = a.at * q + b.at * p;
    d.at = c.at * q + d.at * p;
    a = next_a;
    c = next_c;
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

RUSTLE_SIMD void fill_falling(const BinLanes& first, const BinLanes& first_ratio, float shrink, std::size_t groups,
                              BinLanes* gamma, BinLanes* rest) noexcept {
  BinLanes value = first, ratio = first_ratio;
  for (std::size_t g = 0; g < groups; ++g) {
    gamma[g] = value;
    BinLanes own{1.0F - value.at * value.at};
    square_root(own);
    rest[g] = own;
    value.at *= ratio.at;
    ratio.at *= shrink;
  }
}

RUSTLE_SIMD void add_product_groups(const BinLanes* a, const BinLanes* b, const BinLanes* p, const BinLanes* q,
                                    std::size_t groups, BinLanes* re, BinLanes* im) noexcept {
  for (std::size_t g = 0; g < groups; ++g) {
    re[g].at += a[g].at * p[g].at - b[g].at * q[g].at;
    im[g].at += a[g].at * q[g].at + b[g].at * p[g].at;
  }
}

RUSTLE_SIMD void add_turned_groups(std::uint64_t seed, const float* e, const BinLanes* a, const BinLanes* b,
                                   std::size_t groups, BinLanes* re, BinLanes* im) noexcept {
  const auto low = static_cast<std::uint32_t>(seed), high = static_cast<std::uint32_t>(seed >> 32);
  Words draws{};
  for (std::size_t j = 0; j < kBinLanes; ++j) draws[j] = static_cast<std::uint32_t>(j) * kStride + low;
  for (std::size_t first = 0; first < groups; first += kDraws, draws += kDraws * kStride) {
    Words bits = (draws ^ (draws >> 16)) * 0x85EBCA6BU + high;
    bits = (bits ^ (bits >> 13)) * 0xC2B2AE35U;
    bits ^= bits >> 16;
    const std::size_t end = std::min(groups, first + kDraws);
    for (std::size_t g = first; g < end; ++g, bits >>= 2) {
      BinLanes magnitude;
      std::memcpy(&magnitude.at, e + g * kBinLanes, sizeof magnitude.at);
      const BinLanes x{magnitude.at * a[g].at}, y{magnitude.at * b[g].at};
      const Words p = reinterpret_cast<Words>(x.at), q = reinterpret_cast<Words>(y.at);
      const Words quarter = -(bits & 1U), half = bits << 31, sign = (bits << 30) & 0x80000000U;
      const Words u = p ^ ((p ^ q) & quarter), v = q ^ ((p ^ q) & quarter);
      re[g].at += reinterpret_cast<Lanes>(u ^ sign ^ half);
      im[g].at += reinterpret_cast<Lanes>(v ^ sign);
    }
  }
}

}  // namespace

void set_zero(ComplexBins& out) noexcept {
  std::fill(out.re.begin(), out.re.end(), BinLanes{});
  std::fill(out.im.begin(), out.im.end(), BinLanes{});
}

void coherence(double x, RealBins& gamma, RealBins& rest) noexcept {
  const double first = std::exp(-0.5 * x * x), step = first * first;
  double shrink = first;  // first^(2 kBinLanes)
  for (std::size_t k = 1; k < 2 * kBinLanes; k *= 2) shrink *= shrink;
  double power = first;  // first^(kBinLanes²)
  for (std::size_t k = 1; k < kBinLanes * kBinLanes; k *= 2) power *= power;
  BinLanes value, ratio;
  double v = 1, fall = first, r = power;
  for (std::size_t j = 0; j < kBinLanes; ++j) {
    value.at[j] = static_cast<float>(v);
    ratio.at[j] = static_cast<float>(r);
    v *= fall;
    fall *= step;
    r *= shrink;
  }
  fill_falling(value, ratio, static_cast<float>(power * power), gamma.value.size(), gamma.value.data(), rest.value.data());
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

}  // namespace rustle::synthesis
