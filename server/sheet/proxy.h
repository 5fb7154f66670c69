#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "server/sheet/rest_plane.h"
#include "server/sheet/topology.h"

namespace rustle::sheet {

/// A coarse stand-in for a fine mesh (P3): a subset of its vertices, one per cell of √(2A/wanted) and the border's corners,
/// triangulated in the rest plane.
struct Proxy {
  std::shared_ptr<const Topology> topology;  ///< material coordinates: the rest plane's
  std::vector<std::uint32_t> vertices;       ///< [V proxy] the fine vertex that each one is
  std::vector<std::uint32_t> nearest;        ///< [V fine] the proxy vertex closest in the rest plane
};

/// Empty when the layout would not be faithful: several pieces, a folded or stretched rest plane, a crack, a border finer
/// than the cells. The fine mesh then serves itself. O(V log V).
[[nodiscard]] std::optional<Proxy> coarse_proxy(const Topology& fine, const RestPlane& plane, std::size_t triangles_wanted);

}  // namespace rustle::sheet
