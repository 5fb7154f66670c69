#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include <tl/expected.hpp>

namespace rustle::sinks {

enum class WavFormat { kFloat32, kInt16, kInt24 };

/// A WAV file being written; RF64 once it outgrows 4 GB. The same samples always give the same bytes.
class WavWriter {
 public:
  /// Error: a sentence with the file name and what to do.
  [[nodiscard]] static tl::expected<WavWriter, std::string> create(const std::filesystem::path& file, int rate_hz,
                                                                   int channels, WavFormat format);
  /// Appends interleaved samples within ±1; integers are rounded and clamped. \pre size is a multiple of the channels
  [[nodiscard]] tl::expected<void, std::string> write(std::span<const float> interleaved);
  /// Completes the header. Called by the destructor too, which cannot report.
  [[nodiscard]] tl::expected<void, std::string> close();

  WavWriter(WavWriter&&) noexcept;
  WavWriter& operator=(WavWriter&&) noexcept;
  ~WavWriter();

 private:
  struct File;
  explicit WavWriter(std::unique_ptr<File> opened);
  std::unique_ptr<File> file_;
};

/// A whole sound file, channels interleaved.
struct SoundFile {
  int rate_hz = 0;
  int channels = 0;
  std::vector<float> interleaved;
};

/// Reads any file that libsndfile knows. Error: a sentence with the file name and what to do.
[[nodiscard]] tl::expected<SoundFile, std::string> read_sound_file(const std::filesystem::path& file);

}  // namespace rustle::sinks
