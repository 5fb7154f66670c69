#pragma once

#include <cstddef>
#include <span>
#include <vector>

namespace rustle::dsp {

/// A warp of feature space (An et al. 2012, 4.3, eqs. 8 and 9; C4): W(f) = f + Δf(f), with y = (f - centre) / scale
///   Δf(f) = scale · (a₀ + A y + Σ_k w_k U(‖y - x_k‖)),   U(r) = r² log r²
/// Without nodes and with affine part zero it is the identity.
struct ThinPlateSpline {
  int dims = 0;
  std::vector<double> centre;   ///< [dims]
  double scale = 1;             ///< root mean square distance of the nodes from their centre
  std::vector<double> affine;   ///< [dims + 1][dims]: a₀, then a row for each dimension of y
  std::vector<double> nodes;    ///< [count][dims] x_k, in units of y
  std::vector<double> weights;  ///< [count][dims] w_k
  std::size_t node_count() const noexcept { return dims ? nodes.size() / static_cast<std::size_t>(dims) : 0; }
  bool identity() const noexcept { return affine.empty() && nodes.empty(); }
  friend bool operator==(const ThinPlateSpline&, const ThinPlateSpline&) = default;
};

/// The identity in so many dimensions.
ThinPlateSpline identity_warp(int dims);

/// W(f). O(nodes x dims), allocates nothing, any thread. `out` may be `f`.
/// \pre f.size() == out.size() == spline.dims ≤ kMostWarpDims
void warp(const ThinPlateSpline& spline, std::span<const float> f, std::span<float> out) noexcept;
void warp(const ThinPlateSpline& spline, std::span<const double> f, std::span<double> out) noexcept;
inline constexpr int kMostWarpDims = 64;

/// The warp that minimises Σ_k ‖W(node_k) - target_k‖² + λ tr(wᵀ K w), K_kl = U(‖x_k - x_l‖) with features unscaled
/// (Belongie et al. 2002, eq. 10). Nodes that coincide are merged, their targets' mean weighing as many times (the same
/// minimum). Solved in the null space of the affine part, where K is positive definite. λ → 0 reproduces distinct
/// correspondences, λ → ∞ is the least-squares affine map; nodes on a line, a plane or a point get the smallest affine part
/// that fits. Allocates; control side. O(nodes³).
/// \pre nodes.size() == targets.size(), a multiple of dims and not 0; 1 ≤ dims ≤ kMostWarpDims; λ ≥ 0; all are finite
ThinPlateSpline fit_thin_plate_spline(std::span<const double> nodes, std::span<const double> targets, int dims,
                                      double lambda);

}  // namespace rustle::dsp
