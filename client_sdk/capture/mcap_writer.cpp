#include "client_sdk/capture/mcap_writer.h"

#include <algorithm>
#include <cassert>
#include <limits>
#include <utility>

#include <fmt/format.h>

namespace rustle::capture {
namespace {

constexpr std::size_t kMaxMessageBytes = 200u << 20;
constexpr std::size_t kMaxIds = std::numeric_limits<std::uint16_t>::max();

}  // namespace

McapWriter::McapWriter(std::unique_ptr<OutputFile> file, McapWriterOptions options)
    : file_(std::move(file)), options_(std::move(options)) {
  std::string start(kMcapMagic);
  append_header(start, {"", options_.library});
  (void)append(start);
}

McapWriter::Result McapWriter::fail(StorageError error) {
  failed_ = true;
  error_ = std::move(error);
  return tl::unexpected(error_);
}

StorageError McapWriter::limit_error(std::string message, std::string remedy) const {
  return {file_->name(), std::move(message), std::move(remedy)};
}

McapWriter::Result McapWriter::append(std::string_view bytes) {
  if (closed_) return tl::unexpected(limit_error("the file is closed", "start a new recording"));
  if (failed_) return tl::unexpected(error_);
  if (const std::error_code cause = file_->write(bytes)) return fail(storage_error(file_->name(), "write", cause));
  data_crc_ = crc32_of(bytes, data_crc_);
  committed_bytes_ += bytes.size();
  return {};
}

tl::expected<std::uint16_t, StorageError> McapWriter::add_schema(std::string name, std::string encoding, std::string data) {
  if (schemas_.size() == kMaxIds) {
    return tl::unexpected(limit_error("has 65,535 schemas, as many as MCAP can hold", "start a new recording"));
  }
  McapSchema schema{static_cast<std::uint16_t>(schemas_.size() + 1), std::move(name), std::move(encoding), std::move(data)};
  std::string record;
  append_schema(record, schema);
  if (Result written = append(record); !written) return tl::unexpected(written.error());
  schemas_.push_back(std::move(schema));
  return schemas_.back().id;
}

tl::expected<std::uint16_t, StorageError> McapWriter::add_channel(std::uint16_t schema_id, std::string topic,
                                                                  std::string message_encoding) {
  assert(schema_id >= 1 && schema_id <= schemas_.size());
  if (channels_.size() == kMaxIds) {
    return tl::unexpected(limit_error("has 65,535 topics, as many as MCAP can hold", "record fewer sheets in one file"));
  }
  McapChannel channel{
      static_cast<std::uint16_t>(channels_.size() + 1), schema_id, std::move(topic), std::move(message_encoding), {}};
  std::string record;
  append_channel(record, channel);
  if (Result written = append(record); !written) return tl::unexpected(written.error());
  channels_.push_back(std::move(channel));
  return channels_.back().id;
}

McapWriter::Result McapWriter::add_metadata(McapMetadata metadata) {
  std::string record;
  append_metadata(record, metadata);
  const std::uint64_t offset = committed_bytes_;
  if (Result written = append(record); !written) return written;
  metadata_indexes_.push_back({offset, record.size(), std::move(metadata.name)});
  return {};
}

McapWriter::Result McapWriter::write(const McapMessage& message) {
  assert(message.channel_id >= 1 && message.channel_id <= channels_.size());
  if (failed_ || closed_) return append({});
  if (message.data.size() > kMaxMessageBytes) {
    return tl::unexpected(
        limit_error(fmt::format("cannot hold a message of {} bytes; at most {}", message.data.size(), kMaxMessageBytes),
                    "send smaller meshes"));
  }
  const std::uint64_t log_time_ns = message.log_time_ns;
  if (!chunk_.empty() &&
      (std::max(chunk_end_ns_, log_time_ns) - std::min(chunk_start_ns_, log_time_ns) >= options_.chunk_span_ns ||
       chunk_.size() + message.data.size() > kMaxMessageBytes)) {
    if (Result closed = close_chunk(); !closed) return closed;
  }
  if (chunk_.empty()) chunk_start_ns_ = chunk_end_ns_ = log_time_ns;
  chunk_start_ns_ = std::min(chunk_start_ns_, log_time_ns);
  chunk_end_ns_ = std::max(chunk_end_ns_, log_time_ns);
  McapMessageIndex& index = chunk_index_[message.channel_id];
  if (index.empty()) append_channel(chunk_, channels_[message.channel_id - 1]);
  index.emplace_back(log_time_ns, chunk_.size());
  append_message(chunk_, message);
  if (chunk_.size() >= options_.chunk_bytes) return close_chunk();
  return {};
}

McapWriter::Result McapWriter::close_chunk_before(std::uint64_t now_ns) {
  if (chunk_.empty() || now_ns < chunk_start_ns_ || now_ns - chunk_start_ns_ < options_.chunk_span_ns) return {};
  return close_chunk();
}

McapWriter::Result McapWriter::close_chunk() {
  if (failed_ || closed_) return append({});
  if (chunk_.empty()) return {};

  const std::string packed = compress(chunk_, options_.compression, options_.zstd_level);
  const std::string_view compression = compression_name(options_.compression);
  McapChunkIndex index;
  index.start_time_ns = chunk_start_ns_;
  index.end_time_ns = chunk_end_ns_;
  index.chunk_start = committed_bytes_;
  index.compression = compression;
  index.compressed_size = packed.size();
  index.uncompressed_size = chunk_.size();

  // One write for the chunk and its indexes: the file holds all of them or is cut back to before them.
  std::string records;
  append_chunk(records, {chunk_start_ns_, chunk_end_ns_, chunk_.size(), crc32_of(chunk_), compression, packed});
  index.chunk_length = records.size();
  std::uint64_t messages = 0;
  for (auto& [channel_id, entries] : chunk_index_) {
    index.message_index_offsets[channel_id] = committed_bytes_ + records.size();
    std::stable_sort(entries.begin(), entries.end());
    append_message_index(records, channel_id, entries);
    messages += entries.size();
  }
  index.message_index_length = records.size() - index.chunk_length;

  Result written = append(records);
  if (written) {
    const bool first = statistics_.message_count == 0;
    statistics_.start_time_ns = first ? chunk_start_ns_ : std::min(statistics_.start_time_ns, chunk_start_ns_);
    statistics_.end_time_ns = std::max(statistics_.end_time_ns, chunk_end_ns_);
    statistics_.message_count += messages;
    for (const auto& [channel_id, entries] : chunk_index_) {
      statistics_.channel_message_counts[channel_id] += entries.size();
    }
    chunk_indexes_.push_back(std::move(index));
  }
  chunk_.clear();
  chunk_index_.clear();
  return written;
}

McapWriter::Result McapWriter::sync() {
  if (Result closed = close_chunk(); !closed) return closed;
  if (const std::error_code cause = file_->sync()) {
    return fail(storage_error(file_->name(), "bring the data to the disk", cause));
  }
  return {};
}

std::string McapWriter::summary() const {
  struct Group {
    McapOpcode opcode;
    std::uint64_t start, length;
  };
  std::string out;
  append_data_end(out, data_crc_);
  const std::size_t summary_start = out.size();
  std::vector<Group> groups;
  const auto group = [&](McapOpcode opcode, const auto& items, const auto& append_item) {
    const std::size_t start = out.size();
    for (const auto& item : items) append_item(out, item);
    if (out.size() > start) groups.push_back({opcode, committed_bytes_ + start, out.size() - start});
  };
  McapStatistics statistics = statistics_;
  statistics.schema_count = static_cast<std::uint16_t>(schemas_.size());
  statistics.channel_count = static_cast<std::uint32_t>(channels_.size());
  statistics.metadata_count = static_cast<std::uint32_t>(metadata_indexes_.size());
  statistics.chunk_count = static_cast<std::uint32_t>(chunk_indexes_.size());
  group(McapOpcode::kSchema, schemas_, append_schema);
  group(McapOpcode::kChannel, channels_, append_channel);
  group(McapOpcode::kStatistics, std::vector{statistics}, append_statistics);
  group(McapOpcode::kChunkIndex, chunk_indexes_, append_chunk_index);
  group(McapOpcode::kMetadataIndex, metadata_indexes_, append_metadata_index);
  const std::size_t offsets_start = out.size();
  for (const Group& each : groups) append_summary_offset(out, each.opcode, each.start, each.length);
  append_footer(out, summary_start, {committed_bytes_ + summary_start, committed_bytes_ + offsets_start, 0});
  out.append(kMcapMagic);
  return out;
}

McapWriter::Result McapWriter::finish() {
  if (!failed_) (void)close_chunk();
  if (failed_ && file_->truncate(committed_bytes_)) return tl::unexpected(error_);
  const std::string ending = summary();
  if (const std::error_code cause = file_->write(ending)) {
    (void)file_->truncate(committed_bytes_);
    if (!failed_) return fail(storage_error(file_->name(), "write the summary", cause));
  } else {
    committed_bytes_ += ending.size();
  }
  if (failed_) return tl::unexpected(error_);
  return {};
}

McapWriter::Result McapWriter::close() {
  if (closed_) return {};
  Result finished = finish();
  if (finished) {
    if (const std::error_code cause = file_->sync()) {
      finished = fail(storage_error(file_->name(), "bring the data to the disk", cause));
    }
  }
  closed_ = true;
  if (const std::error_code cause = file_->close(); cause && finished) {
    finished = fail(storage_error(file_->name(), "close the file", cause));
  }
  return finished;
}

}  // namespace rustle::capture
