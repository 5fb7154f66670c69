#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <utility>

#include <tl/expected.hpp>

#include "client_sdk/capture/capture_record.h"
#include "client_sdk/capture/mcap_reader.h"

namespace rustle::capture {

/// Reads a capture front to back, in the order in which it was recorded; a cut or damaged one as far as McapReader gets.
/// What other programs added on channels of their own is passed over and counted. One thread at a time.
class CaptureReader {
 public:
  /// Error: a sentence with the file's name: missing, not MCAP, or made by a newer Rustle with another wire.
  static tl::expected<CaptureReader, std::string> open(const std::filesystem::path& path);
  static tl::expected<CaptureReader, std::string> open(std::unique_ptr<InputFile> file);

  /// The next record, or nullopt at the end; then recovery() says how the file ended.
  std::optional<CaptureRecord> next();

  const Recovery& recovery() const { return mcap_.recovery(); }
  /// The file's "rustle" metadata, such as "source"; complete from the first record on.
  std::map<std::string, std::string> notes() const;
  std::uint64_t foreign_messages() const { return foreign_messages_; }
  const std::string& file_name() const { return mcap_.file_name(); }

 private:
  explicit CaptureReader(McapReader mcap) : mcap_(std::move(mcap)) {}
  std::optional<CaptureRecord> take();

  McapReader mcap_;
  std::optional<CaptureRecord> first_;  ///< read ahead by open(), which checks the metadata before it
  std::uint64_t foreign_messages_ = 0;
};

}  // namespace rustle::capture
