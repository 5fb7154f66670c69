#pragma once

#include <cstdint>
#include <string>
#include <string_view>

/// How the programs say figures.
namespace rustle::apps {

/// "1 frame", "2 frames", "0 topologies".
std::string counted(std::uint64_t count, std::string_view noun);

/// What did not sound, or not as it was meant to. Of wire::Statistics, client::Statistics and whatever else names its
/// members so.
struct Losses {
  std::uint64_t voices_stolen = 0;
  std::uint64_t voices_dropped = 0;
  std::uint64_t sources_dropped = 0;
  std::uint64_t cues_dropped = 0;
  std::uint64_t sounds_missing = 0;
  std::uint64_t planes_left_out = 0;
  std::uint64_t samples_not_finite = 0;
};

template <typename Figures>
Losses losses_of(const Figures& figures) {
  return {figures.voices_stolen,  figures.voices_dropped,  figures.sources_dropped,   figures.cues_dropped,
          figures.sounds_missing, figures.planes_left_out, figures.samples_not_finite};
}

/// "nothing lost", or "lost: 3 voices stolen, 1 cue dropped".
std::string to_string(const Losses& losses);

}  // namespace rustle::apps
