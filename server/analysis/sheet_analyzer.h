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
#include "server/analysis/parameters.h"
#include "server/analysis/region_mesh.h"
#include "server/analysis/regions.h"
#include "server/analysis/resonators.h"
#include "server/analysis/surroundings.h"
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

  /// Crumpling, friction (every contact; resonators for those that slide) and the tear tips sent with the frame.
  /// Event ids are drawn from `next_event_id`. A frame that goes back in time resets the history, as `reset_history` does.
  /// \pre the frame has the sizes its topology says, all finite  [analysis worker]
  [[nodiscard]] observation::Observation analyze(const sheet::MeshFrame& frame, const SheetSurroundings& surroundings,
                                                 std::uint64_t& next_event_id);

  [[nodiscard]] const TopologyChanges& topology_changes() const { return changes_; }  // [analysis worker]

 private:
  struct TearTip {
    std::uint64_t id;
    double seen_s;
  };
  /// The sheet as it was, for the regions that a flip needs: at its own moment it is flat.
  struct BentShape {
    double time_s;
    double bending_per_m;                  ///< mean |H|
    std::vector<sheet::Vec4f> relative_m;  ///< [V]
  };
  struct State {
    std::optional<CurvatureStencils> curvature;
    CrumplingState crumpling;
    BendingPatches patches;  ///< of the topology of `curvature`
    BendingState bending;
    std::optional<RegionMesh> regions;       ///< made when first needed
    std::optional<RegionMesh> sent_regions;  ///< of the sheet's own triangles, for a sent partition
    RegionState region_history;
    std::vector<Moment> partition_moments;  ///< of the frame that scratch_.map was made of; empty: it may not serve again
    double partition_s = 0;                 ///< time of that frame
    std::optional<sheet::MeshFrame> last;
    std::vector<sheet::Vec3f> last_positions_m;     ///< of `last`, at the vertices of the present topology
    std::vector<sheet::Vec3f> earlier_positions_m;  ///< of the frame before `last`, same vertices, or empty
    double earlier_s = 0;
    std::vector<BentShape> bent;  ///< of the flip memory, each more bent than those after it
    std::map<std::uint32_t, TearTip> tips;
    int unidentified_frames = 0;                                   ///< in a row, this one included
    double crumpled_s = -std::numeric_limits<double>::infinity();  ///< when it last did
  };
  /// Kept so that a warm frame allocates nothing.
  struct Scratch {
    std::vector<sheet::Vec4f> relative_m;  ///< [V] of the frame
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
  /// Brings the state to the frame's topology. Returns the vertices that are new to the history.
  struct Arrival {
    std::vector<bool> remade;
    bool silent = false;
    bool unidentified = false;  ///< remade vertices without material coordinates
  };
  std::optional<Arrival> follow_topology(const sheet::MeshFrame& frame);
  bool partition_serves(double time_s) const;
  void find_resonators(const sheet::MeshFrame& frame, const sheet::Vec3d& origin_m, observation::Observation& observation);
  void remember_bending(double time_s);
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
