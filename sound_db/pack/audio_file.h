#pragma once

#include <cstdint>
#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include <tl/expected.hpp>

/// Mono clips in WAV or FLAC files.
namespace rustle::pack {

struct Clip {
  std::uint32_t rate_hz = 0;
  std::vector<float> samples;
};

inline constexpr double kLongestUnit_s = 10.0;

/// Reads a whole clip of at most kLongestUnit_s. A cut file, several channels, another format, or a sample that is not
/// finite is an error that says what was found.
[[nodiscard]] tl::expected<Clip, std::string> read_clip(const std::filesystem::path& file);

/// Writes a clip: `.flac` as 16 bit (samples within ±1), any other extension as WAV with 32-bit floats. The same clip gives
/// the same bytes.
[[nodiscard]] tl::expected<void, std::string> write_clip(const std::filesystem::path& file, std::span<const float> samples,
                                                         std::uint32_t rate_hz);

}  // namespace rustle::pack
