#include "server/synthesis/cloth/window_tree.h"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <cstring>
#include <numeric>

#include "server/sheet/simd.h"
#include "sound_db/dsp/random.h"

namespace rustle::cloth {
namespace {

/// bounds[k] = Σ_p n_p |key_p - window k's|, of a leaf's 16 windows side by side.
RUSTLE_SIMD void add_bounds(const float* key, const float* windows, std::size_t dimensions, const float* part_units,
                            std::size_t parts, float* bounds) noexcept {
  constexpr std::size_t kLanes = 16;
  float total[kLanes] = {};
  for (std::size_t p = 0; p < parts; ++p) {
    float sum[kLanes] = {};
    for (std::size_t d = 0; d < dimensions; ++d) {
      const float* x = windows + (p * dimensions + d) * kLanes;
      const float y = key[p * dimensions + d];
      for (std::size_t k = 0; k < kLanes; ++k) {
        const float e = x[k] - y;
        sum[k] += e * e;
      }
    }
    for (std::size_t k = 0; k < kLanes; ++k) total[k] += part_units[p] * std::sqrt(sum[k]);
  }
  for (std::size_t k = 0; k < kLanes; ++k) bounds[k] = total[k];
}

}  // namespace

WindowTree::WindowTree(const FeatureRows& database, std::span<const std::uint32_t> left, std::size_t length)
    : dimensions_(database.dimensions), length_(length), width_(kParts * database.dimensions) {
  assert(dimensions_ <= kMostDimensions && length_ >= 1);
  for (std::size_t p = 0; p <= kParts; ++p) part_begin_[p] = static_cast<std::uint32_t>(p * length_ / kParts);
  for (std::size_t p = 0; p < kParts; ++p) part_units_[p] = static_cast<float>(part_begin_[p + 1] - part_begin_[p]);
  for (const float x : database.values) largest_ = std::max(largest_, std::abs(x));
  find_classes(database, left);
  const auto count = static_cast<std::uint32_t>(classes());
  if (count == 0) return;
  std::vector<float> keys(count * width_);
  for (std::uint32_t c = 0; c < count; ++c) {
    const std::size_t unit = members(c).front();
    const Key key = key_of({database.values.subspan(unit * dimensions_, length_ * dimensions_), dimensions_});
    std::copy_n(key.begin(), width_, keys.begin() + static_cast<std::ptrdiff_t>(c * width_));
  }
  order_.resize(count);
  std::iota(order_.begin(), order_.end(), 0U);
  build(0, count, keys);
  lay_out(keys);
}

WindowTree::Key WindowTree::key_of(const FeatureRows& window) const noexcept {
  Key key{};
  for (std::size_t p = 0; p < kParts; ++p) {
    for (std::size_t d = 0; d < dimensions_; ++d) {
      double sum = 0;
      for (std::size_t k = part_begin_[p]; k < part_begin_[p + 1]; ++k) sum += static_cast<double>(window.row(k)[d]);
      key[p * dimensions_ + d] = part_units_[p] > 0 ? static_cast<float>(sum / static_cast<double>(part_units_[p])) : 0.0F;
    }
  }
  return key;
}

void WindowTree::find_classes(const FeatureRows& database, std::span<const std::uint32_t> left) {
  std::vector<std::uint32_t> units;
  for (std::uint32_t unit = 0; unit < left.size(); ++unit) {
    if (left[unit] + 1 >= length_) units.push_back(unit);
  }
  // Equal rows have one number, equal windows one hash; what the hash brings together is compared.
  const std::size_t row_bytes = dimensions_ * sizeof(float), bytes = length_ * row_bytes;
  std::vector<std::uint64_t> rows(left.size());
  for (std::size_t unit = 0; unit < rows.size(); ++unit) {
    for (std::size_t d = 0; d < dimensions_; ++d) {
      std::uint32_t bits = 0;
      std::memcpy(&bits, database.row(unit) + d, sizeof bits);
      rows[unit] = dsp::hash(rows[unit], bits);
    }
  }
  std::vector<std::uint64_t> hashes(left.size());
  for (const std::uint32_t unit : units) {
    for (std::size_t k = 0; k < length_; ++k) hashes[unit] = dsp::hash(hashes[unit], rows[unit + k]);
  }
  std::ranges::sort(units, {}, [&](std::uint32_t unit) { return std::pair(hashes[unit], unit); });
  class_of_.assign(left.size(), kNoClass);
  for (const std::uint32_t unit : units) {
    const bool same = !members_.empty() && hashes[members_.back()] == hashes[unit] &&
                      std::memcmp(database.row(members_.back()), database.row(unit), bytes) == 0;
    if (!same) first_member_.push_back(static_cast<std::uint32_t>(members_.size()));
    class_of_[unit] = static_cast<std::uint32_t>(first_member_.size() - 1);
    members_.push_back(unit);
  }
  if (!first_member_.empty()) first_member_.push_back(static_cast<std::uint32_t>(members_.size()));
}

std::uint32_t WindowTree::build(std::uint32_t first, std::uint32_t count, std::vector<float>& keys) {
  const auto index = static_cast<std::uint32_t>(nodes_.size());
  nodes_.emplace_back();
  nodes_[index].first = first;
  nodes_[index].count = count;
  const auto own = std::span(order_).subspan(first, count);
  std::size_t widest = 0;
  float extent = -1;
  for (std::size_t k = 0; k < width_; ++k) {
    float low = std::numeric_limits<float>::infinity(), high = -low;
    for (const std::uint32_t c : own) {
      low = std::min(low, keys[c * width_ + k]);
      high = std::max(high, keys[c * width_ + k]);
    }
    nodes_[index].low[k] = low;
    nodes_[index].high[k] = high;
    if (high - low > extent) {
      extent = high - low;
      widest = k;
    }
  }
  if (count <= kLeaf) return index;
  const std::uint32_t half = (count / 2 + kLeaf - 1) / kLeaf * kLeaf;
  std::ranges::nth_element(own, own.begin() + half, {},
                           [&](std::uint32_t c) { return std::pair(keys[c * width_ + widest], c); });
  build(first, half, keys);
  const std::uint32_t right = build(first + half, count - half, keys);
  nodes_[index].right = right;
  return index;
}

void WindowTree::lay_out(const std::vector<float>& keys) {
  const std::size_t leaves = (order_.size() + kLeaf - 1) / kLeaf;
  leaf_keys_.assign(leaves * width_ * kLeaf, 0.0F);
  for (std::size_t at = 0; at < order_.size(); ++at) {
    float* leaf = leaf_keys_.data() + at / kLeaf * width_ * kLeaf;
    for (std::size_t k = 0; k < width_; ++k) leaf[k * kLeaf + at % kLeaf] = keys[order_[at] * width_ + k];
  }
}

float WindowTree::node_bound(const Node& node, const Key& key) const noexcept {
  float total = 0;
  for (std::size_t p = 0; p < kParts; ++p) {
    float sum = 0;
    for (std::size_t d = 0; d < dimensions_; ++d) {
      const std::size_t k = p * dimensions_ + d;
      const float e = std::max({node.low[k] - key[k], key[k] - node.high[k], 0.0F});
      sum += e * e;
    }
    total += part_units_[p] * std::sqrt(sum);
  }
  return total;
}

void WindowTree::leaf_bounds(const Node& node, const Key& key, Bounds& out) const noexcept {
  const float* leaf = leaf_keys_.data() + node.first / kLeaf * width_ * kLeaf;
  add_bounds(key.data(), leaf, dimensions_, part_units_.data(), kParts, out.data());
}

double WindowTree::slack_of(const Key& key) const noexcept {
  float largest = largest_;
  for (std::size_t k = 0; k < width_; ++k) largest = std::max(largest, std::abs(key[k]));
  return 2e-6 * static_cast<double>(length_) * static_cast<double>(largest) * static_cast<double>(dimensions_) + 1e-9;
}

}  // namespace rustle::cloth
