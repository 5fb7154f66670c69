#include "client_sdk/capture/mcap_reader.h"

#include <algorithm>
#include <utility>

#include <fmt/format.h>

#include "client_sdk/capture/chunk_compression.h"

namespace rustle::capture {
namespace {

constexpr std::uint64_t kMaxRecordBytes = kMaxChunkBytes + (1u << 20);
constexpr std::uint64_t kMaxHeaderBytes = 1u << 20;
constexpr std::uint64_t kReadStep = 1u << 20;

bool is_kept(McapOpcode opcode) {
  switch (opcode) {
    case McapOpcode::kFooter:
    case McapOpcode::kSchema:
    case McapOpcode::kChannel:
    case McapOpcode::kMessage:
    case McapOpcode::kChunk:
    case McapOpcode::kMetadata:
    case McapOpcode::kDataEnd:
      return true;
    default:
      return false;
  }
}

std::string_view name_of(McapOpcode opcode) {
  switch (opcode) {
    case McapOpcode::kChunk:
      return "a chunk";
    case McapOpcode::kMessageIndex:
      return "a message index";
    case McapOpcode::kMessage:
      return "a message";
    case McapOpcode::kFooter:
      return "the footer";
    case McapOpcode::kDataEnd:
      return "the end of the data";
    default:
      return "a record";
  }
}

}  // namespace

tl::expected<McapReader, std::string> McapReader::open(std::unique_ptr<InputFile> file) {
  McapReader reader(std::move(file));
  const std::string& name = reader.file_name();
  std::string start;
  const Got got = reader.take(start, kMcapMagic.size());
  if (got == Got::kFailed) return tl::unexpected(fmt::format("{}: {}", name, reader.read_error_));
  if (start.empty()) return tl::unexpected(fmt::format("{}: the file is empty; nothing was recorded in it", name));
  if (start != kMcapMagic.substr(0, start.size())) {
    if (start.size() == kMcapMagic.size() && start.substr(0, 5) == kMcapMagic.substr(0, 5) && start.substr(6) == "\r\n") {
      return tl::unexpected(fmt::format("{}: MCAP of major version '{}' is not known here, only '0'", name, start[5]));
    }
    return tl::unexpected(fmt::format("{}: not an MCAP file; give a capture, or make one with `rustle import`", name));
  }
  std::string prefix;
  if (got == Got::kAll && reader.take(prefix, kMcapRecordPrefix) == Got::kAll) {
    FieldReader fields(prefix);
    const auto opcode = static_cast<McapOpcode>(fields.value<std::uint8_t>());
    const auto length = fields.value<std::uint64_t>();
    if (opcode != McapOpcode::kHeader || length > kMaxHeaderBytes) {
      return tl::unexpected(fmt::format("{}: damaged: an MCAP file begins with its header, this one does not", name));
    }
    std::string content;
    if (reader.take(content, length) == Got::kAll) {
      std::optional<McapHeader> header = parse_header(content);
      if (!header) return tl::unexpected(fmt::format("{}: damaged within its header", name));
      reader.header_ = std::move(*header);
      reader.recovery_.bytes_read = reader.position_;
      return reader;
    }
  }
  return tl::unexpected(
      fmt::format("{}: cut within its header, after {} bytes; nothing can be recovered", name, reader.position_));
}

McapReader::Got McapReader::take(std::string& out, std::uint64_t count) {
  out.clear();
  while (out.size() < count) {
    const std::size_t filled = out.size();
    const std::size_t step = static_cast<std::size_t>(std::min(count - filled, kReadStep));
    out.resize(filled + step);
    const auto got = file_->read(std::span(out).subspan(filled));
    const std::size_t received = got ? *got : 0;
    out.resize(filled + received);
    position_ += received;
    crc_ = crc32_of(std::string_view(out).substr(filled), crc_);
    if (!got) {
      read_error_ = fmt::format("cannot read: {}", got.error().message());
      return Got::kFailed;
    }
    if (received < step) return Got::kCut;
  }
  return Got::kAll;
}

McapReader::Got McapReader::skip(std::uint64_t count) {
  Got got = Got::kAll;
  while (count > 0 && got == Got::kAll) {
    const std::uint64_t step = std::min(count, kReadStep);
    got = take(content_, step);
    count -= step;
  }
  return got;
}

void McapReader::stop(std::string what) {
  ended_ = true;
  recovery_.complete = false;
  recovery_.what = fmt::format("{}: {}; messages read before it: {}", file_name(), what, messages_);
}

void McapReader::stop_cut(std::string_view where) {
  if (!read_error_.empty()) return stop(fmt::format("{} at byte {}", read_error_, position_));
  stop(fmt::format("the file is cut at byte {}, {} (its last {} bytes are lost)", position_, where,
                   position_ - recovery_.bytes_read));
}

/// The next record of the data section: content_ and opcode_ for those that matter, the others are passed over.
bool McapReader::read_record() {
  const std::uint32_t crc_before = crc_;
  const Got got = take(prefix_, kMcapRecordPrefix);
  if (got != Got::kAll) {
    stop_cut(prefix_.empty() ? "between two records" : "within a record");
    return false;
  }
  FieldReader fields(prefix_);
  opcode_ = static_cast<McapOpcode>(fields.value<std::uint8_t>());
  const auto length = fields.value<std::uint64_t>();
  if (static_cast<std::uint8_t>(opcode_) == 0) {
    stop(fmt::format("damaged at byte {}, where a record should begin", position_ - kMcapRecordPrefix));
    return false;
  }
  if (is_kept(opcode_) && length > kMaxRecordBytes) {
    stop(fmt::format("damaged at byte {}: {} of {} bytes, more than can be right", position_ - kMcapRecordPrefix,
                     name_of(opcode_), length));
    return false;
  }
  if ((is_kept(opcode_) ? take(content_, length) : skip(length)) != Got::kAll) {
    stop_cut(fmt::format("within {}", name_of(opcode_)));
    return false;
  }
  if (opcode_ == McapOpcode::kDataEnd) {
    const std::uint32_t stored = FieldReader(content_).value<std::uint32_t>();
    if (stored != 0 && stored != crc_before) {
      stop("the checksum of its data does not match, so something between the chunks is damaged");
      return false;
    }
  }
  recovery_.bytes_read = position_;
  return true;
}

bool McapReader::open_chunk() {
  const std::uint64_t at = position_ - content_.size() - kMcapRecordPrefix;
  const auto damaged = [&](const std::string& why) {
    recovery_.bytes_read = at;
    stop(fmt::format("the chunk at byte {} is damaged: {}", at, why));
    return false;
  };
  const std::optional<McapChunk> chunk = parse_chunk(content_);
  if (!chunk) return damaged("its fields are incomplete");
  auto records = decompress(chunk->records, chunk->compression, chunk->uncompressed_size);
  if (!records) return damaged(records.error());
  if (chunk->uncompressed_crc != 0 && chunk->uncompressed_crc != crc32_of(*records)) {
    return damaged("its checksum does not match");
  }
  chunked_ = true;
  chunk_ = std::move(*records);
  chunk_position_ = 0;
  return true;
}

std::optional<McapReader::Message> McapReader::declare_or_message(McapOpcode opcode, std::string_view content) {
  const auto damaged = [&](const std::string& why) {
    stop(fmt::format("damaged before byte {}: {}", position_, why));
    return std::nullopt;
  };
  if (opcode == McapOpcode::kSchema) {
    std::optional<McapSchema> schema = parse_schema(content);
    if (!schema) return damaged("an incomplete schema");
    if (schema->id != 0 && schemas_.try_emplace(schema->id, *schema).first->second != *schema)
      return damaged(fmt::format("schema {} is declared twice, differently", schema->id));
  } else if (opcode == McapOpcode::kChannel) {
    std::optional<McapChannel> channel = parse_channel(content);
    if (!channel) return damaged("an incomplete channel");
    if (channels_.try_emplace(channel->id, *channel).first->second != *channel)
      return damaged(fmt::format("channel {} is declared twice, differently", channel->id));
  } else if (opcode == McapOpcode::kMessage) {
    const std::optional<McapMessage> message = parse_message(content);
    if (!message) return damaged("an incomplete message");
    const auto channel = channels_.find(message->channel_id);
    if (channel == channels_.end()) {
      return damaged(fmt::format("a message of channel {}, which was not declared", message->channel_id));
    }
    const auto schema = schemas_.find(channel->second.schema_id);
    ++messages_;
    return Message{&channel->second, schema == schemas_.end() ? nullptr : &schema->second, *message};
  }
  return std::nullopt;
}

std::optional<McapReader::Message> McapReader::next() {
  while (!ended_) {
    if (chunk_position_ < chunk_.size()) {
      FieldReader fields(std::string_view(chunk_).substr(chunk_position_));
      const auto opcode = static_cast<McapOpcode>(fields.value<std::uint8_t>());
      const std::string_view content = fields.bytes(fields.value<std::uint64_t>());
      if (fields.failed()) {
        stop(fmt::format("damaged before byte {}: a chunk ends within a record", position_));
        break;
      }
      chunk_position_ = chunk_.size() - fields.rest().size();
      if (auto message = declare_or_message(opcode, content)) return message;
      continue;
    }
    if (!read_record()) break;
    if (opcode_ == McapOpcode::kChunk) {
      if (!open_chunk()) break;
    } else if (opcode_ == McapOpcode::kMetadata) {
      std::optional<McapMetadata> metadata = parse_metadata(content_);
      if (!metadata) {
        stop(fmt::format("damaged before byte {}: an incomplete metadata record", position_));
        break;
      }
      std::string name = metadata->name;
      metadata_.emplace(std::move(name), std::move(*metadata));
    } else if (opcode_ == McapOpcode::kDataEnd || opcode_ == McapOpcode::kFooter) {
      read_summary();
    } else if (chunked_ && opcode_ == McapOpcode::kMessage) {
      stop(fmt::format("damaged before byte {}: a message outside of the chunks", position_));
    } else if (auto message = declare_or_message(opcode_, content_)) {
      return message;
    }
  }
  return std::nullopt;
}

/// What follows the data holds nothing new: only whether it is whole is looked at.
void McapReader::read_summary() {
  ended_ = true;
  const std::uint64_t data_bytes = recovery_.bytes_read;
  const auto spoiled = [&](std::string_view why) {
    stop(fmt::format("{} in its summary, after the data; no message is lost", why));
    recovery_.bytes_read = data_bytes;
  };
  const bool footer_came_first = opcode_ == McapOpcode::kFooter;
  // Without a summary the data section may end at the footer itself; then there is no sum of the summary to compare.
  crc_ = 0;
  std::uint32_t crc_before_last_field = 0;
  while (opcode_ != McapOpcode::kFooter) {
    if (take(prefix_, kMcapRecordPrefix) != Got::kAll) return spoiled("the file is cut");
    FieldReader fields(prefix_);
    opcode_ = static_cast<McapOpcode>(fields.value<std::uint8_t>());
    const auto length = fields.value<std::uint64_t>();
    if (opcode_ != McapOpcode::kFooter) {
      if (skip(length) != Got::kAll) return spoiled("the file is cut or damaged");
      continue;
    }
    if (length != kMcapFooterContent) return spoiled("the file is damaged");
    if (take(content_, length - sizeof(std::uint32_t)) != Got::kAll) return spoiled("the file is cut");
    crc_before_last_field = crc_;
    std::string stored;
    if (take(stored, sizeof(std::uint32_t)) != Got::kAll) return spoiled("the file is cut");
    content_ += stored;
  }
  const std::optional<McapFooter> footer = parse_footer(content_);
  if (!footer) return spoiled("the file is damaged");
  if (footer_came_first && footer->summary_start != 0)
    return spoiled("the end of the data is not marked, so the file is damaged");
  if (!footer_came_first && footer->summary_crc != 0 && footer->summary_crc != crc_before_last_field) {
    return spoiled("a checksum does not match");
  }
  std::string magic;
  if (take(magic, kMcapMagic.size()) != Got::kAll) return spoiled("the file is cut");
  if (magic != kMcapMagic) return spoiled("the file is damaged");
  recovery_.bytes_read = position_;
}

}  // namespace rustle::capture
