#include "client_sdk/capture/capture_writer.h"

#include <google/protobuf/descriptor.h>
#include <google/protobuf/descriptor.pb.h>

#include <set>

#include <fmt/format.h>

namespace rustle::capture {
namespace {

void add_with_imports(const google::protobuf::FileDescriptor& file, std::set<std::string>& added,
                      google::protobuf::FileDescriptorSet& out) {
  if (!added.insert(file.name()).second) return;
  for (int i = 0; i < file.dependency_count(); ++i) add_with_imports(*file.dependency(i), added, out);
  file.CopyTo(out.add_file());
}

std::string descriptor_set(const google::protobuf::Descriptor& message) {
  google::protobuf::FileDescriptorSet set;
  std::set<std::string> added;
  add_with_imports(*message.file(), added, set);
  return set.SerializeAsString();
}

}  // namespace

tl::expected<CaptureWriter, StorageError> CaptureWriter::create(const std::filesystem::path& path,
                                                                CaptureWriterOptions options) {
  auto file = create_file(path);
  if (!file) return tl::unexpected(file.error());
  return create(std::move(*file), std::move(options));
}

tl::expected<CaptureWriter, StorageError> CaptureWriter::create(std::unique_ptr<OutputFile> file,
                                                                CaptureWriterOptions options) {
  CaptureWriter writer(McapWriter(std::move(file), std::move(options.mcap)));
  McapMetadata metadata{"rustle", std::move(options.notes)};
  metadata.entries["wire_version"] = fmt::format("{}", kWireVersion);
  if (Result added = writer.mcap_.add_metadata(std::move(metadata)); !added) return tl::unexpected(added.error());
  const auto schema = [&](const google::protobuf::Descriptor& message) {
    return writer.mcap_.add_schema(message.full_name(), "protobuf", descriptor_set(message));
  };
  const auto message_schema = schema(*v1::StreamMessage::descriptor());
  if (!message_schema) return tl::unexpected(message_schema.error());
  const auto decision_schema = schema(*v1::Decision::descriptor());
  if (!decision_schema) return tl::unexpected(decision_schema.error());
  writer.message_schema_ = *message_schema;
  writer.decision_schema_ = *decision_schema;
  return writer;
}

tl::expected<std::uint16_t, StorageError> CaptureWriter::channel_for(const CaptureRecord& record) {
  std::pair key(record.topic, record.kind);
  if (const auto known = channels_.find(key); known != channels_.end()) return known->second;
  const std::uint16_t schema = record.kind == Kind::kDecision ? decision_schema_ : message_schema_;
  const auto added = mcap_.add_channel(schema, record.topic, "protobuf");
  if (added) channels_.emplace(std::move(key), *added);
  return added;
}

CaptureWriter::Result CaptureWriter::write(const CaptureRecord& record) {
  const auto channel = channel_for(record);
  if (!channel) return tl::unexpected(channel.error());
  Result written = mcap_.write({*channel, record.sequence, record.log_time_ns, record.publish_time_ns, record.bytes});
  if (written && record.kind == Kind::kStreamMessage) {
    if (!any_sequence_) written_sequence_ = record.sequence;
    any_sequence_ = true;
    const auto ahead = static_cast<std::int32_t>(record.sequence - static_cast<std::uint32_t>(written_sequence_));
    if (ahead > 0) written_sequence_ += static_cast<std::uint64_t>(ahead);
  }
  return written;
}

tl::expected<std::uint64_t, StorageError> CaptureWriter::sync() {
  if (Result synced = mcap_.sync(); !synced) return tl::unexpected(synced.error());
  return written_sequence_;
}

tl::expected<CaptureTotals, StorageError> CaptureWriter::close() {
  if (Result closed = mcap_.close(); !closed) return tl::unexpected(closed.error());
  return totals();
}

}  // namespace rustle::capture
