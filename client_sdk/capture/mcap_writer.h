#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include <tl/expected.hpp>

#include "client_sdk/capture/chunk_compression.h"
#include "client_sdk/capture/mcap_format.h"
#include "client_sdk/capture/storage_file.h"

namespace rustle::capture {

struct McapWriterOptions {
  Compression compression = Compression::kZstd;
  int zstd_level = 1;
  std::uint64_t chunk_span_ns = 250'000'000;           ///< a chunk never spans as much log time as this
  std::uint64_t chunk_bytes = std::uint64_t{1} << 20;  ///< a chunk is closed once its records reach this
  std::string library = "rustle";
};

/// Writes one MCAP file (https://mcap.dev/spec): schemas, channels and metadata straight into the data section, so that a
/// damaged chunk takes none of them along; messages in chunks with their indexes, their channels once more before them, so
/// that the chunk's checksum covers which topic a message is of; a summary with everything an indexed reader asks for. The
/// same calls give the same bytes.
///
/// It has no clock: log times are the caller's. After the first failed write every call but close() gives the same error
/// and touches nothing; close() then cuts the file after the last whole chunk and tries to finish it there, so that
/// even a full disk leaves a readable file.
///
/// Errors are returned, never thrown. One thread at a time; writing and compressing happen inside the calls.
class McapWriter {
 public:
  using Result = tl::expected<void, StorageError>;

  /// Magic and header are written here; what fails is kept and given by the next call.
  McapWriter(std::unique_ptr<OutputFile> file, McapWriterOptions options);
  McapWriter(McapWriter&&) noexcept = default;
  McapWriter& operator=(McapWriter&&) noexcept = default;

  /// Ids count from 1 and are good for this file; at most 65,535 of each.
  tl::expected<std::uint16_t, StorageError> add_schema(std::string name, std::string encoding, std::string data);
  tl::expected<std::uint16_t, StorageError> add_channel(std::uint16_t schema_id, std::string topic,
                                                        std::string message_encoding);
  Result add_metadata(McapMetadata metadata);

  /// The message is stored once its chunk is: when a later message, close_chunk_before(), sync() or close() closes it.
  /// \pre the channel was added; message.data is shorter than 200 MiB, else an error that concerns this message only
  Result write(const McapMessage& message);

  /// Closes the open chunk when its first message is `chunk_span_ns` older than `now_ns`: for streams that pause.
  Result close_chunk_before(std::uint64_t now_ns);
  Result close_chunk();
  /// Closes the open chunk and returns after everything written so far has reached the disk.
  Result sync();
  /// Writes the summary and closes the file. The first call counts; later ones do nothing.
  Result close();

  std::uint64_t bytes_written() const { return committed_bytes_; }  ///< without the open chunk; the file's size once closed
  std::uint64_t messages_in_chunks() const { return statistics_.message_count; }  ///< without the open chunk
  bool open_chunk_is_empty() const { return chunk_.empty(); }
  const std::string& file_name() const { return file_->name(); }

 private:
  Result append(std::string_view bytes);
  Result fail(StorageError error);
  Result finish();
  std::string summary() const;
  StorageError limit_error(std::string message, std::string remedy) const;

  std::unique_ptr<OutputFile> file_;
  McapWriterOptions options_;
  bool failed_ = false;
  bool closed_ = false;
  StorageError error_;

  std::uint64_t committed_bytes_ = 0;  ///< of whole records, as in the file
  std::uint32_t data_crc_ = 0;         ///< of those

  std::string chunk_;  ///< records of the open chunk
  std::uint64_t chunk_start_ns_ = 0;
  std::uint64_t chunk_end_ns_ = 0;
  std::map<std::uint16_t, McapMessageIndex> chunk_index_;

  std::vector<McapSchema> schemas_;
  std::vector<McapChannel> channels_;
  std::vector<McapChunkIndex> chunk_indexes_;
  std::vector<McapMetadataIndex> metadata_indexes_;
  McapStatistics statistics_;
};

}  // namespace rustle::capture
