#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <string>

#include <tl/expected.hpp>

namespace rustle::capture {

struct FittedPlane {
  std::array<double, 3> point;   ///< the mesh's centroid
  std::array<double, 3> normal;  ///< unit, toward the sheet
};

/// Whether an infinite plane can stand for a fixed obstacle mesh: all its vertices lie in one plane (within 1e-5 of its
/// extent), its triangles fill a convex outline, every position of the sheet projects inside that outline, and the sheet
/// stays on one side (within 1e-3 of the extent). Then contact with the plane is contact with the mesh, and the plane can
/// reflect sound as well. Otherwise the reason, as half a sentence.
/// Shapes: vertices f32 [V,3], triangles u32 [T,3] with indices below V, sheet_positions f32 [any,3]; all finite. Pure.
/// O(V log V + positions times corners of the outline).
tl::expected<FittedPlane, std::string> reflecting_plane(std::span<const float> vertices,
                                                        std::span<const std::uint32_t> triangles,
                                                        std::span<const float> sheet_positions);

}  // namespace rustle::capture
