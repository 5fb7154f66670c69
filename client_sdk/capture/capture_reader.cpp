#include "client_sdk/capture/capture_reader.h"

#include <charconv>

#include <fmt/format.h>

#include "client_sdk/capture/capture_writer.h"

namespace rustle::capture {

tl::expected<CaptureReader, std::string> CaptureReader::open(const std::filesystem::path& path) {
  auto file = open_file(path);
  if (!file) return tl::unexpected(file.error().text());
  return open(std::move(*file));
}

tl::expected<CaptureReader, std::string> CaptureReader::open(std::unique_ptr<InputFile> file) {
  auto mcap = McapReader::open(std::move(file));
  if (!mcap) return tl::unexpected(mcap.error());
  CaptureReader reader(std::move(*mcap));
  reader.first_ = reader.take();
  const std::map<std::string, std::string> notes = reader.notes();
  if (const auto stated = notes.find("wire_version"); stated != notes.end()) {
    std::uint32_t version = 0;
    const std::string& text = stated->second;
    std::from_chars(text.data(), text.data() + text.size(), version);
    if (version > kWireVersion) {
      return tl::unexpected(fmt::format("{}: holds version {} of the wire, this Rustle knows {}; use a newer Rustle",
                                        reader.file_name(), version, kWireVersion));
    }
  }
  if (!reader.first_ && reader.foreign_messages_ > 0 && reader.recovery().complete) {
    return tl::unexpected(fmt::format("{}: an MCAP file, but none of its {} messages is Rustle's", reader.file_name(),
                                      reader.foreign_messages_));
  }
  return reader;
}

std::map<std::string, std::string> CaptureReader::notes() const {
  const auto found = mcap_.metadata().find("rustle");
  return found == mcap_.metadata().end() ? std::map<std::string, std::string>{} : found->second.entries;
}

std::optional<CaptureRecord> CaptureReader::next() {
  if (first_) return std::exchange(first_, std::nullopt);
  return take();
}

std::optional<CaptureRecord> CaptureReader::take() {
  while (auto read = mcap_.next()) {
    const std::string_view schema = read->schema != nullptr ? std::string_view(read->schema->name) : std::string_view();
    const bool is_message = schema == "rustle.v1.StreamMessage";
    if (!is_message && schema != "rustle.v1.Decision") {
      ++foreign_messages_;
      continue;
    }
    const McapMessage& message = read->message;
    return CaptureRecord{read->channel->topic,      message.log_time_ns,
                         message.publish_time_ns,   message.sequence,
                         std::string(message.data), is_message ? Kind::kStreamMessage : Kind::kDecision};
  }
  return std::nullopt;
}

}  // namespace rustle::capture
