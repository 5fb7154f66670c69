#pragma once

#include <algorithm>
#include <array>
#include <cassert>
#include <cstdint>
#include <span>
#include <vector>

#include "server/sheet/topology.h"
#include "server/sheet/vector.h"

namespace rustle::analysis {

/// A bounding volume tree over a sheet's triangles: built once per topology, refitted every frame, to find the pairs of
/// triangles that come near each other. Single precision, relative to an origin near by.
class SheetTree {
 public:
  struct Node {
    std::uint32_t first;  ///< of triangles() in a leaf, else the left child; the right child follows it
    std::uint32_t count;  ///< 0: inner
  };
  struct Box {
    Eigen::Array4f low, high;
  };

  /// Halves the triangles at their median, by their places at rest or in any frame. O(T log T).
  void build(std::span<const sheet::Triangle> triangles, std::span<const sheet::Vec3f> places_m);

  /// O(T). \pre same triangles as at build(), the last coordinate 0
  void refit(std::span<const sheet::Triangle> triangles, std::span<const Eigen::Vector4f> relative_m);

  std::span<const Node> nodes() const { return nodes_; }  ///< parents before children
  std::span<const std::uint32_t> triangles() const { return order_; }

  /// Calls visit(a, b) for every triangle a of this and b of `other` whose boxes come within `within_m` of each other, but
  /// for those below two nodes for which skip(node, other's node) holds.
  template <class Skip, class Visit>
  void visit_pairs(const SheetTree& other, float within_m, Skip&& skip, Visit&& visit) const {
    if (nodes_.empty() || other.nodes_.empty()) return;
    descend(other, {0, 0}, false, within_m, skip, visit);
  }

  /// The same for the pairs in this tree, each once, no triangle with itself; skip(n, n) stands for the pairs in n.
  template <class Skip, class Visit>
  void visit_own_pairs(float within_m, Skip&& skip, Visit&& visit) const {
    if (!nodes_.empty()) descend(*this, {0, 0}, true, within_m, skip, visit);
  }

 private:
  struct Pair {
    std::uint32_t a, b;
  };
  static constexpr std::uint32_t kLeafSize = 4;
  static constexpr std::size_t kStack = 512;  ///< four pairs for each of at most 2 · 32 levels, and more

  /// The triangles of a leaf side by side; places that are free lie at infinity.
  struct Leaf {
    std::array<Eigen::Array4f, 3> low, high;  ///< by coordinate
  };

  static bool apart(const Box& a, const Box& b, float within_m) {
    return (a.low - b.high).max(b.low - a.high).maxCoeff() > within_m;
  }
  static float size_m(const Box& box) { return (box.high - box.low).sum(); }

  /// How far one triangle of a leaf and each of another are apart, by coordinate at most.
  static Eigen::Array4f gaps_m(const Leaf& a, int place, const Leaf& b) {
    Eigen::Array4f gap = Eigen::Array4f::Zero();
    for (std::size_t k = 0; k < 3; ++k) {
      gap = gap.max((a.low[k][place] - b.high[k]).max(b.low[k] - a.high[k][place]));
    }
    return gap;
  }

  template <class Skip, class Visit>
  void descend(const SheetTree& other, Pair root, bool own, float within_m, Skip&& skip, Visit&& visit) const;

  std::vector<Node> nodes_;
  std::vector<Box> node_boxes_;
  std::vector<std::uint32_t> order_;
  std::vector<Leaf> leaves_;  ///< by four of the order
};

template <class Skip, class Visit>
void SheetTree::descend(const SheetTree& other, Pair root, bool own, float within_m, Skip&& skip, Visit&& visit) const {
  std::array<Pair, kStack> stack;
  std::size_t depth = 0;
  stack[depth++] = root;
  while (depth > 0) {
    const Pair top = stack[--depth];
    assert(depth + 4 <= kStack);
    const Node& a = nodes_[top.a];
    const Node& b = other.nodes_[top.b];
    const bool same = own && top.a == top.b;
    if (!same && apart(node_boxes_[top.a], other.node_boxes_[top.b], within_m)) continue;
    if (skip(top.a, top.b)) continue;
    if (a.count > 0 && b.count > 0) {
      // Whether two boxes meet is hard to foretell: counted without branches.
      std::array<Pair, kLeafSize * kLeafSize> met;
      std::size_t count = 0;
      for (std::uint32_t i = 0; i < a.count; ++i) {
        const Eigen::Array4f gaps =
            gaps_m(leaves_[a.first / kLeafSize], static_cast<int>(i), other.leaves_[b.first / kLeafSize]);
        for (std::uint32_t j = same ? i + 1 : 0; j < b.count; ++j) {
          met[count] = {order_[a.first + i], other.order_[b.first + j]};
          count += gaps[static_cast<int>(j)] <= within_m;
        }
      }
      for (std::size_t k = 0; k < count; ++k) visit(met[k].a, met[k].b);
    } else if (same) {
      stack[depth++] = {a.first, a.first + 1};
      stack[depth++] = {a.first + 1, a.first + 1};
      stack[depth++] = {a.first, a.first};
    } else if (b.count > 0 || (a.count == 0 && size_m(node_boxes_[top.a]) >= size_m(other.node_boxes_[top.b]))) {
      stack[depth++] = {a.first + 1, top.b};
      stack[depth++] = {a.first, top.b};
    } else {
      stack[depth++] = {top.a, b.first + 1};
      stack[depth++] = {top.a, b.first};
    }
  }
}

}  // namespace rustle::analysis
