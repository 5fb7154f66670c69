#include "server/wire/topics.h"

#include <algorithm>
#include <charconv>
#include <vector>

#include <fmt/format.h>

namespace rustle::wire {
namespace {

std::string_view format_name(PcmFormat format) {
  switch (format) {
    case PcmFormat::kF32:
      return "f32";
    case PcmFormat::kS16:
      return "s16";
    case PcmFormat::kOpus:
      return "opus";
  }
  return "f32";
}

std::optional<PcmFormat> format_from_name(std::string_view name) {
  for (PcmFormat format : {PcmFormat::kF32, PcmFormat::kS16, PcmFormat::kOpus})
    if (name == format_name(format)) return format;
  return std::nullopt;
}

std::vector<std::string_view> split(std::string_view text) {
  std::vector<std::string_view> parts;
  while (true) {
    const std::size_t slash = text.find('/');
    parts.push_back(text.substr(0, slash));
    if (slash == std::string_view::npos) return parts;
    text.remove_prefix(slash + 1);
  }
}

std::string below(std::string_view session_id, std::string_view name) {
  return fmt::format("{}/{}", session_id, name);
}

}  // namespace

std::string_view kind_name(synthesis::SoundKind kind) {
  switch (kind) {
    case synthesis::SoundKind::kCrumpling:
      return "crumpling";
    case synthesis::SoundKind::kFriction:
      return "friction";
    case synthesis::SoundKind::kTearing:
      return "tearing";
  }
  return "crumpling";
}

std::optional<synthesis::SoundKind> kind_from_name(std::string_view name) {
  using synthesis::SoundKind;
  for (SoundKind kind : {SoundKind::kCrumpling, SoundKind::kFriction, SoundKind::kTearing})
    if (name == kind_name(kind)) return kind;
  return std::nullopt;
}

std::string to_string(const PcmTopic& topic) {
  const std::string_view format = format_name(topic.format);
  switch (topic.content) {
    case PcmContent::kMix:
      return fmt::format("{}/pcm/mix/{}/{}", topic.session_id, format, topic.blocks);
    case PcmContent::kEmitter:
      return fmt::format("{}/pcm/emitter/{}/{}", topic.session_id, format, topic.blocks);
    case PcmContent::kStem:
      return fmt::format("{}/pcm/stem/{}/{}/{}/{}", topic.session_id, topic.sheet_id, kind_name(topic.kind), format,
                         topic.blocks);
  }
  return {};
}

std::optional<PcmTopic> parse_pcm_topic(std::string_view text) {
  const std::vector<std::string_view> parts = split(text);
  if (parts.size() < 5 || parts[1] != "pcm" || !valid_session_id(parts[0])) return std::nullopt;
  PcmTopic topic;
  topic.session_id = parts[0];
  std::size_t next = 3;
  if (parts[2] == "mix") {
    topic.content = PcmContent::kMix;
  } else if (parts[2] == "emitter") {
    topic.content = PcmContent::kEmitter;
  } else if (parts[2] == "stem" && parts.size() == 7) {
    topic.content = PcmContent::kStem;
    const std::string_view sheet = parts[3];
    const auto [end, problem] = std::from_chars(sheet.data(), sheet.data() + sheet.size(), topic.sheet_id);
    const auto kind = kind_from_name(parts[4]);
    if (problem != std::errc() || end != sheet.data() + sheet.size() || !kind) return std::nullopt;
    topic.kind = *kind;
    next = 5;
  } else {
    return std::nullopt;
  }
  if (parts.size() != next + 2) return std::nullopt;
  const auto format = format_from_name(parts[next]);
  const std::string_view blocks = parts[next + 1];
  if (!format || blocks.size() != 1 || blocks[0] < '1' || blocks[0] > '4') return std::nullopt;
  topic.format = *format;
  topic.blocks = blocks[0] - '0';
  return topic;
}

std::string_view session_of_topic(std::string_view topic) {
  return topic.substr(0, topic.find('/'));
}

std::string observations_topic(std::string_view session_id) {
  return below(session_id, "observations");
}
std::string acknowledgements_topic(std::string_view session_id) {
  return below(session_id, "acknowledgements");
}
std::string notices_topic(std::string_view session_id) {
  return below(session_id, "notices");
}
std::string statistics_topic(std::string_view session_id) {
  return below(session_id, "statistics");
}

bool valid_session_id(std::string_view session_id) {
  if (session_id.empty() || session_id.size() > 128 || session_id == "subscribed") return false;
  if (session_id.front() == ' ' || session_id.back() == ' ') return false;
  return std::none_of(session_id.begin(), session_id.end(), [](char c) {
    const auto byte = static_cast<unsigned char>(c);
    return byte < 0x20 || byte == 0x7f || c == '/';
  });
}

}  // namespace rustle::wire
