#include "server/wire/stream_envelope.h"

#include <cassert>
#include <cmath>

#include <fmt/format.h>

#include "rustle/v1/session.pb.h"
#include "server/wire/fields.h"
#include "server/wire/session_options.h"
#include "server/wire/topics.h"

namespace rustle::wire {
namespace {

std::optional<StreamEnvelope::Body> body_of(const v1::StreamMessage& message) {
  using Body = StreamEnvelope::Body;
  switch (message.body_case()) {
    case v1::StreamMessage::kAnnouncement:
      return Body::kAnnouncement;
    case v1::StreamMessage::kSheet:
      return Body::kSheet;
    case v1::StreamMessage::kTopology:
      return Body::kTopology;
    case v1::StreamMessage::kFrame:
      return Body::kFrame;
    case v1::StreamMessage::kScene:
      return Body::kScene;
    case v1::StreamMessage::kListener:
      return Body::kListener;
    case v1::StreamMessage::kAdvance:
      return Body::kAdvance;
    case v1::StreamMessage::kEnd:
      return Body::kEnd;
    case v1::StreamMessage::kTearTips:
      return Body::kTearTips;
    case v1::StreamMessage::BODY_NOT_SET:
      return std::nullopt;
  }
  return std::nullopt;
}

}  // namespace

StreamEnvelope::StreamEnvelope() : message_(std::make_unique<v1::StreamMessage>()) {}
StreamEnvelope::StreamEnvelope(StreamEnvelope&&) noexcept = default;
StreamEnvelope& StreamEnvelope::operator=(StreamEnvelope&&) noexcept = default;
StreamEnvelope::~StreamEnvelope() = default;

tl::expected<StreamEnvelope, Error> StreamEnvelope::parse(std::span<const std::byte> bytes, std::string_view topic,
                                                          const Limits& limits) {
  keep_protobuf_quiet();
  if (bytes.size() > limits.message_bytes)
    return refuse(ErrorCode::kTooLarge, "",
                  fmt::format("The message has {} bytes; at most {} are taken.", bytes.size(), limits.message_bytes),
                  "Send a coarser mesh, or several smaller ones.");
  StreamEnvelope envelope;
  v1::StreamMessage& message = *envelope.message_;
  if (!message.ParseFromArray(bytes.data(), static_cast<int>(bytes.size())))
    return refuse(ErrorCode::kMalformed, "", "The bytes are no rustle.v1.StreamMessage.",
                  "Send [topic, StreamMessage] with the protocol's version 1; text fields are UTF-8.");

  const auto with_sequence = [&message](tl::unexpected<Error> error) {
    error.value().sequence = message.sequence();
    return error;
  };
  if (!message.session_id().empty() && !topic.empty() && topic != message.session_id())
    return with_sequence(refuse(ErrorCode::kMalformed, "session_id", "The topic and the message name different sessions.",
                                "Make the topic the session's id, or leave it out."));
  envelope.session_id_ = message.session_id().empty() ? std::string(topic) : message.session_id();
  if (!valid_session_id(envelope.session_id_))
    return with_sequence(refuse(ErrorCode::kMalformed, "session_id", "The message names no session.",
                                "Give session_id: 1 to 128 characters without slashes and control characters."));
  if (!std::isfinite(message.sent_at_s()))
    return with_sequence(refuse(ErrorCode::kNotFinite, "sent_at_s", fmt::format("sent_at_s is {}.", message.sent_at_s()),
                                "Send the sender's clock in seconds, or 0."));
  const auto body = body_of(message);
  if (!body)
    return with_sequence(refuse(ErrorCode::kMalformed, "body", "The message has no body that this version knows.",
                                "Set one of StreamMessage's bodies, or bring the daemon up to date."));
  envelope.body_ = *body;
  envelope.sequence_ = message.sequence();
  envelope.sent_at_s_ = message.sent_at_s();
  envelope.bytes_ = bytes.size();
  return envelope;
}

std::optional<std::uint32_t> StreamEnvelope::sheet_id() const {
  switch (body_) {
    case Body::kFrame:
      return message_->frame().sheet_id();
    case Body::kTearTips:
      return message_->tear_tips().sheet_id();
    case Body::kSheet:
      return message_->sheet().sheet_id();
    default:
      return std::nullopt;
  }
}

std::optional<double> StreamEnvelope::time_s() const {
  switch (body_) {
    case Body::kFrame:
      return message_->frame().time_s();
    case Body::kTearTips:
      return message_->tear_tips().time_s();
    case Body::kScene:
      return message_->scene().time_s();
    case Body::kListener:
      return message_->listener().time_s();
    case Body::kAdvance:
      return message_->advance().time_s();
    default:
      return std::nullopt;
  }
}

std::string StreamEnvelope::serialized() const {
  return message_->SerializeAsString();
}

tl::expected<Announcement, Error> StreamEnvelope::announcement(const Limits& limits) const {
  assert(body_ == Body::kAnnouncement);
  const auto& sent = message_->announcement();
  const auto with_sequence = [this](Error error) {
    error.sequence = sequence_;
    return tl::unexpected(std::move(error));
  };
  if (sent.protocol_version() != kProtocolVersion)
    return with_sequence(refuse(ErrorCode::kProtocolVersion, "announcement.protocol_version",
                                fmt::format("The publisher speaks version {}, this daemon version {}.",
                                            sent.protocol_version(), kProtocolVersion),
                                "Bring the older of the two up to date.")
                             .value());
  if (const auto good = check_text(sent.name(), "announcement.name", limits); !good) return with_sequence(good.error());
  auto options = from_wire(sent.options(), "announcement.options", limits);
  if (!options) return with_sequence(options.error());
  return Announcement{.name = sent.name(), .options = std::move(*options)};
}

}  // namespace rustle::wire
