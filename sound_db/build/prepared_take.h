#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include <tl/expected.hpp>

#include "sound_db/build/build_manifest.h"
#include "sound_db/build/segment.h"

namespace rustle::build {

/// The part of a file that a take means, made ready: one channel, at the pack's rate, without offset and rumble, with the
/// take's gain.
struct PreparedTake {
  std::vector<float> samples;
  double rate_hz = 48000;
  double from_s = 0;             ///< of the first sample in the file
  std::vector<Segment> clipped;  ///< where the file is at full scale or flat at its peak
  std::uint32_t recorded_rate_hz = 0;
  int channels = 0;
  double duration_s = 0;  ///< of the file
};

/// Error: the file cannot be read, lacks the channel, or ends before the take begins. Control side.
[[nodiscard]] tl::expected<PreparedTake, std::string> prepare(const std::filesystem::path& file, const Take& take,
                                                              double rate_hz, double highpass_hz);

/// Whether any of the samples [begin, end) are clipped.
bool is_clipped(const PreparedTake& take, std::size_t begin, std::size_t end);

}  // namespace rustle::build
