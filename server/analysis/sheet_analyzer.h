#pragma once

#include <cstdint>
#include <limits>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "server/analysis/bending_activity.h"
#include "server/analysis/contacts.h"
#include "server/analysis/crumpling.h"
#include "server/analysis/curvature.h"
#include "server/analysis/effort.h"
#include "server/analysis/parameters.h"
#include "server/analysis/region_mesh.h"
#include "server/analysis/regions.h"
#include "server/analysis/resonators.h"
#include "server/analysis/surroundings.h"
#include "server/analysis/tears.h"
#include "server/observation/observation.h"
#include "server/sheet/mesh_frame.h"

namespace rustle::analysis {

/// How a sheet's topology changes were met (P14), for notices and statistics.
struct TopologyChanges {
  std::uint64_t by_material = 0;   ///< history carried by material coordinates
  std::uint64_t by_position = 0;   ///< recognised as renumbered, welded or remeshed in part
  std::uint64_t history_lost = 0;  ///< not recognised: signs adopted silently, no crumpling can be heard across it
};

/// From mesh frames to observations, one sheet, frames in the order of their times. Holds all that must be remembered.
/// The same frames give the same bits. Meshes may be degenerate, non-manifold, in pieces, or change at every frame.
class SheetAnalyzer {
 public:
  SheetAnalyzer(sheet::SheetId sheet, const Parameters& parameters);

  /// Crumpling, friction (every contact; resonators for those that slide) and tear tips: those sent with the frame; of a
  /// sheet with which none were ever sent, those that its mesh shows.
  /// Event ids are drawn from `next_event_id`. A frame that goes back in time resets the history, as `reset_history` does.
  /// \pre the frame has the sizes its topology says, all finite  [analysis worker]
  [[nodiscard]] observation::Observation analyze(const sheet::MeshFrame& frame, const SheetSurroundings& surroundings,
                                                 std::uint64_t& next_event_id, const Effort& effort = {});

  [[nodiscard]] const TopologyChanges& topology_changes() const { return changes_; }  // [analysis worker]

 private:
  struct SentTip {
    std::uint64_t id;
    double seen_s;
    double torn_m;
  };
  /// The sheet as it was, for the regions that a flip needs: at its own moment it is flat.
  struct BentShape {
    double time_s;
    double bending_per_m;                  ///< mean |H|
    std::vector<sheet::Vec4f> relative_m;  ///< [V]
  };
  /// The resonators of an event, which what continues it at once has, too.
  struct Rung {
    double time_s;
    double amplitude_m;
    std::vector<observation::Resonator> resonators;
  };
  struct State {
    std::shared_ptr<const CurvatureStencils> curvature;
    CrumplingState crumpling;
    BendingPatches patches;  ///< of the topology of `curvature`
    BendingState bending;
    std::shared_ptr<const RegionMesh> regions;       ///< made when first needed
    std::shared_ptr<const RegionMesh> sent_regions;  ///< of the sheet's own triangles, for a sent partition
    RegionState region_history;
    std::vector<Moment> partition_moments;  ///< of the frame that scratch_.map was made of; empty: it may not serve again
    double partition_s = 0;                 ///< time of that frame
    std::optional<sheet::MeshFrame> last;
    bool last_applies = false;            ///< its vertices are those of the present topology
    std::vector<sheet::Vec3f> carried_m;  ///< its positions at the vertices of a topology just met, or empty
    std::vector<sheet::Vec3f> earlier_m;  ///< positions of the frame before it at the present vertices, or empty
    double earlier_s = 0;
    std::vector<BentShape> bent;  ///< of the flip memory, each more bent than those after it; the last is the present one
    std::map<std::uint64_t, std::shared_ptr<const Rung>> rung;  ///< by event
    std::map<std::uint32_t, SentTip> sent_tips;
    bool sends_tips = false;  ///< they come with frames: the mesh is not asked
    TearState tears;
    int unidentified_frames = 0;                                   ///< in a row, this one included
    double crumpled_s = -std::numeric_limits<double>::infinity();  ///< when it last did
  };
  /// Kept so that a warm frame allocates nothing.
  struct Scratch {
    std::vector<sheet::Vec4f> relative_m;  ///< [V] of the frame, until it is remembered
    std::vector<float> angles_rad;         ///< [E]
    RegionScratch regions;
    std::vector<sheet::Vec4f> positions_m, bent_positions_m;  ///< gathered for a coarse region mesh
    RegionMap map, bent_map;
    Holds holds;
    std::vector<std::uint8_t> marks;
    std::vector<std::uint32_t> vertices, triangles;
    std::vector<std::vector<sheet::Vec4f>> spare_m;
  };

  void forget();
  /// Positions of the frame before at the vertices of the present topology; empty where they are not known.
  std::span<const sheet::Vec3f> last_positions_m() const;
  /// Brings the state to the frame's topology. Returns the vertices that are new to the history.
  struct Arrival {
    std::vector<bool> remade;
    std::vector<std::uint32_t> origins;  ///< as Observation has them
    bool silent = false;
    bool unidentified = false;  ///< remade vertices without material coordinates
  };
  std::optional<Arrival> follow_topology(const sheet::MeshFrame& frame);
  /// Gives events that continue what was measured within the joining time (P2) the resonators of that. Whether all of them
  /// have theirs then.
  bool all_ring_on(observation::Observation& observation);
  bool partition_serves(double time_s, const Effort& effort) const;
  void find_resonators(const sheet::MeshFrame& frame, const sheet::Vec3d& origin_m, const Effort& effort,
                       observation::Observation& observation);
  void remember_bending(double time_s);
  /// `before`: the topology that `arrival` replaced.
  std::vector<observation::TearEvent> tears_of(const sheet::MeshFrame& frame, const sheet::Topology* before,
                                               const std::optional<Arrival>& arrival, std::uint64_t& next_event_id);
  std::vector<observation::TearEvent> sent_tears(const sheet::MeshFrame& frame, std::uint64_t& next_event_id);
  void remember(const sheet::MeshFrame& frame);

  sheet::SheetId sheet_;
  Parameters parameters_;
  ContactTracker contacts_;
  ResonatorFinder finder_, bent_finder_;
  State state_;
  Scratch scratch_;
  TopologyChanges changes_;
};

/// One frame's partition on its own, for pictures: what analyze() would use if it needed regions in this frame.
struct RegionPicture {
  std::shared_ptr<const sheet::Topology> topology;  ///< of the partition: the frame's, or a coarse proxy's
  std::vector<sheet::Vec3f> positions_m;            ///< of its vertices, in space
  RegionMap map;
  std::vector<sheet::Vec3f> rulings;            ///< [T] directions in space, unit length
  Holds holds;                                  ///< by its vertices: anchors, and the contacts given
  std::vector<observation::Resonator> regions;  ///< [R] measured, held by these
};
/// `contacts`: the frame's, as analyze() found them. \pre as for analyze()
[[nodiscard]] RegionPicture picture_regions(const sheet::MeshFrame& frame, const Parameters& parameters,
                                            std::span<const observation::FrictionContact> contacts = {});

}  // namespace rustle::analysis
