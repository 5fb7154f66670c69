#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>

#include <tl/expected.hpp>

#include "server/session/session_options.h"
#include "server/wire/error.h"
#include "server/wire/limits.h"

namespace rustle::v1 {
class StreamMessage;
}

namespace rustle::wire {

/// What a publisher without control says of itself.
struct Announcement {
  std::string name;
  session::SessionOptions options;
};

/// A parsed stream message: enough to find its session, whose Decoder reads the rest.
class StreamEnvelope {
 public:
  enum class Body { kAnnouncement, kSheet, kTopology, kFrame, kScene, kListener, kAdvance, kEnd, kTearTips };

  /// Parses one message. The session id is the message's own, or the topic where it has none.
  /// Errors: TOO_LARGE, MALFORMED (no protobuf, no body, no or two different session ids), NOT_FINITE (sent_at_s).
  /// \pre none: bytes are anything; they may be unaligned and are not referred to afterwards.
  [[nodiscard]] static tl::expected<StreamEnvelope, Error> parse(std::span<const std::byte> bytes, std::string_view topic,
                                                                 const Limits& limits = {});

  StreamEnvelope(StreamEnvelope&&) noexcept;
  StreamEnvelope& operator=(StreamEnvelope&&) noexcept;
  ~StreamEnvelope();

  const std::string& session_id() const { return session_id_; }
  std::uint64_t sequence() const { return sequence_; }  ///< 0: unnumbered
  double sent_at_s() const { return sent_at_s_; }       ///< sender's clock; 0: unknown
  Body body() const { return body_; }
  std::size_t bytes() const { return bytes_; }

  /// For accounting before decoding: the sheet of a frame or of tear tips, and the time of whatever has one.
  std::optional<std::uint32_t> sheet_id() const;
  std::optional<double> time_s() const;

  /// \pre body() == kAnnouncement. Errors: PROTOCOL_VERSION and those of the options.
  [[nodiscard]] tl::expected<Announcement, Error> announcement(const Limits& limits = {}) const;

  const v1::StreamMessage& message() const { return *message_; }
  /// The message again: it says the same, though not necessarily in the bytes in which it came.
  [[nodiscard]] std::string serialized() const;

 private:
  StreamEnvelope();

  std::unique_ptr<v1::StreamMessage> message_;
  std::string session_id_;
  std::uint64_t sequence_ = 0;
  double sent_at_s_ = 0;
  Body body_ = Body::kAdvance;
  std::size_t bytes_ = 0;
};

}  // namespace rustle::wire
