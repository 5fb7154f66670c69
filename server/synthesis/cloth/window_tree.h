#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "server/synthesis/cloth/feature_rows.h"

namespace rustle::cloth {

/// Windows of a database, each `length` units long, ordered so that those near a target's come first. A window's rows are
/// split into kParts runs; with mean f_p of the target's run p and g_p of the database's, n_p units each,
///   D2 = Σ_k |f_k - g_k| ≥ Σ_p n_p |f_p - g_p|            (triangle inequality)
/// which a tree of boxes around those means searches by branch and bound, kFan boxes side by side. Windows alike in every
/// row (silence) are one class: its members are alike in D2, so the lowest free one stands for all. Immutable; any thread.
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
  static constexpr std::size_t kFan = 16;        ///< classes of a leaf, children of a node
  static constexpr std::size_t kMostLevels = 8;  ///< kFan^kMostLevels classes
  using Bounds = std::array<float, kFan>;

  void find_classes(const FeatureRows& database, std::span<const std::uint32_t> left);
  /// Orders classes so that every node's are near to each other: halves along the widest side, cut where nodes end.
  void sort(std::span<std::uint32_t> classes, const std::vector<float>& keys) const;
  void add_leaves(const std::vector<float>& keys);
  void add_nodes();
  /// Children of a node: classes of a leaf (level 0), else nodes of the level below.
  std::uint32_t children(std::size_t level, std::uint32_t node) const noexcept;
  void bounds_of(std::size_t level, std::uint32_t node, const Key& key, Bounds& out) const noexcept;
  /// What rounding may add to a bound.
  double slack_of(const Key& key) const noexcept;

  /// Nodes of one height; node i holds the nodes kFan · i and on of the level below.
  struct Level {
    std::uint32_t nodes = 0;
    std::vector<float> low, high;  ///< [node][width][child]; of leaves the keys, in `low` alone
  };

  std::size_t dimensions_, length_, width_;  ///< width: floats of a key
  std::array<std::uint32_t, kParts + 1> part_begin_{};
  std::array<float, kParts> part_units_{};
  std::vector<std::uint32_t> class_of_, members_, first_member_;
  std::vector<std::uint32_t> order_;  ///< classes in the order of the leaves
  std::vector<Level> levels_;         ///< leaves first; the last has one node
  float largest_ = 0;                 ///< of all features
};

template <class Visit>
void WindowTree::search(const Key& key, double limit, Visit&& visit) const {
  if (levels_.empty()) return;
  struct Waiting {
    float bound = 0;
    std::uint32_t node = 0;
    std::size_t level = 0;
  };
  std::array<Waiting, kMostLevels * kFan> stack;
  std::size_t depth = 0;
  const double slack = slack_of(key);
  const auto rounded = [&](double distance) { return static_cast<float>((distance + slack) * (1 + 2e-5)); };
  float most = rounded(limit);
  stack[depth++] = {0, 0, levels_.size() - 1};
  Bounds bounds;
  while (depth > 0) {
    const Waiting next = stack[--depth];
    if (next.bound > most) continue;
    bounds_of(next.level, next.node, key, bounds);
    const std::uint32_t first = kFan * next.node, count = children(next.level, next.node);
    const std::size_t waiting = depth;
    for (std::uint32_t k = 0; k < count; ++k) {
      if (bounds[k] > most) continue;
      if (next.level == 0) {
        most = rounded(visit(order_[first + k]));
        continue;
      }
      // The nearest on top.
      std::size_t at = depth++;
      for (; at > waiting && stack[at - 1].bound < bounds[k]; --at) stack[at] = stack[at - 1];
      stack[at] = {bounds[k], first + k, next.level - 1};
    }
  }
}

}  // namespace rustle::cloth
