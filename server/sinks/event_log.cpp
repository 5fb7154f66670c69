#include "server/sinks/event_log.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>

namespace rustle::sinks {
namespace {

constexpr double kSlidingSpeed = 1e-3;

/// Rounded to what a reader needs, so that lines stay short and equal runs give equal text.
double rounded(double value, double step) {
  const double per_unit = std::round(1 / step);
  return std::isfinite(value) ? std::round(value * per_unit) / per_unit : 0.0;
}

nlohmann::json json_of(const sheet::Vec3d& v, double step) {
  return nlohmann::json::array({rounded(v.x(), step), rounded(v.y(), step), rounded(v.z(), step)});
}

nlohmann::ordered_json json_of(const observation::Resonator& r) {
  return {{"constrained", r.constrained},
          {"coarse", r.coarse},
          {"l_r_m", rounded(r.ruling_length_m, 1e-6)},
          {"l_c_m", rounded(r.free_border_length_m, 1e-6)},
          {"area_m2", rounded(r.area_m2, 1e-9)},
          {"position_m", json_of(r.position_m, 1e-6)},
          {"normal", json_of(r.normal, 1e-6)}};
}

}  // namespace

const char* name_of(LoggedEvent::Kind kind) {
  switch (kind) {
    case LoggedEvent::Kind::kFriction:
      return "friction";
    case LoggedEvent::Kind::kTearing:
      return "tearing";
    case LoggedEvent::Kind::kCrumpling:
      break;
  }
  return "crumpling";
}

void EventLog::add(const observation::Observation& observed) {
  for (const auto& event : observed.crumpling) {
    LoggedEvent line;
    line.id = event.id;
    line.time_s = event.time_s;
    line.end_s = event.confirmed_s;
    line.sheet = observed.sheet;
    line.continues = event.continues;
    line.amplitude = event.amplitude_m;
    line.area_m2 = event.area_m2;
    line.position_m = event.position_m;
    line.vertices = event.vertices;
    line.source = event.source;
    line.speed_m_per_s = event.velocity_m_per_s.norm();
    if (line.speed_m_per_s > 0) line.direction = event.velocity_m_per_s / line.speed_m_per_s;
    line.resonators = event.resonators;
    events_.push_back(std::move(line));
  }
  for (const auto& contact : observed.friction) {
    LoggedEvent now;
    now.id = contact.id;
    now.kind = LoggedEvent::Kind::kFriction;
    now.area_m2 = contact.area_m2;
    now.position_m = contact.position_m;
    for (const auto& vertex : contact.vertices) now.vertices.push_back(vertex.vertex);
    now.source = contact.source;
    now.speed_m_per_s = contact.speed_m_per_s;
    now.direction = contact.direction;
    now.resonators = contact.resonators;
    follow(friction_, observed, std::move(now));
  }
  for (const auto& tear : observed.tears) {
    LoggedEvent now;
    now.id = tear.id;
    now.kind = LoggedEvent::Kind::kTearing;
    now.position_m = tear.position_m;
    now.source = tear.source;
    now.speed_m_per_s = tear.speed_m_per_s;
    now.direction = tear.direction;
    now.torn_m = tear.torn_m;
    if (tear.vertex != sheet::kNone) now.vertices = {tear.vertex};
    now.resonators = tear.resonators;
    follow(tears_, observed, std::move(now));
  }
  retire(friction_, observed);
  retire(tears_, observed);
}

void EventLog::follow(std::map<EpisodeKey, Episode>& episodes, const observation::Observation& observed, LoggedEvent now) {
  now.sheet = observed.sheet;
  auto [place, fresh] = episodes.try_emplace({observed.sheet, now.id});
  Episode& episode = place->second;
  const double speed = now.speed_m_per_s;
  const double began = fresh ? observed.previous_time_s : episode.event.time_s;
  episode.speed_seconds += speed * (observed.time_s - observed.previous_time_s);
  auto speeds = std::move(episode.event.speeds);
  speeds.push_back({observed.time_s, speed, now.position_m});
  const double torn_m = now.torn_m;
  if (fresh || speed > episode.event.speed_m_per_s) episode.event = std::move(now);
  episode.event.torn_m = torn_m;
  episode.event.speeds = std::move(speeds);
  episode.event.time_s = began;
  episode.last_s = observed.time_s;
  episode.slid |= speed > kSlidingSpeed;
}

void EventLog::retire(std::map<EpisodeKey, Episode>& episodes, const observation::Observation& observed) {
  for (auto at = episodes.begin(); at != episodes.end();) {
    if (at->first.first == observed.sheet && at->second.last_s < observed.time_s) {
      close(at->second);
      at = episodes.erase(at);
    } else {
      ++at;
    }
  }
}

void EventLog::close(Episode& episode) {
  if (!episode.slid) return;
  LoggedEvent& event = episode.event;
  event.end_s = episode.last_s;
  const double seconds = event.end_s - event.time_s;
  event.amplitude = seconds > 0 ? episode.speed_seconds / seconds : event.speed_m_per_s;
  events_.push_back(std::move(event));
}

std::vector<LoggedEvent> EventLog::finish() {
  for (auto* episodes : {&friction_, &tears_}) {
    for (auto& [key, episode] : *episodes) close(episode);
    episodes->clear();
  }
  std::stable_sort(events_.begin(), events_.end(), [](const LoggedEvent& a, const LoggedEvent& b) {
    return std::pair(a.time_s, a.id) < std::pair(b.time_s, b.id);
  });
  return std::move(events_);
}

std::string json_line(const LoggedEvent& event) {
  nlohmann::ordered_json resonators = nlohmann::ordered_json::array();
  for (const auto& resonator : event.resonators) resonators.push_back(json_of(resonator));
  nlohmann::ordered_json line = {{"id", event.id},
                                 {"time_s", rounded(event.time_s, 1e-6)},
                                 {"end_s", rounded(event.end_s, 1e-6)},
                                 {"sheet", event.sheet},
                                 {"kind", name_of(event.kind)},
                                 {"continues", event.continues == 0 ? nlohmann::json() : nlohmann::json(event.continues)},
                                 {"amplitude", rounded(event.amplitude, 1e-9)},
                                 {"amplitude_unit", event.kind == LoggedEvent::Kind::kCrumpling ? "m" : "m/s"},
                                 {"area_m2", rounded(event.area_m2, 1e-9)},
                                 {"position_m", json_of(event.position_m, 1e-6)},
                                 {"vertices", event.vertices},
                                 {"source", event.source == observation::Source::kSent ? "sent" : "detected"},
                                 {"speed_m_per_s", rounded(event.speed_m_per_s, 1e-6)},
                                 {"direction", json_of(event.direction, 1e-6)},
                                 {"resonators", std::move(resonators)}};
  if (event.kind == LoggedEvent::Kind::kTearing) {
    line["torn_m"] = rounded(event.torn_m, 1e-6);
    line["track"] = nlohmann::ordered_json::array();
    for (const auto& now : event.speeds) {
      const auto& p = now.position_m;
      line["track"].push_back({rounded(now.time_s, 1e-6), rounded(now.speed_m_per_s, 1e-6), rounded(p.x(), 1e-6),
                               rounded(p.y(), 1e-6), rounded(p.z(), 1e-6)});
    }
  }
  return line.dump();
}

tl::expected<void, std::string> write_json_lines(const std::filesystem::path& file, const std::vector<LoggedEvent>& events) {
  std::ofstream out(file);
  for (const auto& event : events) out << json_line(event) << '\n';
  out.close();
  if (!out)
    return tl::unexpected(fmt::format("{}: cannot be written; choose a folder that exists and has room", file.string()));
  return {};
}

}  // namespace rustle::sinks
