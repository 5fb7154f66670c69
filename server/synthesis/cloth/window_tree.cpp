#include "server/synthesis/cloth/window_tree.h"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <cstring>
#include <limits>
#include <numeric>
#include <utility>

#include "server/sheet/simd.h"
#include "sound_db/dsp/random.h"

namespace rustle::cloth {
namespace {

constexpr std::size_t kLanes = 16;
using Lanes = float __attribute__((vector_size(kLanes * sizeof(float))));

/// bounds[k] = Σ_p n_p |key_p - the nearest to it between low and high of lane k|, lanes side by side: [width][kLanes].
/// \param work  [parts][kLanes]
RUSTLE_SIMD void add_bounds(const float* key, const float* low, const float* high, std::size_t dimensions,
                            const float* part_units, std::size_t parts, float* work, float* bounds) noexcept {
  for (std::size_t p = 0; p < parts; ++p) {
    Lanes sum{};
    for (std::size_t d = p * dimensions; d < (p + 1) * dimensions; ++d) {
      Lanes a, b;
      std::memcpy(&a, low + d * kLanes, sizeof a);
      std::memcpy(&b, high + d * kLanes, sizeof b);
      const Lanes below = a - key[d], above = key[d] - b;
      const Lanes farther = below > above ? below : above;
      const Lanes outside = farther > Lanes{} ? farther : Lanes{};
      sum += outside * outside;
    }
    std::memcpy(work + p * kLanes, &sum, sizeof sum);
  }
  for (std::size_t k = 0; k < parts * kLanes; ++k) work[k] = std::sqrt(work[k]);
  Lanes total{};
  for (std::size_t p = 0; p < parts; ++p) {
    Lanes root;
    std::memcpy(&root, work + p * kLanes, sizeof root);
    total += part_units[p] * root;
  }
  std::memcpy(bounds, &total, sizeof total);
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
  sort(order_, keys);
  add_leaves(keys);
  while (levels_.back().nodes > 1) add_nodes();
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

void WindowTree::sort(std::span<std::uint32_t> classes, const std::vector<float>& keys) const {
  if (classes.size() <= kFan) return;
  std::size_t widest = 0;
  float extent = -1;
  for (std::size_t k = 0; k < width_; ++k) {
    float low = std::numeric_limits<float>::infinity(), high = -low;
    for (const std::uint32_t c : classes) {
      low = std::min(low, keys[c * width_ + k]);
      high = std::max(high, keys[c * width_ + k]);
    }
    if (high - low > extent) {
      extent = high - low;
      widest = k;
    }
  }
  std::size_t node = kFan;
  while (node * kFan < classes.size()) node *= kFan;
  const std::size_t half = (classes.size() / 2 + node - 1) / node * node;
  std::ranges::nth_element(classes, classes.begin() + static_cast<std::ptrdiff_t>(half), {},
                           [&](std::uint32_t c) { return std::pair(keys[c * width_ + widest], c); });
  sort(classes.first(half), keys);
  sort(classes.subspan(half), keys);
}

void WindowTree::add_leaves(const std::vector<float>& keys) {
  Level& level = levels_.emplace_back();
  level.nodes = static_cast<std::uint32_t>((order_.size() + kFan - 1) / kFan);
  level.low.resize(level.nodes * width_ * kFan);
  for (std::size_t at = 0; at < order_.size(); ++at) {
    float* leaf = level.low.data() + at / kFan * width_ * kFan;
    for (std::size_t k = 0; k < width_; ++k) leaf[k * kFan + at % kFan] = keys[order_[at] * width_ + k];
  }
}

void WindowTree::add_nodes() {
  const std::size_t below = levels_.size() - 1;
  Level level;
  level.nodes = static_cast<std::uint32_t>((levels_[below].nodes + kFan - 1) / kFan);
  level.low.resize(level.nodes * width_ * kFan);
  level.high.resize(level.low.size());
  for (std::uint32_t child = 0; child < levels_[below].nodes; ++child) {
    const std::size_t count = children(below, child);
    for (std::size_t k = 0; k < width_; ++k) {
      const std::size_t from = (child * width_ + k) * kFan, to = (child / kFan * width_ + k) * kFan + child % kFan;
      const auto part = [&](const std::vector<float>& of) { return std::span(of).subspan(from, count); };
      level.low[to] = std::ranges::min(part(levels_[below].low));
      level.high[to] = std::ranges::max(part(below == 0 ? levels_[below].low : levels_[below].high));
    }
  }
  levels_.push_back(std::move(level));
}

std::uint32_t WindowTree::children(std::size_t level, std::uint32_t node) const noexcept {
  const std::size_t below = level == 0 ? order_.size() : levels_[level - 1].nodes;
  return static_cast<std::uint32_t>(std::min(kFan, below - kFan * node));
}

void WindowTree::bounds_of(std::size_t level, std::uint32_t node, const Key& key, Bounds& out) const noexcept {
  static_assert(kFan == kLanes);
  const std::size_t from = node * width_ * kFan;
  const float* low = levels_[level].low.data() + from;
  const float* high = level == 0 ? low : levels_[level].high.data() + from;
  std::array<float, kParts * kFan> work;
  add_bounds(key.data(), low, high, dimensions_, part_units_.data(), kParts, work.data(), out.data());
}

double WindowTree::slack_of(const Key& key) const noexcept {
  float largest = largest_;
  for (std::size_t k = 0; k < width_; ++k) largest = std::max(largest, std::abs(key[k]));
  return 2e-6 * static_cast<double>(length_) * static_cast<double>(largest) * static_cast<double>(dimensions_) + 1e-9;
}

}  // namespace rustle::cloth
