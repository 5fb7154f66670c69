#pragma once

#include <bit>
#include <cstdint>
#include <cstring>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>
#include <vector>

namespace rustle::capture {

/// The records of an MCAP file (https://mcap.dev/spec), each encoded and parsed on its own.
/// Offsets and lengths are in bytes, times in nanoseconds, everything little-endian.

inline constexpr std::string_view kMcapMagic{"\x89MCAP0\r\n", 8};
inline constexpr std::size_t kMcapRecordPrefix = 9;  ///< opcode and length
inline constexpr std::size_t kMcapFooterContent = 20;

enum class McapOpcode : std::uint8_t {
  kHeader = 0x01,
  kFooter = 0x02,
  kSchema = 0x03,
  kChannel = 0x04,
  kMessage = 0x05,
  kChunk = 0x06,
  kMessageIndex = 0x07,
  kChunkIndex = 0x08,
  kAttachment = 0x09,
  kAttachmentIndex = 0x0a,
  kStatistics = 0x0b,
  kMetadata = 0x0c,
  kMetadataIndex = 0x0d,
  kSummaryOffset = 0x0e,
  kDataEnd = 0x0f,
};

struct McapHeader {
  std::string profile;
  std::string library;
};

struct McapSchema {
  std::uint16_t id = 0;
  std::string name;
  std::string encoding;
  std::string data;
  friend bool operator==(const McapSchema&, const McapSchema&) = default;
};

struct McapChannel {
  std::uint16_t id = 0;
  std::uint16_t schema_id = 0;
  std::string topic;
  std::string message_encoding;
  std::map<std::string, std::string> metadata;
  friend bool operator==(const McapChannel&, const McapChannel&) = default;
};

struct McapMessage {
  std::uint16_t channel_id = 0;
  std::uint32_t sequence = 0;
  std::uint64_t log_time_ns = 0;
  std::uint64_t publish_time_ns = 0;
  std::string_view data;
};

struct McapChunk {
  std::uint64_t start_time_ns = 0;
  std::uint64_t end_time_ns = 0;
  std::uint64_t uncompressed_size = 0;
  std::uint32_t uncompressed_crc = 0;  ///< 0: not checked
  std::string_view compression;        ///< "zstd", "lz4" or ""
  std::string_view records;            ///< as compressed
};

struct McapMetadata {
  std::string name;
  std::map<std::string, std::string> entries;
};

struct McapChunkIndex {
  std::uint64_t start_time_ns = 0;
  std::uint64_t end_time_ns = 0;
  std::uint64_t chunk_start = 0;
  std::uint64_t chunk_length = 0;
  std::map<std::uint16_t, std::uint64_t> message_index_offsets;
  std::uint64_t message_index_length = 0;
  std::string compression;
  std::uint64_t compressed_size = 0;
  std::uint64_t uncompressed_size = 0;
};

struct McapMetadataIndex {
  std::uint64_t offset = 0;
  std::uint64_t length = 0;
  std::string name;
};

struct McapStatistics {
  std::uint64_t message_count = 0;
  std::uint16_t schema_count = 0;
  std::uint32_t channel_count = 0;
  std::uint32_t attachment_count = 0;
  std::uint32_t metadata_count = 0;
  std::uint32_t chunk_count = 0;
  std::uint64_t start_time_ns = 0;
  std::uint64_t end_time_ns = 0;
  std::map<std::uint16_t, std::uint64_t> channel_message_counts;
};

struct McapFooter {
  std::uint64_t summary_start = 0;
  std::uint64_t summary_offset_start = 0;
  std::uint32_t summary_crc = 0;
};

/// log time and offset in the uncompressed chunk of each message of one channel
using McapMessageIndex = std::vector<std::pair<std::uint64_t, std::uint64_t>>;

void append_header(std::string& out, const McapHeader& header);
void append_schema(std::string& out, const McapSchema& schema);
void append_channel(std::string& out, const McapChannel& channel);
void append_message(std::string& out, const McapMessage& message);
void append_chunk(std::string& out, const McapChunk& chunk);
void append_message_index(std::string& out, std::uint16_t channel_id, const McapMessageIndex& index);
void append_chunk_index(std::string& out, const McapChunkIndex& index);
void append_metadata(std::string& out, const McapMetadata& metadata);
void append_metadata_index(std::string& out, const McapMetadataIndex& index);
void append_statistics(std::string& out, const McapStatistics& statistics);
void append_summary_offset(std::string& out, McapOpcode group, std::uint64_t start, std::uint64_t length);
void append_data_end(std::string& out, std::uint32_t data_section_crc);
/// Its CRC covers `out` from `crc_start` on, and the footer's own fields before the CRC.
void append_footer(std::string& out, std::size_t crc_start, McapFooter footer);

/// Each takes a record's content; nullopt when it ends within a field. Fields appended by later versions are ignored.
std::optional<McapHeader> parse_header(std::string_view content);
std::optional<McapSchema> parse_schema(std::string_view content);
std::optional<McapChannel> parse_channel(std::string_view content);
std::optional<McapMessage> parse_message(std::string_view content);
std::optional<McapChunk> parse_chunk(std::string_view content);
std::optional<McapMetadata> parse_metadata(std::string_view content);
std::optional<McapFooter> parse_footer(std::string_view content);

/// CRC-32 (IEEE 802.3, as zlib computes it), continued from `crc`; 0 to begin.
std::uint32_t crc32_of(std::string_view bytes, std::uint32_t crc = 0);

static_assert(std::endian::native == std::endian::little);

template <typename Value>
void append_value(std::string& out, Value value) {
  static_assert(std::is_arithmetic_v<Value>);
  char bytes[sizeof value];
  std::memcpy(bytes, &value, sizeof value);
  out.append(bytes, sizeof value);
}

/// Takes values off the front of `rest`; once something is missing, failed() holds and every value is zero.
class FieldReader {
 public:
  explicit FieldReader(std::string_view content) : rest_(content) {}

  template <typename Value>
  Value value() {
    static_assert(std::is_arithmetic_v<Value>);
    Value value{};
    const std::string_view taken = bytes(sizeof(Value));
    if (!failed_) std::memcpy(&value, taken.data(), sizeof value);
    return value;
  }

  std::string_view bytes(std::uint64_t count) {
    if (failed_ || count > rest_.size()) {
      failed_ = true;
      return {};
    }
    const std::string_view taken = rest_.substr(0, count);
    rest_.remove_prefix(count);
    return taken;
  }

  std::string_view string() { return bytes(value<std::uint32_t>()); }
  std::string_view rest() const { return rest_; }
  bool failed() const { return failed_; }

 private:
  std::string_view rest_;
  bool failed_ = false;
};

}  // namespace rustle::capture
