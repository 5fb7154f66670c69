#pragma once

#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <map>
#include <memory>
#include <span>
#include <string>
#include <string_view>

#include <tl/expected.hpp>

#include "server/sheet/vector.h"
#include "server/sinks/wav.h"

namespace rustle::apps {

/// Dry sounds of emitters in a folder: a mono WAV file each, from its first sample on, and emitters.jsonl with a line when
/// one begins, when it has moved, and after its last sample:
///   {"file", "emitter", "sheet", "kind", "sample", "position_m", "normal", "last"}
class EmitterFiles {
 public:
  struct Stretch {
    std::uint64_t emitter = 0;
    std::uint32_t sheet = 0;
    std::string_view kind;
    std::int64_t first_sample = 0;
    sheet::Vec3d position_m = sheet::Vec3d::Zero(), normal = sheet::Vec3d::UnitZ();
    bool last = false;
    std::uint64_t missing = 0;  ///< samples lost before these: silent in the file
    std::span<const float> samples;
  };

  /// Makes the folder. Error: a sentence that names what cannot be made.
  static tl::expected<EmitterFiles, std::string> create(const std::filesystem::path& folder, int rate_hz,
                                                        sinks::WavFormat format);

  tl::expected<void, std::string> add(const Stretch& stretch);
  /// Ends those that have not ended, and completes everything.
  tl::expected<void, std::string> close();
  std::uint64_t count() const { return count_; }

 private:
  struct CloseFile {
    void operator()(std::FILE* file) const { std::fclose(file); }
  };
  struct Open {
    std::string name;
    sinks::WavWriter wav;
    Stretch newest{};  ///< without samples
    std::int64_t next_sample = 0;
  };

  EmitterFiles(std::filesystem::path folder, std::FILE* lines, int rate_hz, sinks::WavFormat format)
      : folder_(std::move(folder)), lines_(lines), rate_hz_(rate_hz), format_(format) {}

  /// How a file's emitter is from `sample` on.
  tl::expected<void, std::string> write_line(const std::string& name, const Stretch& stretch, std::int64_t sample,
                                             bool last);

  std::filesystem::path folder_;
  std::unique_ptr<std::FILE, CloseFile> lines_;
  int rate_hz_;
  sinks::WavFormat format_;
  std::map<std::uint64_t, Open> open_;
  std::uint64_t count_ = 0;
};

}  // namespace rustle::apps
