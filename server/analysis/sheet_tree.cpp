#include "server/analysis/sheet_tree.h"

#include <limits>
#include <numeric>

namespace rustle::analysis {

using sheet::Triangle;
using sheet::Vec3f;

void SheetTree::build(std::span<const Triangle> triangles, std::span<const Vec3f> places_m) {
  nodes_.clear();
  order_.resize(triangles.size());
  std::iota(order_.begin(), order_.end(), 0u);
  leaves_.resize((triangles.size() + kLeafSize - 1) / kLeafSize);
  if (triangles.empty()) return;
  std::vector<Vec3f> centres(triangles.size());
  for (std::size_t t = 0; t < triangles.size(); ++t) {
    const Triangle& v = triangles[t];
    centres[t] = places_m[v[0]] + places_m[v[1]] + places_m[v[2]];
  }
  nodes_.push_back({0, static_cast<std::uint32_t>(triangles.size())});
  for (std::size_t n = 0; n < nodes_.size(); ++n) {
    const auto [first, count] = nodes_[n];
    if (count <= kLeafSize) continue;
    Eigen::AlignedBox3f spread;
    for (std::uint32_t k = 0; k < count; ++k) spread.extend(centres[order_[first + k]]);
    int axis = 0;
    spread.sizes().maxCoeff(&axis);
    const auto begin = order_.begin() + first;
    const std::uint32_t left = (count / 2 + kLeafSize - 1) / kLeafSize * kLeafSize;  // leaves start at multiples of four
    std::nth_element(begin, begin + left, begin + count, [&](std::uint32_t a, std::uint32_t b) {
      return centres[a][axis] != centres[b][axis] ? centres[a][axis] < centres[b][axis] : a < b;
    });
    nodes_[n] = {static_cast<std::uint32_t>(nodes_.size()), 0};
    nodes_.push_back({first, left});
    nodes_.push_back({first + left, count - left});
  }
  node_boxes_.resize(nodes_.size());
}

void SheetTree::refit(std::span<const Triangle> triangles, std::span<const Eigen::Vector4f> relative_m) {
  constexpr float kNowhere = std::numeric_limits<float>::infinity();
  for (std::size_t n = nodes_.size(); n-- > 0;) {
    const Node& node = nodes_[n];
    Box& box = node_boxes_[n];
    if (node.count == 0) {
      const Box& left = node_boxes_[node.first];
      const Box& right = node_boxes_[node.first + 1];
      box = {left.low.min(right.low), left.high.max(right.high)};
      continue;
    }
    Leaf& leaf = leaves_[node.first / kLeafSize];
    leaf.low.fill(Eigen::Array4f::Constant(kNowhere));
    leaf.high.fill(Eigen::Array4f::Constant(kNowhere));
    box = {Eigen::Array4f::Constant(kNowhere), Eigen::Array4f::Constant(-kNowhere)};
    for (std::uint32_t i = 0; i < node.count; ++i) {
      const Triangle& v = triangles[order_[node.first + i]];
      const Eigen::Array4f a = relative_m[v[0]].array();
      const Eigen::Array4f b = relative_m[v[1]].array();
      const Eigen::Array4f c = relative_m[v[2]].array();
      const Eigen::Array4f low = a.min(b).min(c);
      const Eigen::Array4f high = a.max(b).max(c);
      for (int k = 0; k < 3; ++k) {
        leaf.low[static_cast<std::size_t>(k)][static_cast<int>(i)] = low[k];
        leaf.high[static_cast<std::size_t>(k)][static_cast<int>(i)] = high[k];
      }
      box = {box.low.min(low), box.high.max(high)};
    }
  }
}

}  // namespace rustle::analysis
