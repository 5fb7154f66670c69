#pragma once

#include <array>
#include <cstdint>
#include <limits>
#include <memory>
#include <span>
#include <vector>

#include "server/analysis/parameters.h"
#include "server/analysis/regions.h"
#include "server/sheet/face_geometry.h"
#include "server/sheet/mesh_frame.h"

namespace rustle::page {

inline constexpr std::uint16_t kNoRegion = 0xffff;

/// Both ends, in metres.
using Segment = std::array<sheet::Vec3f, 2>;

/// Where a sheet that moves has its regions, ridges and rulings (P3), for pictures: what the analysis would use if it needed
/// regions in this frame. A region keeps its number from frame to frame as long as most of it stays, so that it may keep its
/// colour. What depends on the topology alone is kept. One sheet. [page thread]
class Partition {
 public:
  /// Frames in the order of their times. \pre the frame has the sizes its topology says, all finite
  void update(const sheet::MeshFrame& frame);

  /// As of the last update(), by vertex of its topology; kNoRegion: of no triangle.
  std::span<const std::uint16_t> regions() const { return regions_; }
  /// Where they are now. \pre positions_m are of the last update()'s topology
  std::vector<Segment> ridges(std::span<const sheet::Vec3f> positions_m) const;
  std::vector<Segment> rulings(std::span<const sheet::Vec3f> positions_m) const;
  /// Null: there was none.
  const std::shared_ptr<const sheet::Topology>& topology() const { return topology_; }

 private:
  static constexpr std::size_t kMostRulings = 160;

  /// Half a ruling from a triangle's middle: along_a of its first side and along_b of its last.
  struct Ruling {
    std::array<std::uint32_t, 3> corners;
    float along_a, along_b;
  };
  struct Mesh;

  void meet(const sheet::MeshFrame& frame);
  void number_regions();
  void find_ridges();
  void find_rulings();

  std::shared_ptr<const sheet::Topology> topology_;
  std::shared_ptr<const Mesh> mesh_;
  analysis::RegionState history_;
  analysis::RegionScratch scratch_;
  analysis::RegionMap map_;
  std::vector<sheet::Vec4f> relative_m_, gathered_m_;
  std::span<const sheet::Vec4f> positions_m_;  ///< of the mesh of the partition
  std::vector<std::uint16_t> regions_, earlier_;
  std::vector<std::array<std::uint32_t, 2>> ridges_;  ///< vertices of the sheet
  std::vector<Ruling> rulings_;
};

}  // namespace rustle::page
