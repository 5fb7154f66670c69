#include "server/apps/capture_source.h"

#include <fmt/format.h>

#include <algorithm>

#include "server/wire/decisions.h"

namespace rustle::apps {

std::string_view session_of(std::string_view topic) {
  if (topic.starts_with('/')) topic.remove_prefix(1);
  return topic.substr(0, topic.find('/'));
}

tl::expected<CaptureSource, std::string> CaptureSource::open(const std::filesystem::path& file) {
  auto reader = capture::CaptureReader::open(file);
  if (!reader) return tl::unexpected(reader.error());
  CaptureSource source(std::move(*reader));
  std::error_code ignored;
  source.file_bytes_ = std::filesystem::file_size(file, ignored);
  source.options_.clock = session::Clock::kSimulation;
  std::optional<double> first_time;
  bool any_message = false;
  while (!first_time) {
    auto entry = source.read_entry();
    if (!entry) break;
    if (const auto* message = std::get_if<Message>(&*entry)) {
      const auto& envelope = message->envelope;
      if (envelope.body() == wire::StreamEnvelope::Body::kAnnouncement) {
        if (source.announced_) continue;
        auto announced = envelope.announcement();
        if (!announced) {
          source.note(announced.error());
          continue;
        }
        source.options_ = std::move(announced->options);
        source.announced_ = true;
        continue;
      }
      any_message = true;
      first_time = envelope.time_s();
    }
    source.ahead_.push_back(std::move(*entry));
  }
  if (!any_message) {
    return tl::unexpected(fmt::format("{}: holds no frames{}; make a capture with `rustle import`", file.string(),
                                      source.recovery().complete ? "" : " before its damage: " + source.recovery().what));
  }
  if (!source.announced_) source.options_.time_origin_s = first_time.value_or(0);
  source.decoder_.emplace(source.options_);
  return source;
}

std::uint64_t CaptureSource::count_arrival() {
  if (state_to_come_ == 0) return next_arrival_++;
  --state_to_come_;
  return 0;
}

std::optional<session::Decision> CaptureSource::read_decision(const capture::CaptureRecord& record) {
  auto decision = wire::decode_decision(std::as_bytes(std::span(record.bytes)));
  if (!decision) {
    note(decision.error());
    return std::nullopt;
  }
  if (const auto* begun = std::get_if<session::RecordingBegun>(&*decision)) {
    begun_ = *begun;
    state_to_come_ = begun->state_messages;
    next_arrival_ = begun->first_arrival;
  }
  return std::move(*decision);
}

std::optional<CaptureSource::Entry> CaptureSource::read_entry() {
  while (auto record = reader_.next()) {
    const auto session = session_of(record->topic);
    if (record->kind == capture::Kind::kDecision) {
      if (session != session_id_) continue;
      if (auto decision = read_decision(*record)) return std::move(*decision);
      continue;
    }
    auto envelope = wire::StreamEnvelope::parse(std::as_bytes(std::span(record->bytes)), session);
    if (!envelope) {
      note(envelope.error());
      if (session == session_id_) count_arrival();
      continue;
    }
    if (session_id_.empty()) session_id_ = envelope->session_id();
    if (envelope->session_id() != session_id_) continue;
    return Message{count_arrival(), std::move(*envelope)};
  }
  return std::nullopt;
}

std::optional<CaptureSource::Record> CaptureSource::next_record() {
  std::optional<Entry> entry;
  if (!ahead_.empty()) {
    entry = std::move(ahead_.front());
    ahead_.pop_front();
  } else {
    entry = read_entry();
  }
  if (!entry) return std::nullopt;
  if (auto* decision = std::get_if<session::Decision>(&*entry)) return std::move(*decision);
  const auto& [arrival, envelope] = std::get<Message>(*entry);
  Arrived arrived{arrival, std::nullopt};
  auto decoded = decoder_->decode(envelope);
  if (!decoded) {
    note(decoded.error());
    return arrived;
  }
  if (!decoded->item) return arrived;
  if (const auto* frame = std::get_if<sheet::MeshFrame>(&*decoded->item)) {
    if (frames_ == 0) first_time_s_ = frame->time_s;
    newest_time_s_ = std::max(frames_ == 0 ? frame->time_s : newest_time_s_, frame->time_s);
    ++frames_;
  }
  arrived.item = std::move(decoded->item);
  return arrived;
}

std::optional<engine::StreamItem> CaptureSource::next() {
  while (auto record = next_record()) {
    auto* arrived = std::get_if<Arrived>(&*record);
    if (arrived != nullptr && arrived->item) return std::move(arrived->item);
  }
  return std::nullopt;
}

double CaptureSource::progress() const {
  return file_bytes_ == 0
             ? 0
             : std::min(1.0, static_cast<double>(reader_.recovery().bytes_read) / static_cast<double>(file_bytes_));
}

void CaptureSource::note(const wire::Error& error) {
  Refusals& refusals = refused_[std::string(wire::code_name(error.code))];
  if (refusals.count++ == 0) refusals.first = wire::to_string(error);
}

}  // namespace rustle::apps
