#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

namespace rustle::cloth {

/// One recording of units after another, as feature vectors: row j is the unit j's. Looks at memory of somebody else's.
struct FeatureRows {
  std::span<const float> values;               ///< [units x dimensions]
  std::size_t dimensions = 3;                  ///< 3, or 6 where each ear has its own
  std::span<const std::uint32_t> starts = {};  ///< first unit of each recording, rising, the first 0; empty: one recording

  std::size_t count() const noexcept { return values.size() / dimensions; }
  const float* row(std::size_t unit) const noexcept { return values.data() + unit * dimensions; }
};

}  // namespace rustle::cloth
