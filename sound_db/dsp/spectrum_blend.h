#pragma once

#include <span>
#include <vector>

namespace rustle::dsp {

/// An amplitude spectrum between two others, its bands moving rather than fading (An et al. 2012, eqs. 1-3; C1).
/// The spectra, each normalised to mass one, are densities that are constant over ±½ bin (half as wide at both ends), with a
/// floor of 1e-9 of the mass spread evenly:
///   c(f) = ∫₀ᶠ A(g) dg,   c⁻¹ = (1-α) cᵢ⁻¹ + α cⱼ⁻¹,   A(f) = dc/df
/// The blended inverse is piecewise linear; it is inverted again and differenced at the edges of the bins, so that the mass
/// is kept. The result has mass one: Σ A_k width_k = 1, the width of a bin being 1.
class SpectrumBlend {
 public:
  /// Allocates. \pre from.size() == to.size() ≥ 2; magnitudes are not negative and not all 0
  SpectrumBlend(std::span<const float> from, std::span<const float> to);

  /// The density at α in [0, 1]. O(bins), allocates nothing.
  /// \pre out.size() == bins
  void at(double alpha, std::span<float> out) const noexcept;

 private:
  /// Where the blended inverse CDF has knots: the mass there, and both frequencies in bins.
  struct Knot {
    double mass = 0, from = 0, to = 0;
  };
  std::size_t bins_ = 0;
  std::vector<Knot> knots_;
};

}  // namespace rustle::dsp
