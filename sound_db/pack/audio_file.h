#pragma once

#include <cstdint>
#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include <tl/expected.hpp>

/// Clips in WAV or FLAC files: mono units, and recordings of several channels.
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

/// A long clip of up to kMostChannels channels.
struct MultichannelClip {
  std::uint32_t rate_hz = 0;
  std::vector<std::vector<float>> channels;  ///< [channels][samples]
};
inline constexpr int kMostChannels = 8;
inline constexpr double kLongestRecording_s = 3600.0;

/// Reads a whole recording of at most kLongestRecording_s; errors as read_clip's.
[[nodiscard]] tl::expected<MultichannelClip, std::string> read_multichannel(const std::filesystem::path& file);

/// Writes a recording as write_clip does, but FLAC with 24 bits: quiet units keep their features. \pre channels are not
/// empty and equally long
[[nodiscard]] tl::expected<void, std::string> write_multichannel(const std::filesystem::path& file,
                                                                 std::span<const std::vector<float>> channels,
                                                                 std::uint32_t rate_hz);

}  // namespace rustle::pack
