#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include <tl/expected.hpp>

namespace rustle::build {

/// An audio file as it was recorded.
struct Recording {
  std::uint32_t rate_hz = 0;
  int channels = 0;
  std::vector<float> interleaved;  ///< [frames][channels]
  std::size_t frames() const { return interleaved.size() / static_cast<std::size_t>(channels); }
  double duration_s() const { return static_cast<double>(frames()) / rate_hz; }
};

/// Reads WAV, FLAC, OGG, MP3 and what else libsndfile knows: 8 to 768 kHz, up to 64 channels and 2^28 samples. Error: what
/// was found. Control side.
[[nodiscard]] tl::expected<Recording, std::string> read_recording(const std::filesystem::path& file);

/// One channel, counted from 1, or for 0 the mean of all.
/// \pre 0 ≤ channel ≤ recording.channels
std::vector<float> channel_of(const Recording& recording, int channel);

/// Whether a file's name ends as a recording's does: .wav, .flac, .ogg, .oga, .mp3, .aif, .aiff.
bool is_recording(const std::filesystem::path& file);

}  // namespace rustle::build
