#pragma once

#include <cstdint>
#include <vector>

#include "client_sdk/sheets/tearing_mesh.h"

namespace rustle::sheets {

/// A fibre that stands out of a torn edge, for those who draw it. It begins on the border edge from vertex `from` to vertex
/// `to`, the share `along` of it away from `from`, and is `length_m` long; seen in the sheet it leaves the edge at
/// `splay_rad` from the way out (> 0: toward `to`), and rises by `lift_rad` to the side of the sheet's normals.
struct TornFibre {
  std::uint32_t from = 0, to = 0;  ///< vertices of TornMesh::mesh()
  double along = 0;
  double length_m = 0;
  double splay_rad = 0, lift_rad = 0;
};

struct FibreOptions {
  double per_m = 3000;          ///< of each lip
  double mean_length_m = 4e-4;  ///< lengths are exponentially distributed, four times as long at most
  std::uint64_t seed = 0;
};

/// Fibres of both lips, from the tear's start on. A fibre stays as it is while the tear goes on. Pure. O(fibres).
[[nodiscard]] std::vector<TornFibre> torn_fibres(const TornMesh& mesh, const FibreOptions& options);

}  // namespace rustle::sheets
