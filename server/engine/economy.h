#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <string_view>

#include "server/analysis/effort.h"

namespace rustle::engine {

/// What a session does without while the daemon has more to do than it can.
struct Economy {
  analysis::Effort effort;
  int joined_slots = 1;  ///< slots of 2 ms over which dense bursts are merged as one (P9)
  int most_voices = std::numeric_limits<int>::max();
};

/// By load level: 0 is full quality, each level does without what those before it do and more.
///   1  dense bursts are merged over 8 ms; the partition of a sheet that bends on serves for 0.1 s
///   2  16 voices at a time, the quietest go
///   3  8 voices; the greatest of a sheet's flips in a frame sounds for all
///   4  as 3; new sessions are refused
inline constexpr std::uint32_t kMostLoadLevel = 4;

/// \pre level ≤ kMostLoadLevel
constexpr Economy economy_at(std::uint32_t level) {
  Economy out;
  if (level >= 1) {
    out.joined_slots = 4;
    out.effort.partition_serves_s = 0.1;
  }
  if (level >= 2) out.most_voices = 16;
  if (level >= 3) {
    out.most_voices = 8;
    out.effort.most_events = 1;
  }
  return out;
}

/// For people.
constexpr std::string_view meaning_of(std::uint32_t level) {
  constexpr std::array<std::string_view, kMostLoadLevel + 1> kMeanings = {
      "full quality", "dense bursts are merged", "fewer voices", "fewer events in a frame", "new sessions are refused"};
  return kMeanings[level];
}

}  // namespace rustle::engine
