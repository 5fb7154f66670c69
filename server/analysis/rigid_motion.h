#pragma once

#include <optional>
#include <span>

#include "server/observation/observation.h"
#include "server/sheet/vector.h"

namespace rustle::analysis {

/// The rigid motion nearest to what vertices did, in the least-squares sense (Kabsch): centroid to centroid, and the
/// rotation R about it that minimises Σ |R (p_i - p̄) - (q_i - q̄)|². Of meshes above 128 vertices every so manyth serves.
/// Nothing when there are fewer than three vertices, a position is not finite, or the vertices lie on one line.
/// Pure, O(V), at most 128 of them. \pre before_m.size() == now_m.size()
std::optional<observation::RigidMotion> nearest_rigid_motion(std::span<const sheet::Vec3f> before_m,
                                                             std::span<const sheet::Vec3f> now_m);

}  // namespace rustle::analysis
