#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <string_view>

#include <tl/expected.hpp>

#include "client_sdk/capture/mcap_format.h"
#include "client_sdk/capture/storage_file.h"

namespace rustle::capture {

/// What a reader found of a file.
struct Recovery {
  bool complete = true;          ///< the file ends as its writer meant it to, and every checksum holds
  std::string what;              ///< when not complete: where it ends or is damaged, and what that cost
  std::uint64_t bytes_read = 0;  ///< up to the end of the last whole record
};

/// Reads any MCAP file (https://mcap.dev/spec) from front to back: chunked or not, zstd, lz4 or plain, with or without a
/// summary. Messages come in the file's order. Every length is bounded before memory is taken for it, chunk and file
/// checksums are compared. At the first damage, or where the file was cut, reading ends: everything before it was given,
/// messages of a chunk only when the whole chunk is sound. After the first chunk a message outside of one is damage: no
/// checksum covers it, and one flipped bit makes it of a chunk's index.
/// One thread at a time.
class McapReader {
 public:
  struct Message {
    const McapChannel* channel;  ///< good as long as the reader
    const McapSchema* schema;    ///< nullptr: the channel has none
    McapMessage message;         ///< its data is good until the next call of next()
  };

  /// Reads magic and header. Error: a sentence with the file's name when this is no MCAP file or cut within its header.
  static tl::expected<McapReader, std::string> open(std::unique_ptr<InputFile> file);

  /// The next message, or nullopt at the end; then recovery() says how the file ended.
  std::optional<Message> next();

  const Recovery& recovery() const { return recovery_; }
  const McapHeader& header() const { return header_; }
  /// By id, as far as read.
  const std::map<std::uint16_t, McapSchema>& schemas() const { return schemas_; }
  const std::map<std::uint16_t, McapChannel>& channels() const { return channels_; }
  /// By name, as far as read; of several with one name the first.
  const std::map<std::string, McapMetadata>& metadata() const { return metadata_; }
  const std::string& file_name() const { return file_->name(); }

 private:
  explicit McapReader(std::unique_ptr<InputFile> file) : file_(std::move(file)) {}

  enum class Got { kAll, kCut, kFailed };
  Got take(std::string& out, std::uint64_t count);
  Got skip(std::uint64_t count);
  bool read_record();
  bool open_chunk();
  std::optional<Message> declare_or_message(McapOpcode opcode, std::string_view content);
  void read_summary();
  void stop(std::string what);
  void stop_cut(std::string_view where);

  std::unique_ptr<InputFile> file_;
  McapHeader header_;
  Recovery recovery_;
  bool ended_ = false;
  std::uint64_t messages_ = 0;

  std::uint64_t position_ = 0;  ///< bytes taken from the file
  std::uint32_t crc_ = 0;       ///< of the section being read
  std::string read_error_;

  McapOpcode opcode_{};
  std::string prefix_;
  std::string content_;
  bool chunked_ = false;  ///< a chunk has come
  std::string chunk_;
  std::size_t chunk_position_ = 0;

  std::map<std::uint16_t, McapSchema> schemas_;
  std::map<std::uint16_t, McapChannel> channels_;
  std::map<std::string, McapMetadata> metadata_;
};

}  // namespace rustle::capture
