#include "client_sdk/capture/retime.h"

#include "rustle/v1/session.pb.h"

namespace rustle::capture {

std::string retimed(std::string_view stream_message, double by_s, bool reset_history) {
  v1::StreamMessage message;
  if (!message.ParseFromArray(stream_message.data(), static_cast<int>(stream_message.size())))
    return std::string(stream_message);
  const auto move = [by_s](auto* body) { body->set_time_s(body->time_s() + by_s); };
  switch (message.body_case()) {
    case v1::StreamMessage::kFrame:
      move(message.mutable_frame());
      if (reset_history) message.mutable_frame()->set_reset_history(true);
      break;
    case v1::StreamMessage::kScene:
      move(message.mutable_scene());
      break;
    case v1::StreamMessage::kListener:
      move(message.mutable_listener());
      break;
    case v1::StreamMessage::kAdvance:
      move(message.mutable_advance());
      break;
    case v1::StreamMessage::kTearTips:
      move(message.mutable_tear_tips());
      break;
    case v1::StreamMessage::kEnd:
      if (message.end().time_s() != 0) move(message.mutable_end());
      break;
    default:
      break;
  }
  return message.SerializeAsString();
}

}  // namespace rustle::capture
