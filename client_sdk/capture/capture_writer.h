#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <memory>
#include <string>
#include <utility>

#include <tl/expected.hpp>

#include "client_sdk/capture/capture_record.h"
#include "client_sdk/capture/mcap_writer.h"
#include "client_sdk/capture/storage_file.h"

namespace rustle::capture {

inline constexpr std::uint32_t kWireVersion = 1;

struct CaptureWriterOptions {
  McapWriterOptions mcap;
  /// Goes into the file's "rustle" metadata beside "wire_version": where the capture is from, for people.
  std::map<std::string, std::string> notes;
};

struct CaptureTotals {
  std::string file_name;
  std::uint64_t messages = 0;
  std::uint64_t bytes = 0;
};

/// Writes a capture: an MCAP file with one channel per topic and the protobuf schema embedded, so that the usual
/// robotics tools open it. One session per file. Failures as McapWriter's. One thread at a time.
class CaptureWriter {
 public:
  using Result = tl::expected<void, StorageError>;

  static tl::expected<CaptureWriter, StorageError> create(const std::filesystem::path& path,
                                                          CaptureWriterOptions options = {});
  static tl::expected<CaptureWriter, StorageError> create(std::unique_ptr<OutputFile> file,
                                                          CaptureWriterOptions options = {});

  Result write(const CaptureRecord& record);
  /// Closes a chunk that has been open for 250 ms of the caller's clock although nothing more arrived.
  Result close_chunk_before(std::uint64_t now_ns) { return mcap_.close_chunk_before(now_ns); }
  bool open_chunk_is_empty() const { return mcap_.open_chunk_is_empty(); }
  /// Returns after everything written has reached the disk: the highest sequence number of the stream messages stored.
  tl::expected<std::uint64_t, StorageError> sync();
  /// Finishes the file. After an error the totals count what the file really holds: totals().
  tl::expected<CaptureTotals, StorageError> close();
  CaptureTotals totals() const { return {mcap_.file_name(), mcap_.messages_in_chunks(), mcap_.bytes_written()}; }

 private:
  explicit CaptureWriter(McapWriter mcap) : mcap_(std::move(mcap)) {}
  tl::expected<std::uint16_t, StorageError> channel_for(const CaptureRecord& record);

  McapWriter mcap_;
  std::uint16_t message_schema_ = 0;
  std::uint16_t decision_schema_ = 0;
  std::map<std::pair<std::string, Kind>, std::uint16_t, std::less<>> channels_;
  bool any_sequence_ = false;
  std::uint64_t written_sequence_ = 0;  ///< counted on past 32 bits
};

}  // namespace rustle::capture
