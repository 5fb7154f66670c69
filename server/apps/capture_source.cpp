#include "server/apps/capture_source.h"

#include <fmt/format.h>

#include <algorithm>

namespace rustle::apps {
namespace {

/// Of a topic "/SESSION/...".
std::string_view session_of(std::string_view topic) {
  if (topic.starts_with('/')) topic.remove_prefix(1);
  return topic.substr(0, topic.find('/'));
}

}  // namespace

tl::expected<CaptureSource, std::string> CaptureSource::open(const std::filesystem::path& file) {
  auto reader = capture::CaptureReader::open(file);
  if (!reader) return tl::unexpected(reader.error());
  CaptureSource source(std::move(*reader));
  std::error_code ignored;
  source.file_bytes_ = std::filesystem::file_size(file, ignored);
  source.options_.clock = session::Clock::kSimulation;
  std::optional<double> first_time;
  while (!first_time) {
    auto envelope = source.next_envelope();
    if (!envelope) break;
    if (envelope->body() == wire::StreamEnvelope::Body::kAnnouncement) {
      if (source.announced_) continue;
      auto announced = envelope->announcement();
      if (!announced) {
        source.note(announced.error());
        continue;
      }
      source.options_ = std::move(announced->options);
      source.announced_ = true;
      continue;
    }
    first_time = envelope->time_s();
    source.ahead_.push_back(std::move(*envelope));
  }
  if (source.ahead_.empty()) {
    return tl::unexpected(fmt::format("{}: holds no frames{}; make a capture with `rustle import`", file.string(),
                                      source.recovery().complete ? "" : " before its damage: " + source.recovery().what));
  }
  if (!source.announced_) source.options_.time_origin_s = first_time.value_or(0);
  source.decoder_.emplace(source.options_);
  return source;
}

std::optional<wire::StreamEnvelope> CaptureSource::next_envelope() {
  while (auto record = reader_.next()) {
    if (record->kind != capture::Kind::kStreamMessage) continue;
    auto envelope = wire::StreamEnvelope::parse(std::as_bytes(std::span(record->bytes)), session_of(record->topic));
    if (!envelope) {
      note(envelope.error());
      continue;
    }
    if (session_id_.empty()) session_id_ = envelope->session_id();
    if (envelope->session_id() == session_id_) return std::move(*envelope);
  }
  return std::nullopt;
}

std::optional<engine::StreamItem> CaptureSource::next() {
  for (;;) {
    std::optional<wire::StreamEnvelope> envelope;
    if (!ahead_.empty()) {
      envelope = std::move(ahead_.front());
      ahead_.pop_front();
    } else {
      envelope = next_envelope();
    }
    if (!envelope) return std::nullopt;
    auto decoded = decoder_->decode(*envelope);
    if (!decoded) {
      note(decoded.error());
      continue;
    }
    if (!decoded->item) continue;
    if (const auto* frame = std::get_if<sheet::MeshFrame>(&*decoded->item)) {
      if (frames_ == 0) first_time_s_ = frame->time_s;
      newest_time_s_ = std::max(frames_ == 0 ? frame->time_s : newest_time_s_, frame->time_s);
      ++frames_;
    }
    return std::move(decoded->item);
  }
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
