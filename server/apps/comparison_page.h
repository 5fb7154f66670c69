#pragma once

#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "server/comparison/event_matching.h"
#include "server/comparison/sound_difference.h"

namespace rustle::apps {

struct ComparedSounds {
  comparison::SoundDifference difference;
};

struct ComparedEvents {
  std::vector<comparison::ListedEvent> reference, other;
  std::vector<comparison::MatchedPair> pairs;
  std::vector<std::pair<std::string, comparison::EventScore>> scores;  ///< "all", then kind by kind
};

/// What `rustle compare` found, under the names that its files were given.
struct Comparison {
  std::string reference, other;
  double tolerance_ms = 0;
  ComparedSounds sounds;
  std::optional<ComparedEvents> events;
};

/// One HTML page that needs nothing else. Pure.
[[nodiscard]] std::string comparison_page(const Comparison& compared);

}  // namespace rustle::apps
