#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "server/synthesis/nonblocking.h"

/// Kernels on spectra of random-phase noise (P8), sixteen bins at a time: the same bits on every instruction set. Where
/// several spectra come together they have the same size. Pure but for their outputs, allocate nothing. [render worker]
namespace rustle::synthesis {

inline constexpr std::size_t kBinLanes = 16;

/// A value for each of sixteen neighbouring bins.
struct alignas(64) BinLanes {
  float at __attribute__((vector_size(kBinLanes * sizeof(float)))) = {};
};

/// A real number per bin. \pre count is a multiple of kBinLanes
struct RealBins {
  std::vector<BinLanes> value;
  explicit RealBins(std::size_t count) : value(count / kBinLanes) {}
};

/// A complex number per bin, real and imaginary parts apart. \pre count is a multiple of kBinLanes
struct ComplexBins {
  std::vector<BinLanes> re, im;
  explicit ComplexBins(std::size_t count) : re(count / kBinLanes), im(count / kBinLanes) {}
  std::size_t count() const noexcept { return re.size() * kBinLanes; }
};

void set_zero(ComplexBins& out) noexcept RUSTLE_NONBLOCKING;

/// gamma_k = exp(-(k x)²/2) and rest_k = √(1 - gamma_k²), the latter within 0.2 %.
void coherence(double x, RealBins& gamma, RealBins& rest) noexcept RUSTLE_NONBLOCKING;

/// out_k += amplitude exp(-i k radians_per_bin).
void add_delayed(double amplitude, double radians_per_bin, ComplexBins& out) noexcept RUSTLE_NONBLOCKING;

/// The same in two parts: gamma_k of it to `shared`, rest_k of it to `own`.
void add_delayed(double amplitude, double radians_per_bin, const RealBins& gamma, const RealBins& rest, ComplexBins& shared,
                 ComplexBins& own) noexcept RUSTLE_NONBLOCKING;

/// out_k += a_k b_k.
void add_product(const ComplexBins& a, const ComplexBins& b, ComplexBins& out) noexcept RUSTLE_NONBLOCKING;

/// out_k += magnitudes_k transfer_k P_k,   P_k one of 1, i, -1, -i, drawn from (seed, k) alone.
/// Quarter turns have E[P] = E[P²] = 0 and E|P|² = 1 as phases from the whole circle have, so powers and cross spectra are
/// the same, and to turn by one is to exchange parts and signs.
/// \pre magnitudes has out.count() elements
void add_turned(std::uint64_t seed, const float* magnitudes, const ComplexBins& transfer,
                ComplexBins& out) noexcept RUSTLE_NONBLOCKING;

/// out_k += magnitudes_k amplitude exp(-i k radians_per_bin) P_k: add_delayed and add_turned in one pass.
/// \pre magnitudes has out.count() elements
void add_turned_delayed(std::uint64_t seed, const float* magnitudes, double amplitude, double radians_per_bin,
                        ComplexBins& out) noexcept RUSTLE_NONBLOCKING;

/// The same of a path whose coherence with the direct one falls with frequency, gamma_k and rest_k as coherence(x) has them:
///   out_k += magnitudes_k amplitude exp(-i k radians_per_bin) (gamma_k P_k + rest_k Q_k),   Q_k drawn from (own_seed, k)
/// \pre magnitudes has out.count() elements
void add_turned_delayed(std::uint64_t seed, std::uint64_t own_seed, const float* magnitudes, double amplitude,
                        double radians_per_bin, double x, ComplexBins& out) noexcept RUSTLE_NONBLOCKING;

}  // namespace rustle::synthesis
