#pragma once

#include <array>
#include <cstdint>
#include <vector>

/// Procedural sheets and motions with known answers. Metres, seconds, z up.
namespace rustle::sheets {

struct SheetMesh {
  std::vector<std::array<std::uint32_t, 3>> triangles;     ///< counter-clockwise in the material plane
  std::vector<std::array<float, 2>> material_coordinates;  ///< metres; [V]
};

enum class MeshKind {
  kStructured,  ///< rows and columns, each cell cut along the same diagonal
  kDelaunay,    ///< random points at an even distance
  kGraded,      ///< random points; edges four times as long at x = width as at x = 0
};

/// Triangulates [0, width] x [0, height] into `triangle_count` triangles: the random kinds exactly (from about 50 on), the
/// structured one as near as rows and columns allow. Corners and straight borders are exact. The same arguments give the
/// same mesh.
/// \pre width_m, height_m > 0; triangle_count ≥ 2
[[nodiscard]] SheetMesh make_rectangle(MeshKind kind, double width_m, double height_m, std::size_t triangle_count,
                                       std::uint64_t seed = 0);

}  // namespace rustle::sheets
