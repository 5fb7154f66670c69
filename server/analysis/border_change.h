#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "server/sheet/topology.h"
#include "server/sheet/vector.h"

namespace rustle::analysis {

/// A mesh in rest space: where its material lies while nothing pulls at it.
struct RestMesh {
  const sheet::Topology* topology = nullptr;
  std::vector<sheet::Vec3d> positions_m;  ///< [V]
};

/// Border that came where the sheet was whole, in one connected piece: of a crack, both lips.
struct NewBorder {
  std::vector<std::uint32_t> edges;  ///< of the later topology's border_edges()
  double length_m = 0;               ///< half of the border gained: the length of the crack
};

/// Compares the borders of two meshes of one sheet, remeshed in between or not. A border edge is new where some of it lies
/// further from the earlier border than a quarter of its own length; it counts for the part of it that lies further than a
/// twentieth. So border that was only divided otherwise, or whose corners were cut, is not new. Border that was lost
/// likewise, beside what is new, is subtracted; what gains less than a quarter of an edge in all is left out: it was
/// moved. So are all where more than half of the edges inside came apart at once: the sheet's vertices were split.
/// The pieces come in the order of their first edges. Pure. O(border edges) where few are new.
[[nodiscard]] std::vector<NewBorder> find_new_border(const RestMesh& before, const RestMesh& now);

}  // namespace rustle::analysis
