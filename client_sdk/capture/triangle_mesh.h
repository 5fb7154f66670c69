#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include <tl/expected.hpp>

namespace rustle::capture {

/// One mesh as a file holds it.
struct TriangleMesh {
  std::vector<float> positions;            ///< [V,3]
  std::vector<std::uint32_t> triangles;    ///< [T,3], indices below V; polygons are cut into fans
  std::vector<float> texture_coordinates;  ///< [V,2] when the file gives every vertex exactly one, else empty
};

struct MeshError {
  std::string place;  ///< such as "line 12" or "vertex 4"
  std::string message;
};

/// Wavefront OBJ: v, vt and f, with indices from 1 or, when negative, from the last vertex back; all else is passed over.
/// All objects and groups of the file make one mesh. Pure.
tl::expected<TriangleMesh, MeshError> parse_obj(std::string_view text);

/// PLY 1.0, ascii and binary_little_endian: element vertex with x, y, z (s, t or u, v), element face with the list
/// vertex_indices or vertex_index; all else is passed over. Pure.
tl::expected<TriangleMesh, MeshError> parse_ply(std::string_view bytes);

}  // namespace rustle::capture
