#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "server/analysis/parameters.h"
#include "server/analysis/regions.h"
#include "server/observation/observation.h"

/// Which regions an event sets vibrating (P4), and what they sound like (P5).
namespace rustle::analysis {

/// What holds the sheet's vertices, on the mesh of the partition.
struct Holds {
  std::vector<bool> anchored;  ///< [V]
  std::vector<bool> touching;  ///< [V] in contact with anything
};

/// One frame's partition with what measuring it needs. Regions are measured when first asked for.
class ResonatorFinder {
 public:
  /// `partition`: the simulator's own, whose rulings give the lengths; null: rulings are traced. All arguments outlive this.
  ResonatorFinder(const RegionStencils& stencils, const RegionMap& map, std::span<const sheet::Vec3f> positions_m,
                  const sheet::Vec3d& origin_m, const Holds& holds, const Parameters& parameters,
                  const sheet::SentPartition* partition);

  enum class StopAt { kRidgesAndHolds, kRidgesAndAnchors };

  /// Resonators of the regions reached from these triangles through shared edges that are no ridge (both triangles ridge)
  /// and hold no stamped vertex. In order of region. Empty only for no triangles.
  [[nodiscard]] std::vector<observation::Resonator> reached_from(std::span<const std::uint32_t> triangles, StopAt stop);

  /// One region's resonator. Lengths in space: l_r the mean straight ruling through points of the region, a fixed sample
  /// stratified by area; l_c the border edges, weighted by how curved they are, that nothing holds.
  [[nodiscard]] const observation::Resonator& region(std::uint32_t label);

 private:
  observation::Resonator measure(std::uint32_t label) const;
  double ruling_length_m(std::uint32_t label) const;
  double traced_m(std::uint32_t triangle, const sheet::Vec2d& from, double angle_rad, double gap_m) const;

  const RegionStencils& stencils_;
  const RegionMap& map_;
  std::span<const sheet::Vec3f> positions_m_;
  sheet::Vec3d origin_m_;
  const Holds& holds_;
  const Parameters& parameters_;
  const sheet::SentPartition* partition_;
  std::vector<std::uint32_t> region_start_, region_triangles_;  ///< triangles by region
  std::vector<std::optional<observation::Resonator>> measured_;
};

}  // namespace rustle::analysis
