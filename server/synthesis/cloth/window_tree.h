#pragma once

#include <array>
#include <cstdint>
#include <limits>
#include <span>
#include <vector>

#include "server/synthesis/cloth/feature_rows.h"

namespace rustle::cloth {

/// Windows of a database, each `length` units long, ordered so that those near a target's come first. A window's rows are
/// split into kParts runs; with mean f_p of the target's run p and g_p of the database's, n_p units each,
///   D2 = Σ_k |f_k - g_k| ≥ Σ_p n_p |f_p - g_p|            (triangle inequality)
/// which a kd-tree of those means searches by branch and bound. Windows alike in every row (silence) are one class: its
/// members are alike in D2, so the lowest free one stands for all. Immutable; any thread.
class WindowTree {
 public:
  static constexpr std::size_t kParts = 3;
  static constexpr std::size_t kMostDimensions = 6;

  /// \param left  units that follow each unit in its recording; windows that reach beyond are left out
  /// Allocates; O(units log units). \pre database.dimensions ≤ kMostDimensions, length ≥ 1
  WindowTree(const FeatureRows& database, std::span<const std::uint32_t> left, std::size_t length);

  /// A target window's means.
  using Key = std::array<float, kParts * kMostDimensions>;
  Key key_of(const FeatureRows& window) const noexcept;

  std::size_t classes() const noexcept { return first_member_.empty() ? 0 : first_member_.size() - 1; }
  /// The first units of a class's windows, rising.
  std::span<const std::uint32_t> members(std::uint32_t window_class) const noexcept {
    return std::span(members_).subspan(first_member_[window_class],
                                       first_member_[window_class + 1] - first_member_[window_class]);
  }
  /// The class of the window that begins at a unit; kNoClass where it has none.
  std::uint32_t class_of(std::uint32_t unit) const noexcept { return class_of_[unit]; }
  static constexpr std::uint32_t kNoClass = 0xffffffffU;

  /// Calls visit(class) for every class whose bound, less what rounding can make of it, does not exceed `limit`; visit
  /// returns the limit from there on. Near ones tend to come first.
  template <class Visit>
  void search(const Key& key, double limit, Visit&& visit) const;

 private:
  static constexpr std::size_t kLeaf = 16;
  struct Node {
    std::uint32_t first = 0;  ///< of its classes in `order_`
    std::uint32_t count = 0;
    std::uint32_t right = 0;  ///< 0: a leaf; the left child is the next node
    std::array<float, kParts * kMostDimensions> low{}, high{};
  };
  using Bounds = std::array<float, kLeaf>;

  void find_classes(const FeatureRows& database, std::span<const std::uint32_t> left);
  std::uint32_t build(std::uint32_t first, std::uint32_t count, std::vector<float>& keys);
  void lay_out(const std::vector<float>& keys);
  float node_bound(const Node& node, const Key& key) const noexcept;
  void leaf_bounds(const Node& node, const Key& key, Bounds& out) const noexcept;
  /// What rounding may add to a bound.
  double slack_of(const Key& key) const noexcept;

  std::size_t dimensions_, length_, width_;  ///< width: floats of a key
  std::array<std::uint32_t, kParts + 1> part_begin_{};
  std::array<float, kParts> part_units_{};
  std::vector<std::uint32_t> class_of_, members_, first_member_;
  std::vector<std::uint32_t> order_;  ///< classes in the order of the leaves
  std::vector<float> leaf_keys_;      ///< [leaf][width][kLeaf]
  std::vector<Node> nodes_;
  float largest_ = 0;  ///< of all features
};

template <class Visit>
void WindowTree::search(const Key& key, double limit, Visit&& visit) const {
  if (nodes_.empty()) return;
  struct Waiting {
    std::uint32_t node;
    float bound;
  };
  std::array<Waiting, 64> stack;
  std::size_t depth = 0;
  const double slack = slack_of(key);
  const auto beyond = [&](float bound) { return static_cast<double>(bound) * (1 - 1e-5) - slack > limit; };
  stack[depth++] = {0, node_bound(nodes_[0], key)};
  Bounds bounds;
  while (depth > 0) {
    const Waiting next = stack[--depth];
    if (beyond(next.bound)) continue;
    const Node& node = nodes_[next.node];
    if (node.right != 0) {
      const Waiting a{next.node + 1, node_bound(nodes_[next.node + 1], key)};
      const Waiting b{node.right, node_bound(nodes_[node.right], key)};
      const bool a_first = a.bound <= b.bound;
      stack[depth++] = a_first ? b : a;
      stack[depth++] = a_first ? a : b;
      continue;
    }
    leaf_bounds(node, key, bounds);
    for (std::uint32_t k = 0; k < node.count; ++k) {
      if (!beyond(bounds[k])) limit = visit(order_[node.first + k]);
    }
  }
}

}  // namespace rustle::cloth
