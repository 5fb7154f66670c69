#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "server/analysis/border_change.h"
#include "server/analysis/parameters.h"
#include "server/observation/observation.h"
#include "server/sheet/mesh_frame.h"

namespace rustle::analysis {

/// What is remembered of a sheet's tears.
struct TearState {
  struct Tip {
    std::uint64_t id;
    std::uint32_t vertex;    ///< of the topology of the frame before
    sheet::Vec3d direction;  ///< in space, as it went last
    double advanced_s;       ///< when it did
    double torn_m;           ///< since it opened
  };
  std::vector<Tip> tips;
};

/// A topology that was replaced, and where its vertices and the new ones' material was in the frame before.
struct TopologyChange {
  const sheet::Topology* from = nullptr;
  std::span<const sheet::Vec3f> from_m;     ///< [V from] positions in the frame before
  std::span<const sheet::Vec3f> carried_m;  ///< [V new] of the same time, or empty: the new vertices were not recognised
  bool whole = false;                       ///< every new vertex was recognised as an old one
  double previous_s = 0;                    ///< the time of that frame
};

/// Both meshes in one rest space, the first that there is of:
///   material coordinates, rest positions: of both topologies; stretch plays no part;
///   the frame before, by triangles: as many as before, in the same order, each new vertex at corners of one old vertex;
///   so a cut that duplicates vertices along a crack is read off the connectivity, whatever moves;
///   the frame before, by place: every new vertex recognised as an old one (transfer_by_position), renumbered or not.
/// The last two take lengths from the frame before: stretched material counts as long as it is. Empty where none applies:
/// a mesh remeshed without material coordinates shows no tears, since border that moves cannot be told there from border
/// that opens.
struct RestPair {
  RestMesh before, now;
};
[[nodiscard]] std::optional<RestPair> common_rest_space(const TopologyChange& change, const sheet::MeshFrame& frame);

/// Tears that a mesh shows (T5): material that was joined and is no longer. New border (border_change.h) is a crack; where
/// its two lips meet is a tip, a border vertex whose triangles fill 315° and more in rest space. A crack that goes on from
/// a known tip keeps its id, the branch that goes on straightest where there are several; all other tips are new. A
/// crack without a tip has reached a border or another crack: its tip is heard there once, and is no more.
///   speed = length torn / time between the frames      each new border edge's counts for the tip nearest to it
/// Tips that have not gone on for tear_memory_s are forgotten, until then they stay in the list with speed 0. What is open
/// in the first frame makes no tear. `change` is null where the topology is the one before; then only known tips cost
/// anything. Ids are drawn from next_event_id.
[[nodiscard]] std::vector<observation::TearEvent> find_tears(const sheet::MeshFrame& frame, const TopologyChange* change,
                                                             const Parameters& parameters, TearState& state,
                                                             std::uint64_t& next_event_id);

}  // namespace rustle::analysis
