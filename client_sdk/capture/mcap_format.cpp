#include "client_sdk/capture/mcap_format.h"

#include <zlib.h>

#include <algorithm>
#include <cassert>
#include <limits>

namespace rustle::capture {
namespace {

void append_string(std::string& out, std::string_view text) {
  assert(text.size() <= std::numeric_limits<std::uint32_t>::max());
  append_value(out, static_cast<std::uint32_t>(text.size()));
  out.append(text);
}

/// A length field whose value is known only when what it measures has been appended.
template <typename Length>
class LengthPrefix {
 public:
  explicit LengthPrefix(std::string& out) : out_(out) {
    append_value(out_, Length{0});
    start_ = out_.size();
  }
  ~LengthPrefix() {
    const std::size_t length = out_.size() - start_;
    assert(length <= std::numeric_limits<Length>::max());
    const Length stored = static_cast<Length>(length);
    std::memcpy(out_.data() + start_ - sizeof stored, &stored, sizeof stored);
  }
  LengthPrefix(const LengthPrefix&) = delete;
  LengthPrefix& operator=(const LengthPrefix&) = delete;

 private:
  std::string& out_;
  std::size_t start_;
};

class Record {
 public:
  Record(std::string& out, McapOpcode opcode) : length_((append_value(out, static_cast<std::uint8_t>(opcode)), out)) {}

 private:
  LengthPrefix<std::uint64_t> length_;
};

void append_map(std::string& out, const std::map<std::string, std::string>& entries) {
  const LengthPrefix<std::uint32_t> length(out);
  for (const auto& [key, value] : entries) {
    append_string(out, key);
    append_string(out, value);
  }
}

void append_map(std::string& out, const std::map<std::uint16_t, std::uint64_t>& entries) {
  const LengthPrefix<std::uint32_t> length(out);
  for (const auto& [key, value] : entries) {
    append_value(out, key);
    append_value(out, value);
  }
}

std::map<std::string, std::string> take_map(FieldReader& fields) {
  std::map<std::string, std::string> entries;
  FieldReader inner(fields.string());
  while (!inner.failed() && !inner.rest().empty()) {
    const std::string_view key = inner.string();
    const std::string_view value = inner.string();
    if (!inner.failed()) entries.emplace(key, value);
  }
  return entries;
}

template <typename Parsed>
std::optional<Parsed> unless_failed(const FieldReader& fields, Parsed parsed) {
  if (fields.failed()) return std::nullopt;
  return parsed;
}

}  // namespace

std::uint32_t crc32_of(std::string_view bytes, std::uint32_t crc) {
  constexpr std::size_t kStep = 1u << 30;
  uLong state = crc;
  while (!bytes.empty()) {
    const std::size_t count = std::min(bytes.size(), kStep);
    state = ::crc32(state, reinterpret_cast<const Bytef*>(bytes.data()), static_cast<uInt>(count));
    bytes.remove_prefix(count);
  }
  return static_cast<std::uint32_t>(state);
}

void append_header(std::string& out, const McapHeader& header) {
  const Record record(out, McapOpcode::kHeader);
  append_string(out, header.profile);
  append_string(out, header.library);
}

void append_schema(std::string& out, const McapSchema& schema) {
  const Record record(out, McapOpcode::kSchema);
  append_value(out, schema.id);
  append_string(out, schema.name);
  append_string(out, schema.encoding);
  append_string(out, schema.data);
}

void append_channel(std::string& out, const McapChannel& channel) {
  const Record record(out, McapOpcode::kChannel);
  append_value(out, channel.id);
  append_value(out, channel.schema_id);
  append_string(out, channel.topic);
  append_string(out, channel.message_encoding);
  append_map(out, channel.metadata);
}

void append_message(std::string& out, const McapMessage& message) {
  const Record record(out, McapOpcode::kMessage);
  append_value(out, message.channel_id);
  append_value(out, message.sequence);
  append_value(out, message.log_time_ns);
  append_value(out, message.publish_time_ns);
  out.append(message.data);
}

void append_chunk(std::string& out, const McapChunk& chunk) {
  const Record record(out, McapOpcode::kChunk);
  append_value(out, chunk.start_time_ns);
  append_value(out, chunk.end_time_ns);
  append_value(out, chunk.uncompressed_size);
  append_value(out, chunk.uncompressed_crc);
  append_string(out, chunk.compression);
  append_value(out, static_cast<std::uint64_t>(chunk.records.size()));
  out.append(chunk.records);
}

void append_message_index(std::string& out, std::uint16_t channel_id, const McapMessageIndex& index) {
  const Record record(out, McapOpcode::kMessageIndex);
  append_value(out, channel_id);
  const LengthPrefix<std::uint32_t> length(out);
  for (const auto& [log_time_ns, offset] : index) {
    append_value(out, log_time_ns);
    append_value(out, offset);
  }
}

void append_chunk_index(std::string& out, const McapChunkIndex& index) {
  const Record record(out, McapOpcode::kChunkIndex);
  append_value(out, index.start_time_ns);
  append_value(out, index.end_time_ns);
  append_value(out, index.chunk_start);
  append_value(out, index.chunk_length);
  append_map(out, index.message_index_offsets);
  append_value(out, index.message_index_length);
  append_string(out, index.compression);
  append_value(out, index.compressed_size);
  append_value(out, index.uncompressed_size);
}

void append_metadata(std::string& out, const McapMetadata& metadata) {
  const Record record(out, McapOpcode::kMetadata);
  append_string(out, metadata.name);
  append_map(out, metadata.entries);
}

void append_metadata_index(std::string& out, const McapMetadataIndex& index) {
  const Record record(out, McapOpcode::kMetadataIndex);
  append_value(out, index.offset);
  append_value(out, index.length);
  append_string(out, index.name);
}

void append_statistics(std::string& out, const McapStatistics& statistics) {
  const Record record(out, McapOpcode::kStatistics);
  append_value(out, statistics.message_count);
  append_value(out, statistics.schema_count);
  append_value(out, statistics.channel_count);
  append_value(out, statistics.attachment_count);
  append_value(out, statistics.metadata_count);
  append_value(out, statistics.chunk_count);
  append_value(out, statistics.start_time_ns);
  append_value(out, statistics.end_time_ns);
  append_map(out, statistics.channel_message_counts);
}

void append_summary_offset(std::string& out, McapOpcode group, std::uint64_t start, std::uint64_t length) {
  const Record record(out, McapOpcode::kSummaryOffset);
  append_value(out, static_cast<std::uint8_t>(group));
  append_value(out, start);
  append_value(out, length);
}

void append_data_end(std::string& out, std::uint32_t data_section_crc) {
  const Record record(out, McapOpcode::kDataEnd);
  append_value(out, data_section_crc);
}

void append_footer(std::string& out, std::size_t crc_start, McapFooter footer) {
  // The CRC covers the footer's length too, so it is written out here before the content is complete.
  append_value(out, static_cast<std::uint8_t>(McapOpcode::kFooter));
  append_value(out, static_cast<std::uint64_t>(kMcapFooterContent));
  append_value(out, footer.summary_start);
  append_value(out, footer.summary_offset_start);
  append_value(out, crc32_of(std::string_view(out).substr(crc_start)));
}

std::optional<McapHeader> parse_header(std::string_view content) {
  FieldReader fields(content);
  McapHeader header;
  header.profile = fields.string();
  header.library = fields.string();
  return unless_failed(fields, std::move(header));
}

std::optional<McapSchema> parse_schema(std::string_view content) {
  FieldReader fields(content);
  McapSchema schema;
  schema.id = fields.value<std::uint16_t>();
  schema.name = fields.string();
  schema.encoding = fields.string();
  schema.data = fields.string();
  return unless_failed(fields, std::move(schema));
}

std::optional<McapChannel> parse_channel(std::string_view content) {
  FieldReader fields(content);
  McapChannel channel;
  channel.id = fields.value<std::uint16_t>();
  channel.schema_id = fields.value<std::uint16_t>();
  channel.topic = fields.string();
  channel.message_encoding = fields.string();
  channel.metadata = take_map(fields);
  return unless_failed(fields, std::move(channel));
}

std::optional<McapMessage> parse_message(std::string_view content) {
  FieldReader fields(content);
  McapMessage message;
  message.channel_id = fields.value<std::uint16_t>();
  message.sequence = fields.value<std::uint32_t>();
  message.log_time_ns = fields.value<std::uint64_t>();
  message.publish_time_ns = fields.value<std::uint64_t>();
  message.data = fields.rest();
  return unless_failed(fields, message);
}

std::optional<McapChunk> parse_chunk(std::string_view content) {
  FieldReader fields(content);
  McapChunk chunk;
  chunk.start_time_ns = fields.value<std::uint64_t>();
  chunk.end_time_ns = fields.value<std::uint64_t>();
  chunk.uncompressed_size = fields.value<std::uint64_t>();
  chunk.uncompressed_crc = fields.value<std::uint32_t>();
  chunk.compression = fields.string();
  chunk.records = fields.bytes(fields.value<std::uint64_t>());
  return unless_failed(fields, chunk);
}

std::optional<McapMetadata> parse_metadata(std::string_view content) {
  FieldReader fields(content);
  McapMetadata metadata;
  metadata.name = fields.string();
  metadata.entries = take_map(fields);
  return unless_failed(fields, std::move(metadata));
}

std::optional<McapFooter> parse_footer(std::string_view content) {
  FieldReader fields(content);
  McapFooter footer;
  footer.summary_start = fields.value<std::uint64_t>();
  footer.summary_offset_start = fields.value<std::uint64_t>();
  footer.summary_crc = fields.value<std::uint32_t>();
  return unless_failed(fields, footer);
}

}  // namespace rustle::capture
