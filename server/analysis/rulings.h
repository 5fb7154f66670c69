#pragma once

#include <cstdint>
#include <vector>

#include "server/analysis/regions.h"

/// Straight rulings through the regions of a partition (P5).
namespace rustle::analysis {

/// Sides of one region in the rest plane, in lanes; those left over have no length.
struct SideBlock {
  static constexpr std::size_t kLanes = 32;
  float start_x[kLanes] = {}, start_y[kLanes] = {}, end_x[kLanes] = {}, end_y[kLanes] = {};  ///< m
  std::uint8_t is_border[kLanes] = {};                                                       ///< of the sheet
};

/// The sides of every region, region by region: where labels differ, and the sheet's border.
struct Outlines {
  std::vector<std::uint32_t> start;  ///< [R + 1], of blocks
  std::vector<SideBlock> blocks;
  std::vector<std::uint32_t> next;  ///< working memory
};
void outline_regions(const RegionStencils& stencils, const RegionMap& map, Outlines& out);

/// Follows straight lines of the rest plane to the outline of their region. Keeps working memory.
class RulingTracer {
 public:
  /// Length of the line through a place inside a region, both ways to where it leaves the region for more than `gap_m` or
  /// reaches the sheet's border: a ruling may run along an outline that is jagged because it follows triangle edges.
  /// `direction` has unit length. O(sides of the region).
  double length_m(const Outlines& outlines, std::uint32_t region, const sheet::Vec2f& from, const sheet::Vec2f& direction,
                  float gap_m);

 private:
  struct Crossing {
    float at_m;
    bool is_border;
  };
  static float reach_m(std::vector<Crossing>& crossings, float gap_m);

  std::vector<Crossing> ahead_, behind_;
};

}  // namespace rustle::analysis
