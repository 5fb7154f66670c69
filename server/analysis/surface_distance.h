#pragma once

#include <algorithm>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "server/analysis/contact_patch.h"
#include "server/analysis/sheet_tree.h"

namespace rustle::analysis {

/// How far apart places of one sheet are along its surface: by material coordinates, else along edges.
class SurfaceDistance {
 public:
  /// Places nearer than max(least_m, edges · local edge length) count as neighbours. Without material coordinates edge
  /// lengths are those of the rest positions, else of `positions_m`.
  SurfaceDistance(std::shared_ptr<const sheet::Topology> topology, std::span<const sheet::Vec3f> positions_m, double least_m,
                  double edges);

  const std::shared_ptr<const sheet::Topology>& topology() const { return topology_; }
  double least_m() const { return least_m_; }
  bool by_material() const { return !patches_.empty(); }

  bool neighbours(const SheetSpot& a, const SheetSpot& b);

  /// Turns to a triangle. O(1) by material coordinates, else the triangles around it.
  void approach(std::uint32_t triangle);

  /// True: every place of `other` is a neighbour of every place of the triangle approached.
  bool wholly_neighbours(std::uint32_t other) const;

  /// The same of two triangles. \pre by_material()
  bool wholly_neighbours(std::uint32_t a, std::uint32_t b) const { return covers(patches_[a], patches_[b]); }

  /// A rectangle of the material, with the least exclusion of the triangles in it.
  struct Patch {
    Eigen::Array2f centre_m, half_m;
    float exclusion_m;
  };

  /// True: all places in both are neighbours. Rounded to the safe side.
  static bool covers(const Patch& a, const Patch& b) {
    const float within_m = std::max(a.exclusion_m, b.exclusion_m) * (1 - 1e-5f);
    const Eigen::Array2f farthest_m = (a.centre_m - b.centre_m).abs() + a.half_m + b.half_m;
    return farthest_m.square().sum() < within_m * within_m;
  }

  /// Around the triangles below every node. \pre by_material()
  std::vector<Patch> patches_of(const SheetTree& tree) const;

 private:
  sheet::Vec2d material_at(const SheetSpot& spot) const;
  const std::vector<std::uint32_t>& vertices_around(std::uint32_t vertex);
  const std::vector<std::uint32_t>& triangles_around(std::uint32_t triangle);

  std::shared_ptr<const sheet::Topology> topology_;
  double least_m_;
  std::vector<double> exclusion_m_;  ///< [T]
  std::vector<Patch> patches_;       ///< [T], or empty without material coordinates
  struct Link {
    std::uint32_t vertex;
    double length_m;
  };
  std::vector<std::uint32_t> link_start_;
  std::vector<Link> links_;
  std::vector<double> vertex_exclusion_m_;                    ///< [V], the greatest around
  std::vector<std::vector<std::uint32_t>> vertices_around_;   ///< [V], made when asked for
  std::vector<std::vector<std::uint32_t>> triangles_around_;  ///< [T], made when asked for
  std::vector<std::uint32_t> triangle_start_, triangles_of_vertex_;
  std::uint32_t approached_ = sheet::kNone;
  std::vector<std::uint32_t> marks_;  ///< [T]: wholly neighbours of the triangle marked
};

}  // namespace rustle::analysis
