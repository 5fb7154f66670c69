#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "server/analysis/parameters.h"
#include "server/analysis/regions.h"
#include "server/analysis/rulings.h"
#include "server/observation/observation.h"

/// Which regions an event sets vibrating (P4), and what they sound like (P5).
namespace rustle::analysis {

/// What holds the sheet's vertices, on the mesh of the partition.
struct Holds {
  std::vector<std::uint8_t> anchored;  ///< [V]
  std::vector<std::uint8_t> touching;  ///< [V] in contact with anything
};

/// One frame's partition with what measuring it needs.
struct Partition {
  const RegionStencils& stencils;
  const RegionMap& map;
  std::span<const sheet::Vec4f> positions_m;  ///< [V] relative to the origin
  sheet::Vec3d origin_m;
  const Holds& holds;
  const sheet::SentPartition* sent =
      nullptr;  ///< the simulator's own, whose rulings give the lengths; null: rulings are traced
};

/// Finds and measures the regions of one partition after another. Regions are measured when first asked for. Allocates
/// nothing of its own once warm.
class ResonatorFinder {
 public:
  explicit ResonatorFinder(const Parameters& parameters) : parameters_(parameters) {}

  enum class StopAt { kRidgesAndHolds, kRidgesAndAnchors };

  /// Turns to a partition. What it refers to outlives the questions asked about it. `same_map`: only positions and holds
  /// are others than last time; then the ruling lengths stay.
  void turn_to(const Partition& partition, bool same_map = false);

  /// Resonators of the regions reached from these triangles through shared edges that are no ridge (both triangles ridge)
  /// and hold no stamped vertex. In order of region. Empty only for no triangles.
  [[nodiscard]] std::vector<observation::Resonator> reached_from(std::span<const std::uint32_t> triangles, StopAt stop);

  /// One region's resonator. Lengths in space: l_r the mean straight ruling through points of the region, a fixed sample
  /// even by area; l_c the border edges, weighted by how curved they are, that nothing holds. O(region).
  [[nodiscard]] const observation::Resonator& region(std::uint32_t label);

 private:
  struct Reach {
    bool known = false;
    sheet::DisjointSets sets{0};
  };
  /// Of a region.
  struct Lasting {
    bool known = false;
    bool coarse = false;
    double ruling_m = 0;  ///< l_r
  };
  std::span<const std::uint32_t> triangles_of(std::uint32_t label) const;
  void index_regions();
  void measure_borders();
  Lasting measure_lasting(std::uint32_t label);
  void join_reachable(StopAt stop, sheet::DisjointSets& sets) const;
  observation::Resonator measure(std::uint32_t label);
  double ruling_length_m(std::uint32_t label);
  double stretch(std::uint32_t triangle, const sheet::Vec2f& direction) const;
  Parameters parameters_;
  const RegionStencils* stencils_ = nullptr;
  const RegionMap* map_ = nullptr;
  std::span<const sheet::Vec4f> positions_m_;
  sheet::Vec3d origin_m_ = sheet::Vec3d::Zero();
  const Holds* holds_ = nullptr;
  const sheet::SentPartition* sent_ = nullptr;

  bool indexed_ = false;
  std::vector<std::uint32_t> region_start_, region_triangles_;  ///< triangles by region
  std::array<Reach, 2> reach_;
  std::vector<observation::Resonator> measured_;  ///< [R]
  std::vector<Lasting> lasting_;                  ///< [R]
  bool borders_known_ = false;
  std::vector<double> free_border_m_;  ///< [R]
  std::vector<std::uint8_t> is_measured_, sounding_;
  std::vector<std::uint32_t> next_;
  Outlines outlines_;
  RulingTracer tracer_;
};

}  // namespace rustle::analysis
