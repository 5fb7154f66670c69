#pragma once

#include <filesystem>

#include "client_sdk/capture/import.h"

namespace rustle::capture {

/// A `.npz` archive of a sheet's motion into a capture. Arrays, in the units of the options; F frames:
///   constant topology   positions [F,N,3], triangles [T,3], times [F] s, optional pinned [N] or [F,N],
///                       material_coordinates [N,2]
///   changing topology   positions [ΣN,3], vertex_offsets [F+1], triangles [ΣT,3] numbered within their frame,
///                       triangle_offsets [F+1], times [F], optional pinned [ΣN], material_coordinates [ΣN,2]
///   obstacles           obstacleK_triangles [T,3], obstacleK_vertices [V,3] fixed or [F,V,3] moving
/// Real numbers f4 or f8, indices i4, i8 or u4, masks b1 or u1. Obstacle K gets the id K+1; a fixed one that
/// reflecting_plane() accepts becomes a plane, unless the options say otherwise.
ImportResult import_npz(const std::filesystem::path& input, const std::filesystem::path& output,
                        const ImportOptions& options, const ImportProgress& progress = {});

}  // namespace rustle::capture
