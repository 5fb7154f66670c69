#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "server/analysis/contact_patch.h"
#include "server/analysis/sheet_tree.h"
#include "server/analysis/surface_distance.h"
#include "server/scene/triangles.h"

namespace rustle::analysis {

/// A sheet at one time, in a tree that stays while its topology does.
class PosedSheet {
 public:
  /// `positions_m` are looked at until the next call. O(T), on a new topology O(T log T).
  void update(const std::shared_ptr<const sheet::Topology>& topology, std::span<const sheet::Vec3f> positions_m,
              const sheet::Vec3f& origin_m);

  const sheet::Topology& topology() const { return *topology_; }
  std::span<const sheet::Vec3f> positions_m() const { return positions_m_; }
  const SheetTree& tree() const { return tree_; }
  std::uint64_t builds() const { return builds_; }  ///< how many trees there have been

 private:
  std::shared_ptr<const sheet::Topology> topology_;
  std::span<const sheet::Vec3f> positions_m_;
  std::vector<Eigen::Vector4f> relative_m_;
  SheetTree tree_;
  std::uint64_t builds_ = 0;
};

/// A sheet as a partner: another one, or the same one without what is near along its surface. Keeps working memory; set()
/// and set_same() turn it to a sheet.
class SheetContact : public ContactSurface {
 public:
  /// Both posed around the origin of the geometry that select() gets. Without any velocities `other` is at rest. What is
  /// passed outlives what follows.
  void set(const PosedSheet& own, const PosedSheet& other, const VertexVelocities& velocities);
  void set_same(const PosedSheet& own, const VertexVelocities& velocities, SurfaceDistance& along_surface);

  /// Pairs of triangles from both trees. Cost: the pairs that come near each other.
  void select(const ContactGeometry& geometry, double radius_m, std::vector<std::uint32_t>& out_triangles) override;
  void approach(std::uint32_t triangle) override;
  bool surely_apart(std::uint32_t triangle, double radius_m) override;

  /// The nearest place; of places equally near within a millionth, any, but always the same one.
  bool touch(const sheet::Vec3d& point_m, const SheetSpot& spot, double radius_m, Touch& out) override;

  std::size_t pairs_visited() const { return visited_; }  ///< by the last select(): the broad phase's work

 private:
  /// A triangle of the other sheet made ready for distances, relative to the origin.
  struct Facet {
    std::uint32_t triangle;
    bool degenerate;
    sheet::Vec3d corner_m, side_b_m, side_c_m;  ///< its first corner and the sides from there
    sheet::Vec3d normal;                        ///< unit length, or zero
    sheet::Vec3d share_b, share_c;              ///< barycentric shares of p: share · (p - corner)
    std::array<double, 3> heights_m;            ///< over the side opposite each corner
  };
  /// A facet that a point does not lie above, with the distance it has at least.
  struct Beside {
    std::uint32_t facet;
    double least2_m2;
  };

  void list_candidates(std::size_t triangle_count, std::vector<std::uint32_t>& out_triangles);
  std::uint32_t facet(std::uint32_t triangle);
  static scene::TrianglePoint closest(const Facet& facet, const sheet::Vec3d& point_m);

  const PosedSheet* own_ = nullptr;
  const PosedSheet* other_ = nullptr;
  VertexVelocities velocities_;
  SurfaceDistance* same_sheet_ = nullptr;
  sheet::Vec3d origin_m_ = sheet::Vec3d::Zero();

  std::shared_ptr<const sheet::Topology> patches_topology_;
  std::uint64_t patches_build_ = 0;
  double patches_least_m_ = 0;
  std::vector<SurfaceDistance::Patch> patches_;  ///< of the tree's nodes

  struct Pair {
    std::uint32_t mine, theirs;
  };
  std::vector<Pair> pairs_;
  std::vector<std::uint32_t> start_, next_;  ///< [T + 1], [T]
  std::vector<std::uint32_t> candidates_;    ///< by triangle
  std::vector<std::uint32_t> near_;          ///< facets, candidates of the triangle approached
  struct Made {
    std::uint32_t epoch = 0, facet = 0;
  };
  std::vector<Made> made_;  ///< [T of the other]
  std::vector<Facet> facets_;
  std::uint32_t epoch_ = 0;
  std::vector<Beside> beside_;
  std::size_t visited_ = 0;
};

/// The closest place of a whole sheet, for a few points.
class ClosestOnSheet {
 public:
  /// What is passed outlives it. Without any velocities the sheet is at rest. O(T)
  ClosestOnSheet(const sheet::Topology& topology, std::span<const sheet::Vec3f> positions_m,
                 const VertexVelocities& velocities, double radius_m);
  std::optional<Touch> find(const sheet::Vec3d& point_m, double radius_m) const;

 private:
  const sheet::Topology& topology_;
  std::span<const sheet::Vec3f> positions_m_;
  VertexVelocities velocities_;
  scene::TriangleGrid grid_;
};

}  // namespace rustle::analysis
