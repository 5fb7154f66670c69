#include "client_sdk/capture/mcap_format.h"

#include <zlib.h>

#include <algorithm>
#include <cassert>
#include <limits>
#include <tuple>
#include <type_traits>

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

/// Bytes with a length of 64 bits before them, and bytes up to the record's end.
template <typename View>
struct LongBytes {
  View& bytes;
};
template <typename View>
struct RestOfBytes {
  View& bytes;
};

/// The fields of a record in the order in which they lie in the file: what is written and read goes by this list.
template <typename Kind>
auto fields_of(Kind& record) {
  using Plain = std::remove_const_t<Kind>;
  if constexpr (std::is_same_v<Plain, McapHeader>) {
    return std::tie(record.profile, record.library);
  } else if constexpr (std::is_same_v<Plain, McapSchema>) {
    return std::tie(record.id, record.name, record.encoding, record.data);
  } else if constexpr (std::is_same_v<Plain, McapChannel>) {
    return std::tie(record.id, record.schema_id, record.topic, record.message_encoding, record.metadata);
  } else if constexpr (std::is_same_v<Plain, McapMessage>) {
    return std::tuple_cat(std::tie(record.channel_id, record.sequence, record.log_time_ns, record.publish_time_ns),
                          std::tuple(RestOfBytes<decltype((record.data))>{record.data}));
  } else if constexpr (std::is_same_v<Plain, McapChunk>) {
    return std::tuple_cat(std::tie(record.start_time_ns, record.end_time_ns, record.uncompressed_size,
                                   record.uncompressed_crc, record.compression),
                          std::tuple(LongBytes<decltype((record.records))>{record.records}));
  } else if constexpr (std::is_same_v<Plain, McapChunkIndex>) {
    return std::tie(record.start_time_ns, record.end_time_ns, record.chunk_start, record.chunk_length,
                    record.message_index_offsets, record.message_index_length, record.compression, record.compressed_size,
                    record.uncompressed_size);
  } else if constexpr (std::is_same_v<Plain, McapMetadata>) {
    return std::tie(record.name, record.entries);
  } else if constexpr (std::is_same_v<Plain, McapMetadataIndex>) {
    return std::tie(record.offset, record.length, record.name);
  } else if constexpr (std::is_same_v<Plain, McapStatistics>) {
    return std::tie(record.message_count, record.schema_count, record.channel_count, record.attachment_count,
                    record.metadata_count, record.chunk_count, record.start_time_ns, record.end_time_ns,
                    record.channel_message_counts);
  } else {
    static_assert(std::is_same_v<Plain, McapFooter>);
    return std::tie(record.summary_start, record.summary_offset_start, record.summary_crc);
  }
}

template <typename Value>
void append_field(std::string& out, const Value& value) {
  if constexpr (std::is_arithmetic_v<Value>) {
    append_value(out, value);
  } else if constexpr (std::is_convertible_v<Value, std::string_view>) {
    append_string(out, value);
  } else {
    append_map(out, value);
  }
}
template <typename View>
void append_field(std::string& out, const LongBytes<View>& field) {
  append_value(out, static_cast<std::uint64_t>(field.bytes.size()));
  out.append(field.bytes);
}
template <typename View>
void append_field(std::string& out, const RestOfBytes<View>& field) {
  out.append(field.bytes);
}

template <typename Kind>
void append_record(std::string& out, McapOpcode opcode, const Kind& content) {
  const Record record(out, opcode);
  std::apply([&](const auto&... field) { (append_field(out, field), ...); }, fields_of(content));
}

void take_field(FieldReader& fields, std::map<std::string, std::string>& entries) {
  FieldReader inner(fields.string());
  while (!inner.failed() && !inner.rest().empty()) {
    const std::string_view key = inner.string();
    const std::string_view value = inner.string();
    if (!inner.failed()) entries.emplace(key, value);
  }
}
template <typename Value>
void take_field(FieldReader& fields, Value& value) {
  if constexpr (std::is_arithmetic_v<Value>) {
    value = fields.value<Value>();
  } else {
    value = fields.string();
  }
}
template <typename View>
void take_field(FieldReader& fields, LongBytes<View>& field) {
  field.bytes = fields.bytes(fields.value<std::uint64_t>());
}
template <typename View>
void take_field(FieldReader& fields, RestOfBytes<View>& field) {
  field.bytes = fields.rest();
}

template <typename Kind>
std::optional<Kind> parse_record(std::string_view content) {
  FieldReader fields(content);
  Kind record;
  std::apply([&](auto&&... field) { (take_field(fields, field), ...); }, fields_of(record));
  if (fields.failed()) return std::nullopt;
  return record;
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
  append_record(out, McapOpcode::kHeader, header);
}

void append_schema(std::string& out, const McapSchema& schema) {
  append_record(out, McapOpcode::kSchema, schema);
}

void append_channel(std::string& out, const McapChannel& channel) {
  append_record(out, McapOpcode::kChannel, channel);
}

void append_message(std::string& out, const McapMessage& message) {
  append_record(out, McapOpcode::kMessage, message);
}

void append_chunk(std::string& out, const McapChunk& chunk) {
  append_record(out, McapOpcode::kChunk, chunk);
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
  append_record(out, McapOpcode::kChunkIndex, index);
}

void append_metadata(std::string& out, const McapMetadata& metadata) {
  append_record(out, McapOpcode::kMetadata, metadata);
}

void append_metadata_index(std::string& out, const McapMetadataIndex& index) {
  append_record(out, McapOpcode::kMetadataIndex, index);
}

void append_statistics(std::string& out, const McapStatistics& statistics) {
  append_record(out, McapOpcode::kStatistics, statistics);
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
  return parse_record<McapHeader>(content);
}

std::optional<McapSchema> parse_schema(std::string_view content) {
  return parse_record<McapSchema>(content);
}

std::optional<McapChannel> parse_channel(std::string_view content) {
  return parse_record<McapChannel>(content);
}

std::optional<McapMessage> parse_message(std::string_view content) {
  return parse_record<McapMessage>(content);
}

std::optional<McapChunk> parse_chunk(std::string_view content) {
  return parse_record<McapChunk>(content);
}

std::optional<McapMetadata> parse_metadata(std::string_view content) {
  return parse_record<McapMetadata>(content);
}

std::optional<McapFooter> parse_footer(std::string_view content) {
  return parse_record<McapFooter>(content);
}

}  // namespace rustle::capture
