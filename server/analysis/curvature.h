#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "server/analysis/parameters.h"
#include "server/analysis/stencil.h"

namespace rustle::analysis {

/// Everything about the mean curvature of a sheet that depends on its topology and rest shape alone.
/// Fitting M by least squares to the hinges around vertex i (P2) is linear in their angles, so H = ½ tr M is one sparse row:
///   H_i = Σ_k w_ik θ_k,    w_i = W K (Kᵀ W K)⁻¹ (½, 0, ½)ᵀ
/// and so is the local bending, the mean |θ||e| over the hinge areas: K_i = Σ_k b_ik |θ_k|.
struct CurvatureStencils {
  std::shared_ptr<const sheet::Topology> topology;
  sheet::RestPlane plane;
  std::vector<sheet::Hinge> hinges;         ///< [E]
  std::vector<double> edge_length_m;        ///< [V] local, in the rest plane
  std::vector<double> radius_m;             ///< [V] of the kernel
  std::vector<std::uint32_t> start, hinge;  ///< rows of the two operators
  std::vector<float> mean_curvature_weight;
  std::vector<float> bending_weight;
  std::vector<std::uint32_t> neighbour_start, neighbour;  ///< vertices joined by an edge
};

[[nodiscard]] CurvatureStencils curvature_stencils(std::shared_ptr<const sheet::Topology> topology, sheet::RestPlane plane,
                                                   const Parameters& parameters);

/// H of every vertex in 1/m, positive where the sheet bends toward its normals (a dome seen from their side).
/// Allocates nothing. \pre angles_rad: of stencils.hinges; out_per_m.size() == vertex count
void mean_curvature_per_m(const CurvatureStencils& stencils, std::span<const float> angles_rad, std::span<float> out_per_m);

/// Local bending K of one vertex in 1/m.
[[nodiscard]] float bending_per_m(const CurvatureStencils& stencils, std::span<const float> angles_rad,
                                  std::uint32_t vertex);

}  // namespace rustle::analysis
