#include "server/monitor/json.h"

#include <algorithm>
#include <array>
#include <nlohmann/json.hpp>
#include <string_view>
#include <vector>

namespace rustle::monitor {
namespace {

using Json = nlohmann::ordered_json;

/// What does not count up: of one session only.
constexpr std::array kStates = {"voices",          "voices_most",     "newest_time_s", "rendered_time_s",
                                "playout_delay_s", "clock_drift_ppm", "load_level"};

Json statistics_of(const wire::Statistics& from, bool sums_only) {
  Json out;
  out["frames_dropped"] = Json::object();
  for (const auto& [cause, frames] : from.frames_dropped) out["frames_dropped"][cause] = frames;
  for (const auto& [name, value] : wire::numbers_of(from)) {
    if (sums_only && std::find(kStates.begin(), kStates.end(), std::string_view(name)) != kStates.end()) continue;
    std::visit([&](auto number) { out[name] = number; }, value);
  }
  return out;
}

Json frame_of(const session::FrameTrace& trace, bool live, std::chrono::duration<double> unix_origin) {
  using Milliseconds = std::chrono::duration<double, std::milli>;
  using session::Station;
  const auto received = trace.at(Station::kReceived);
  const auto since_receipt = [&](Station station) -> Json {
    if (trace.at(station).count() == 0) return nullptr;
    return Milliseconds(trace.at(station) - received).count();
  };
  Json out;
  out["frame"] = trace.frame;
  out["sequence"] = trace.sequence;
  out["sheet"] = trace.sheet;
  out["time_s"] = trace.time_s;
  out["received_unix_s"] = std::chrono::duration<double>(unix_origin + received).count();
  out["decoded_ms"] = since_receipt(Station::kDecoded);
  out["begun_ms"] = since_receipt(Station::kBegun);
  out["analysed_ms"] = since_receipt(Station::kAnalysed);
  out["accepted_ms"] = since_receipt(Station::kAccepted);
  out["sent_ms"] = since_receipt(Station::kSent);
  out["first_sample"] = trace.first_sample >= 0 ? Json(trace.first_sample) : Json(nullptr);
  const bool placed = live && trace.at(Station::kAnalysed).count() != 0;
  out["playout_delay_ms"] = placed ? Json(1000 * trace.delay_s) : Json(nullptr);
  const bool heard = placed && trace.at(Station::kSent).count() != 0;
  out["beyond_delay_ms"] =
      heard ? Json(Milliseconds(trace.at(Station::kSent) - received).count() - 1000 * trace.delay_s) : Json(nullptr);
  out["dropped"] = trace.dropped != nullptr ? Json(trace.dropped) : Json(nullptr);
  return out;
}

}  // namespace

std::string figures_json(const DaemonFigures& daemon, const ProcessFigures& process) {
  const Totals all = daemon.totals();
  Json threads = Json::object();
  for (const auto& [name, figures] : process.threads)
    threads[name] = {{"threads", figures.count}, {"cpu_s", figures.running_s}, {"run_delay_s", figures.waiting_s}};
  Json out;
  out["version"] = daemon.version;
  out["up_s"] = daemon.up_s;
  out["cpu_s"] = process.cpu_s;
  out["resident_bytes"] = process.resident_bytes;
  out["threads"] = threads;
  out["sessions_limit"] = daemon.sessions_most;
  out["sessions_total"] = all.sessions;
  out["totals"] = statistics_of(all.statistics, true);
  if (daemon.fleet) {
    const FleetFigures& fleet = *daemon.fleet;
    Json& told = out["fleet"];
    told = {{"sidecar_up", fleet.reachable}, {"game_server", fleet.game_server},
            {"state", fleet.state},          {"address", fleet.address},
            {"ports", fleet.ports},          {"requests", Json::object()}};
    for (const auto& [what, times] : fleet.asked) told["requests"][what.first][what.second] = times;
  }
  if (daemon.page)
    out["page"] = {{"viewers", daemon.page->viewers},
                   {"viewers_refused", daemon.page->viewers_refused},
                   {"frames_taken", daemon.page->frames_taken},
                   {"messages_lost", daemon.page->messages_lost}};
  out["sessions"] = Json::array();
  for (const auto& session : daemon.sessions) {
    Json each;
    each["session_id"] = session.statistics.session_id;
    each["name"] = session.name;
    each["clock"] = session.live ? "live" : "simulation";
    each["ended"] = session.ended;
    each["rate_hz"] = session.rate_hz;
    each["sheets"] = session.sheets;
    each["frames_waiting"] = session.frames_waiting;
    each["behind_s"] = session.behind_s;
    each.update(statistics_of(session.statistics, false));
    out["sessions"].push_back(std::move(each));
  }
  return out.dump(-1, ' ', false, Json::error_handler_t::replace);
}

std::string trace_json(const SessionTraces& traces, const TraceChoice& choice, std::chrono::duration<double> unix_now) {
  std::vector<const session::FrameTrace*> chosen;
  for (const auto& trace : traces.frames) {
    if (choice.frame && trace.frame != *choice.frame) continue;
    if (choice.sequence && trace.sequence != *choice.sequence) continue;
    chosen.push_back(&trace);
  }
  const std::size_t begin = chosen.size() - std::min(chosen.size(), choice.newest);
  const auto unix_origin = unix_now - std::chrono::nanoseconds(traces.clock_ns);
  Json out;
  out["session_id"] = traces.session;
  out["clock"] = traces.live ? "live" : "simulation";
  out["frames"] = Json::array();
  for (std::size_t k = begin; k < chosen.size(); ++k)
    out["frames"].push_back(frame_of(*chosen[k], traces.live, unix_origin));
  return out.dump(-1, ' ', false, Json::error_handler_t::replace);
}

}  // namespace rustle::monitor
