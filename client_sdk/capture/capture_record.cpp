#include "client_sdk/capture/capture_record.h"

#include <google/protobuf/io/coded_stream.h>
#include <google/protobuf/io/zero_copy_stream_impl_lite.h>

#include <fmt/format.h>

namespace rustle::capture {
namespace {

std::string serialize(const google::protobuf::Message& message) {
  std::string bytes;
  {
    google::protobuf::io::StringOutputStream stream(&bytes);
    google::protobuf::io::CodedOutputStream coded(&stream);
    coded.SetSerializationDeterministic(true);
    message.SerializeToCodedStream(&coded);
  }
  return bytes;
}

}  // namespace

std::string topic_of(const v1::StreamMessage& message) {
  return topic_of(message, message.session_id());
}

std::string topic_of(const v1::StreamMessage& message, std::string_view session_id) {
  const auto topic = [&](std::string_view name) { return fmt::format("/{}/{}", session_id, name); };
  switch (message.body_case()) {
    case v1::StreamMessage::kAnnouncement:
      return topic("announcement");
    case v1::StreamMessage::kSheet:
      return topic("sheet");
    case v1::StreamMessage::kTopology:
      return topic("topology");
    case v1::StreamMessage::kFrame:
      return topic(fmt::format("frame/{}", message.frame().sheet_id()));
    case v1::StreamMessage::kScene:
      return topic("scene");
    case v1::StreamMessage::kListener:
      return topic("listener");
    case v1::StreamMessage::kAdvance:
      return topic("advance");
    case v1::StreamMessage::kEnd:
      return topic("end");
    case v1::StreamMessage::kTearTips:
      return topic("tear_tips");
    case v1::StreamMessage::BODY_NOT_SET:
      break;
  }
  return topic("other");
}

std::string topic_of(const v1::Decision& decision) {
  return decision_topic(decision.session_id());
}

std::string decision_topic(std::string_view session_id) {
  return fmt::format("/{}/decision", session_id);
}

CaptureRecord record_of(const v1::StreamMessage& message, std::uint64_t log_time_ns, std::uint64_t publish_time_ns) {
  return {topic_of(message),  log_time_ns,         publish_time_ns, static_cast<std::uint32_t>(message.sequence()),
          serialize(message), Kind::kStreamMessage};
}

CaptureRecord record_of(const v1::Decision& decision, std::uint64_t log_time_ns) {
  return {topic_of(decision),  log_time_ns,    log_time_ns, static_cast<std::uint32_t>(decision.sequence()),
          serialize(decision), Kind::kDecision};
}

}  // namespace rustle::capture
