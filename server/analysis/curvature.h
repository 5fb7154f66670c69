#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "server/analysis/kernel_blocks.h"
#include "server/analysis/parameters.h"
#include "server/analysis/plane_lattice.h"
#include "server/analysis/stencil.h"

namespace rustle::analysis {

/// Everything about the mean curvature of a sheet that depends on its topology and rest shape alone. H = ½ tr M, with M
/// fitted to the hinges around a vertex (P2), is linear in their angles, and so is the local bending K, the mean |θ||e| over
/// the hinge areas, in their sizes.
struct CurvatureStencils {
  std::shared_ptr<const sheet::Topology> topology;
  sheet::RestPlane plane;
  std::vector<sheet::Hinge> hinges;   ///< [E]
  bool in_edge_order = true;          ///< hinges are the topology's interior edges in their order; false on fine meshes
  std::vector<double> edge_length_m;  ///< [V] local, in the rest plane
  std::vector<double> radius_m;       ///< [V] within which hinges count
  MomentNodes nodes;
  std::vector<float> node_area_m2;     ///< [N] hinge areas
  Stencil rows;                        ///< nodes to vertices; empty where blocks serve
  KernelBlocks blocks;                 ///< the same of a fine mesh; else empty
  PlaneLattice lattice;                ///< where the targets are its points, not the vertices; else empty
  std::vector<std::uint32_t> targets;  ///< [V] the vertex of each row, or [V or P] in the order of the blocks
  std::vector<Moment> response;  ///< [V or P] to a target's sum: (½, 0, ½)(Kᵀ W K)⁻¹ for H, and 1/(2 area) for K
  std::vector<std::uint32_t> neighbour_start, neighbour;  ///< vertices joined by an edge
};

[[nodiscard]] CurvatureStencils curvature_stencils(std::shared_ptr<const sheet::Topology> topology, sheet::RestPlane plane,
                                                   const Parameters& parameters);

/// One frame's H, in 1/m, positive where the sheet bends toward its normals (a dome seen from their side), and K.
struct Curvature {
  std::vector<float> mean_per_m;                                       ///< [V] H
  std::vector<float> bending_per_m;                                    ///< [V] K
  std::vector<Moment> moments;                                         ///< scratch
  std::vector<float> mean_at_lattice_per_m, bending_at_lattice_per_m;  ///< scratch
};

/// Allocates nothing once `out` has its size. O(hinges + rows). \pre angles_rad: of stencils.hinges
void measure_curvature(const CurvatureStencils& stencils, std::span<const float> angles_rad, Curvature& out);

}  // namespace rustle::analysis
