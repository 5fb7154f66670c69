#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <span>
#include <vector>

#include "server/sheet/topology.h"
#include "server/sheet/vector.h"

/// Finding triangles near a point or a box: a tree for obstacles, a hashed grid for sheets.
namespace rustle::scene {

using sheet::Triangle;
using sheet::Vec3d;
using sheet::Vec3f;
using Box = Eigen::AlignedBox3d;

/// The point of a triangle closest to another, by its barycentric coordinates (≥ 0, sum 1).
struct TrianglePoint {
  Vec3d position_m;
  Vec3d barycentric;
};

/// By the Voronoi regions of corners, edges and face. A degenerate triangle counts as its edges.
TrianglePoint closest_on_triangle(const Vec3d& query, const Vec3d& a, const Vec3d& b, const Vec3d& c);

Box triangle_box(const Triangle& triangle, std::span<const Vec3f> positions_m);

/// A bounding volume tree over triangles of any sizes. Build O(T log T), refit O(T); const methods from any thread.
class TriangleTree {
 public:
  void build(std::span<const Triangle> triangles, std::span<const Vec3f> positions_m);

  /// After vertices have moved. \pre same triangles as at build().
  void refit(std::span<const Vec3f> positions_m);

  bool empty() const { return nodes_.empty(); }
  Box bounds() const { return nodes_.empty() ? Box() : nodes_.front().box; }

  /// Whether any triangle's box meets `box`.
  bool touches(const Box& box) const;

  /// Calls visit(triangle) for triangles that may lie within the radius of the query, nearest boxes first; visit returns
  /// the squared radius still of interest.
  template <class Visit>
  void visit_near(const Vec3d& query, double radius_m, Visit&& visit) const;

 private:
  struct Node {
    Box box;
    std::uint32_t first;  ///< of order_ in a leaf, else the left child; the right child follows it
    std::uint32_t count;  ///< 0: inner
  };

  std::vector<Triangle> triangles_;
  std::vector<std::uint32_t> order_;
  std::vector<Node> nodes_;  ///< parents before children
};

/// Triangles of about one size hashed into cubic cells. Build O(T), query O(candidates); const methods from any thread.
class TriangleGrid {
 public:
  /// \pre cell_m > 0. Triangles that span more than 64 cells are kept aside and are candidates everywhere.
  void build(std::span<const Triangle> triangles, std::span<const Vec3f> positions_m, double cell_m);

  /// Calls visit(triangle) once for each triangle whose cells meet those of `box`; visit returns false to stop.
  template <class Visit>
  void visit_box(const Box& box, Visit&& visit) const;

  std::size_t entry_count() const { return entries_.size() + oversize_.size(); }  ///< what build() had to store

 private:
  using Cell = std::array<std::int32_t, 3>;
  struct Entry {
    Cell cell;
    std::uint32_t triangle;
  };

  Cell cell_of(const Vec3d& point) const;
  std::uint32_t bucket_of(const Cell& cell) const;

  Vec3d origin_m_ = Vec3d::Zero();
  double cells_per_m_ = 1;
  Cell last_cell_ = {-1, -1, -1};
  std::vector<std::uint32_t> bucket_start_;
  std::vector<Entry> entries_;
  std::vector<Cell> first_cell_;  ///< of each triangle
  std::vector<std::uint32_t> oversize_;
};

template <class Visit>
void TriangleTree::visit_near(const Vec3d& query, double radius_m, Visit&& visit) const {
  if (nodes_.empty()) return;
  double limit = radius_m * radius_m;
  struct Pending {
    double distance2;
    std::uint32_t node;
  };
  std::array<Pending, 64> stack;
  std::size_t depth = 0;
  stack[depth++] = {nodes_[0].box.squaredExteriorDistance(query), 0};
  while (depth > 0) {
    const Pending top = stack[--depth];
    if (top.distance2 > limit) continue;
    const Node& node = nodes_[top.node];
    if (node.count > 0) {
      for (std::uint32_t k = 0; k < node.count; ++k) limit = visit(order_[node.first + k]);
      continue;
    }
    Pending near{nodes_[node.first].box.squaredExteriorDistance(query), node.first};
    Pending far{nodes_[node.first + 1].box.squaredExteriorDistance(query), node.first + 1};
    if (far.distance2 < near.distance2) std::swap(near, far);
    stack[depth++] = far;
    stack[depth++] = near;
  }
}

template <class Visit>
void TriangleGrid::visit_box(const Box& box, Visit&& visit) const {
  for (const std::uint32_t triangle : oversize_) {
    if (!visit(triangle)) return;
  }
  if (entries_.empty()) return;
  Cell low = cell_of(box.min());
  Cell high = cell_of(box.max());
  for (int k = 0; k < 3; ++k) {
    low[k] = std::max(low[k], 0);
    high[k] = std::min(high[k], last_cell_[k]);
  }
  for (std::int32_t z = low[2]; z <= high[2]; ++z) {
    for (std::int32_t y = low[1]; y <= high[1]; ++y) {
      for (std::int32_t x = low[0]; x <= high[0]; ++x) {
        const Cell cell{x, y, z};
        const std::uint32_t bucket = bucket_of(cell);
        for (std::uint32_t k = bucket_start_[bucket]; k < bucket_start_[bucket + 1]; ++k) {
          const Entry& entry = entries_[k];
          if (entry.cell[0] != x || entry.cell[1] != y || entry.cell[2] != z) continue;
          const Cell& first = first_cell_[entry.triangle];  // a pair meets first in the greater of their lowest cells
          if (x != std::max(first[0], low[0]) || y != std::max(first[1], low[1]) || z != std::max(first[2], low[2]))
            continue;
          if (!visit(entry.triangle)) return;
        }
      }
    }
  }
}

}  // namespace rustle::scene
