#pragma once

#include <algorithm>
#include <cstdint>
#include <numeric>
#include <vector>

namespace rustle::sheet {

/// Union-find. The representative of a set is its lowest member, whatever the order of joining.
class DisjointSets {
 public:
  explicit DisjointSets(std::size_t count) { reset(count); }

  /// So many sets of one member.
  void reset(std::size_t count) {
    parent_.resize(count);
    std::iota(parent_.begin(), parent_.end(), 0u);
  }

  std::uint32_t find(std::uint32_t i) {
    while (parent_[i] != i) i = parent_[i] = parent_[parent_[i]];
    return i;
  }
  void join(std::uint32_t a, std::uint32_t b) {
    a = find(a), b = find(b);
    if (a != b) parent_[std::max(a, b)] = std::min(a, b);
  }

 private:
  std::vector<std::uint32_t> parent_;
};

}  // namespace rustle::sheet
