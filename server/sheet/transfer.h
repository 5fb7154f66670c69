#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "server/sheet/topology.h"
#include "server/sheet/vector.h"

namespace rustle::sheet {

/// Where the vertices of a new topology lie on the old one, so that per-vertex state can follow the material (P14).
struct Transfer {
  struct Origin {
    std::array<std::uint32_t, 3> vertices;  ///< of the old topology
    std::array<float, 3> weights;           ///< >= 0, sum 1

    /// The old vertex that weighs most.
    std::uint32_t closest() const {
      return vertices[weights[0] >= weights[1] && weights[0] >= weights[2] ? 0 : weights[1] >= weights[2] ? 1 : 2];
    }
  };
  std::vector<Origin> origins;  ///< [V new]
  std::vector<bool> remade;     ///< [V new] without a counterpart among the old vertices
};

/// Whether the two describe the same sheet vertex for vertex: triangles, material coordinates and rest positions.
[[nodiscard]] bool same_structure(const Topology& a, const Topology& b);

/// By material coordinates: the old triangle that holds each new vertex. A vertex within 1e-3 of its local edge length of an
/// old one is that vertex. At a crack, where both sides have the same material coordinates, each side stays with its own.
/// \pre both topologies have material coordinates, the old one a vertex at least
[[nodiscard]] Transfer transfer_by_material(const Topology& from, const Topology& to);

/// By place in space, for renumbered, welded or locally remeshed sheets without material coordinates: new vertices match the
/// old ones they coincide with (within 0.3 of the local edge length of where those are expected now), and a match counts
/// when a triangle of matched vertices existed before. Empty when fewer than half of the triangles did: no proof of
/// identity. \pre expected_m: the old vertices' positions, moved on to the new time; sizes as the topologies say
[[nodiscard]] std::optional<Transfer> transfer_by_position(const Topology& from, std::span<const Vec3f> expected_m,
                                                           const Topology& to, std::span<const Vec3f> positions_m);

}  // namespace rustle::sheet
