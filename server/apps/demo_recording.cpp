#include "server/apps/demo_recording.h"

#include <cmath>
#include <filesystem>
#include <utility>

#include "client_sdk/capture/storage_file.h"
#include "client_sdk/cpp/stream_messages.h"

namespace rustle::apps {

DemoRecording::~DemoRecording() {
  std::error_code ignored;
  if (!partial_.empty()) std::filesystem::remove(partial_, ignored);
}

Failure DemoRecording::open(const std::string& file, const client::SessionOptions& options) {
  file_ = file;
  capture::CaptureWriterOptions writer_options;
  writer_options.notes["source"] = "rustle demo";
  auto writer = capture::CaptureWriter::create(file + ".partial", std::move(writer_options));
  if (!writer) return writer.error().text();
  partial_ = file + ".partial";
  writer_.emplace(std::move(*writer));
  v1::StreamMessage announcement;
  announcement.mutable_announcement()->set_protocol_version(capture::kWireVersion);
  announcement.mutable_announcement()->set_name(options.name);
  client::internal::write(options, announcement.mutable_announcement()->mutable_options());
  if (auto failed = keep(announcement)) return failed;
  for (const auto& sheet : options.sheets) {
    v1::StreamMessage message;
    client::internal::write(sheet, message.mutable_sheet());
    if (auto failed = keep(message)) return failed;
  }
  return {};
}

Failure DemoRecording::topology(const client::Topology& topology) {
  v1::StreamMessage message;
  client::internal::write(topology, message.mutable_topology());
  return keep(message);
}

Failure DemoRecording::scene(const client::SceneUpdate& update) {
  v1::StreamMessage message;
  client::internal::write(update, message.mutable_scene());
  return keep(message);
}

Failure DemoRecording::frame(std::uint32_t sheet_id, std::uint64_t topology_id, double time_s,
                             std::span<const float> positions, const client::FrameExtras& extras) {
  if (!writer_) return {};
  v1::StreamMessage message;
  v1::MeshFrame* frame = message.mutable_frame();
  frame->set_sheet_id(sheet_id);
  frame->set_topology_id(topology_id);
  frame->set_time_s(time_s);
  client::internal::set_bytes(positions, frame->mutable_positions());
  client::internal::write(extras, frame);
  time_s_ = time_s;
  return keep(message);
}

Failure DemoRecording::finish() {
  if (!writer_) return {};
  v1::StreamMessage end;
  end.mutable_end();
  if (auto failed = keep(end)) return failed;
  if (auto closed = writer_->close(); !closed) return closed.error().text();
  std::error_code cause;
  std::filesystem::rename(partial_, file_, cause);
  if (cause) return capture::storage_error(file_, "take the file's name", cause).text();
  partial_.clear();
  return {};
}

Failure DemoRecording::keep(v1::StreamMessage& message) {
  if (!writer_) return {};
  message.set_session_id("demo");
  message.set_sequence(++sequence_);
  const auto log_time_ns = static_cast<std::uint64_t>(std::llround(1e9 * time_s_));
  if (auto written = writer_->write(capture::record_of(message, log_time_ns, log_time_ns)); !written)
    return written.error().text();
  return {};
}

}  // namespace rustle::apps
