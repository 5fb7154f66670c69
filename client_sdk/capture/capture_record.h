#pragma once

#include <cstdint>
#include <string>
#include <string_view>

#include "rustle/v1/session.pb.h"

namespace rustle::capture {

enum class Kind {
  kStreamMessage,  ///< a serialized rustle.v1.StreamMessage, byte for byte as it arrived
  kDecision,       ///< a serialized rustle.v1.Decision of the daemon that recorded it
};

/// One entry of a capture.
struct CaptureRecord {
  std::string topic;                  ///< as topic_of() gives it
  std::uint64_t log_time_ns = 0;      ///< when it arrived, or its simulation time
  std::uint64_t publish_time_ns = 0;  ///< when it was sent; the log time when unknown
  std::uint32_t sequence = 0;         ///< the message's, modulo 2^32
  std::string bytes;
  Kind kind = Kind::kStreamMessage;
};

/// "/SESSION/sheet", "/SESSION/topology", "/SESSION/frame/SHEETID", "/SESSION/scene", "/SESSION/listener",
/// "/SESSION/advance", "/SESSION/end", "/SESSION/announcement", "/SESSION/tear_tips"; "/SESSION/other" without a body.
std::string topic_of(const v1::StreamMessage& message);
/// The same of a message that may leave its session to its topic.
std::string topic_of(const v1::StreamMessage& message, std::string_view session_id);
/// "/SESSION/decision"
std::string topic_of(const v1::Decision& decision);
std::string decision_topic(std::string_view session_id);

/// The message serialized deterministically under its own topic and sequence number.
CaptureRecord record_of(const v1::StreamMessage& message, std::uint64_t log_time_ns, std::uint64_t publish_time_ns);
CaptureRecord record_of(const v1::Decision& decision, std::uint64_t log_time_ns);

}  // namespace rustle::capture
