#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "server/sheet/topology.h"
#include "server/sheet/transfer.h"
#include "server/sheet/vector.h"

namespace rustle::sheet {

/// The sheet laid out in a plane, where distances along the surface are straight lines.
struct RestPlane {
  std::vector<Vec2d> coordinates_m;      ///< [V]; triangles run counter-clockwise where the layout is good
  std::vector<std::uint32_t> component;  ///< [V] connected piece, through shared edges and vertices; pieces may overlap
  std::uint32_t component_count = 0;
  /// Share of the rest length by which the edges of the layout differ (root mean square): 0 for material coordinates.
  double distortion = 0;
};

/// The material coordinates; without them the rest positions, or else the given positions (the first of that topology),
/// laid flat: piece by piece projected on the plane of least thickness, or unfolded triangle by triangle when that
/// keeps edge lengths better (a sheet that is already bent when first seen). O(T log T).
/// \pre positions_m.size() == topology.vertex_count()
[[nodiscard]] RestPlane rest_plane(const Topology& topology, std::span<const Vec3f> positions_m);

/// The same layout on a topology whose every vertex is one of the old ones (renumbered or welded).
/// \pre transfer.remade holds none
[[nodiscard]] RestPlane renumbered(const RestPlane& plane, const Transfer& transfer, const Topology& to);

}  // namespace rustle::sheet
