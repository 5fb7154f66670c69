#pragma once

#include <memory>

#include "server/analysis/curvature.h"
#include "server/analysis/region_mesh.h"

/// What depends on a topology and its rest shape alone is made once for all sheets of the process that are alike, and goes
/// with the last of them: a crowd of equal sheets shares one copy, which stays in the processor's caches. Any thread.
namespace rustle::analysis {

/// curvature_stencils() of these.
[[nodiscard]] std::shared_ptr<const CurvatureStencils> shared_curvature_stencils(
    const std::shared_ptr<const sheet::Topology>& topology, sheet::RestPlane plane, const Parameters& parameters);

/// region_mesh() of these.
[[nodiscard]] std::shared_ptr<const RegionMesh> shared_region_mesh(const std::shared_ptr<const sheet::Topology>& topology,
                                                                   const sheet::RestPlane& plane,
                                                                   const Parameters& parameters, bool may_be_coarse = true);

}  // namespace rustle::analysis
