#include <fmt/format.h>
#include <sys/resource.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "client_sdk/sheets/loops.h"
#include "server/apps/command.h"
#include "server/apps/daemon_address.h"
#include "server/apps/load.h"
#include "server/apps/own_daemon.h"
#include "server/apps/wording.h"
#include "server/session/worker_thread.h"

namespace rustle::apps {
namespace {

using Json = nlohmann::ordered_json;

constexpr double kRampPrecision = 0.05;  // of the sessions that are found
constexpr std::size_t kMostSessions = 4096;
constexpr double kBeforeSurge_s = 1;  // before a surge that has no time of its own: a third of the run, at least this

struct LoadArguments {
  LoadOptions load;
  DaemonAddress daemon{.control = "", .keys = ""};  ///< without a control endpoint one is started
  std::string daemon_cpus, surge;
  std::optional<double> seconds;
  double jitter_ms = 0, delay_ms = 40;
  std::size_t heavy_sessions = 0;
  double heavy_frames_per_s = 600;
  std::size_t heavy_triangles = 100'000;
  bool ramp = false, json = false;
};

/// "TIMES:FROM:TO" in seconds, or "TIMES": the middle third of the run.
tl::expected<LoadSurge, std::string> parse_surge(const std::string& text, double seconds) {
  LoadSurge surge{2, std::max(kBeforeSurge_s, seconds / 3), 2 * seconds / 3};
  double times = 0, from_s = 0, to_s = 0;
  char rest = 0;
  const int read = std::sscanf(text.c_str(), "%lf:%lf:%lf%c", &times, &from_s, &to_s, &rest);
  if (read == 3) surge = {times, from_s, to_s};
  if (read == 1) surge.times = times;
  if ((read != 1 && read != 3) || !(surge.times > 0) || !(surge.from_s >= 0) || !(surge.to_s > surge.from_s))
    return tl::unexpected(fmt::format("--surge \"{}\": say TIMES or TIMES:FROM:TO, as in 2:10:20", text));
  return surge;
}

/// A client holds about ten descriptors.
void raise_descriptor_limit() {
  rlimit limit{};
  if (::getrlimit(RLIMIT_NOFILE, &limit) != 0) return;
  limit.rlim_cur = limit.rlim_max;
  ::setrlimit(RLIMIT_NOFILE, &limit);
}

Json json_of(const CrowdFigures& crowd) {
  return {{"sessions", crowd.sessions},
          {"frames_sent", crowd.frames_sent},
          {"frames_received", crowd.frames_received},
          {"frames_analysed", crowd.frames_analysed},
          {"dropped", Json(crowd.dropped)},
          {"deadline_misses", crowd.deadline_misses},
          {"late_by_run_delay", crowd.late_by_run_delay},
          {"pcm_gaps", crowd.pcm_gaps},
          {"latency_ms", {{"p50", crowd.latency.p50_ms}, {"p99", crowd.latency.p99_ms}, {"p999", crowd.latency.p999_ms}}},
          {"clients_late_ms", {{"p99", crowd.send_late_p99_ms}}},
          {"longest_silence_s", crowd.longest_silence_s},
          {"sums_exact", crowd.sums_exact}};
}

Json json_of(const LoadFigures& figures, const LoadOptions& options) {
  Json out = json_of(figures.crowd);
  out["cpu_s_per_session_s"] = figures.cpu_s_per_session_s;
  out["fps"] = options.crowd.frames_per_s;
  out["triangles"] = options.crowd.triangles;
  out["seconds"] = figures.seconds;
  out["playout_delay_ms"] = 1e3 * std::max(options.playout_delay_s, figures.crowd.playout_delay_s);
  out["vanished"] = figures.vanished;
  out["refused"] = figures.refused;
  out["load_level_most"] = figures.load_level_most;
  if (options.surge)
    out["full_quality_after_s"] = figures.full_quality_after_s ? Json(*figures.full_quality_after_s) : Json();
  if (figures.heavy) out["heavy"] = json_of(*figures.heavy);
  out["sustained"] = sustained(figures, options);
  return out;
}

void tell(const CrowdFigures& crowd, const std::string& of) {
  std::string dropped;
  for (const auto& [cause, count] : crowd.dropped)
    dropped += fmt::format("{}{} {}", dropped.empty() ? "" : ", ", count, cause);
  fmt::print("{}{}: {} frames sent, {} analysed, dropped: {}{}\n", of, counted(crowd.sessions, "session"), crowd.frames_sent,
             crowd.frames_analysed, dropped.empty() ? "none" : dropped,
             crowd.sums_exact ? "" : "; these sums do not add up");
  fmt::print("  a frame is heard {:.1f} ms after it is sent (p50), {:.1f} (p99), {:.1f} (p99.9)\n", crowd.latency.p50_ms,
             crowd.latency.p99_ms, crowd.latency.p999_ms);
  fmt::print("  blocks late by the daemon's own time: {}, by waiting for a processor: {}; gaps in the sound: {}\n",
             crowd.deadline_misses, crowd.late_by_run_delay, crowd.pcm_gaps);
}

void tell(const LoadFigures& figures, const LoadOptions& options) {
  tell(figures.crowd, "");
  if (figures.heavy) tell(*figures.heavy, "heavy ones: ");
  fmt::print("  the daemon takes {:.5f} s of a processor per second and session: a core carries {:.0f}\n",
             figures.cpu_s_per_session_s, 1 / std::max(1e-9, figures.cpu_s_per_session_s));
  if (figures.refused > 0) fmt::print("  {} refused\n", counted(figures.refused, "attachment"));
  if (figures.load_level_most > 0) fmt::print("  load level {} at the most\n", figures.load_level_most);
  if (options.surge && figures.full_quality_after_s)
    fmt::print("  full quality again {:.1f} s after the surge\n", *figures.full_quality_after_s);
  if (figures.crowd.send_late_p99_ms > 5)
    fmt::print("  the clients themselves were late by {:.1f} ms (p99): this machine has no time left for them\n",
               figures.crowd.send_late_p99_ms);
}

tl::expected<LoadFigures, std::string> play(const client::Connection& connection, const LoadOptions& options,
                                            const std::string& what) {
  Progress progress(what);
  return run_load(connection, options, [&](double share) { progress.show(share); });
}

/// Doubles the sessions until the machine no longer carries them, then looks between.
int ramp(const client::Connection& connection, LoadOptions options, bool json) {
  Json steps = Json::array();
  std::size_t carried = 0, too_many = 0;
  for (std::size_t sessions = options.crowd.sessions; !interrupted();) {
    options.crowd.sessions = sessions;
    const auto figures = play(connection, options, fmt::format("{} sessions", sessions));
    if (!figures) return complain(figures.error(), kFailed);
    const bool held = sustained(*figures, options);
    (held ? carried : too_many) = sessions;
    if (json) {
      steps.push_back(json_of(*figures, options));
    } else {
      fmt::print("{:>5} sessions {}: {:.1f} ms (p99), {} late by own time, {} by waiting, {} gaps, {:.5f} s/s each\n",
                 sessions, held ? "held    " : "too many", figures->crowd.latency.p99_ms, figures->crowd.deadline_misses,
                 figures->crowd.late_by_run_delay, figures->crowd.pcm_gaps, figures->cpu_s_per_session_s);
      std::fflush(stdout);
    }
    const auto step = static_cast<std::size_t>(std::max(1.0, kRampPrecision * static_cast<double>(carried)));
    if (too_many == 0) {
      if (sessions == kMostSessions) break;
      sessions = std::min(2 * sessions, kMostSessions);
    } else if (too_many - carried > step && too_many > 1) {
      sessions = (carried + too_many) / 2;
    } else {
      break;
    }
  }
  if (json) {
    fmt::print("{}\n", Json{{"carried", carried}, {"steps", steps}}.dump());
  } else {
    fmt::print("carried: {}\n", counted(carried, "session"));
  }
  return carried > 0 ? kDone : kFailed;
}

int run(LoadArguments arguments) {
  LoadOptions& options = arguments.load;
  options.jitter_s = arguments.jitter_ms / 1e3;
  options.playout_delay_s = arguments.delay_ms / 1e3;
  options.seconds = arguments.seconds.value_or(arguments.ramp ? 10 : 30);
  const auto names = sheets::loop_names();
  for (const std::string& sheet : options.crowd.sheets) {
    if (std::find(names.begin(), names.end(), sheet) != names.end()) continue;
    std::string known;
    for (const auto name : names) known += " " + std::string(name);
    return complain(fmt::format("--sheets: there is no \"{}\"; there are:{}", sheet, known), kWrongUsage);
  }
  if (!arguments.surge.empty()) {
    const auto surge = parse_surge(arguments.surge, options.seconds);
    if (!surge) return complain(surge.error(), kWrongUsage);
    options.surge = *surge;
  }
  if (arguments.heavy_sessions > 0) {
    options.heavy = options.crowd;
    options.heavy->sessions = arguments.heavy_sessions;
    options.heavy->frames_per_s = arguments.heavy_frames_per_s;
    options.heavy->triangles = arguments.heavy_triangles;
  }
  catch_interrupts();
  raise_descriptor_limit();
  std::optional<OwnDaemon> own;
  if (arguments.daemon.control.empty()) {
    OwnDaemon::Options wanted;
    wanted.max_sessions = arguments.ramp ? kMostSessions : options.crowd.sessions + arguments.heavy_sessions + 16;
    if (!arguments.daemon_cpus.empty()) {
      const auto cpus = session::parse_cpus(arguments.daemon_cpus);
      if (!cpus) return complain("--daemon-cpus: " + cpus.error(), kWrongUsage);
      wanted.cpus = *cpus;
    }
    auto started = OwnDaemon::start(wanted);
    if (!started) return complain(started.error(), kFailed);
    own.emplace(std::move(*started));
    arguments.daemon = {.control = own->control(), .keys = ""};
  } else if (!arguments.daemon_cpus.empty()) {
    return complain("--daemon-cpus is for the daemon that is started here; leave --control out", kWrongUsage);
  }
  const auto connection = connect_to(arguments.daemon);
  if (!connection) return complain(client::to_string(connection.error()), kFailed);
  if (arguments.ramp) return ramp(*connection, options, arguments.json);
  const auto figures = play(*connection, options, fmt::format("{} sessions", options.crowd.sessions));
  if (!figures) return complain(figures.error(), kFailed);
  if (arguments.json) {
    fmt::print("{}\n", json_of(*figures, options).dump());
  } else {
    tell(*figures, options);
  }
  const bool exact = figures->crowd.sums_exact && (!figures->heavy || figures->heavy->sums_exact);
  return exact && figures->crowd.sessions > 0 ? kDone : kFailed;
}

}  // namespace

void add_load(CLI::App& app, Action& action) {
  auto arguments = std::make_shared<LoadArguments>();
  LoadOptions& load = arguments->load;
  auto* command = app.add_subcommand("load", "Synthetic clients over real sockets: how many sheets a daemon carries");
  command->footer(
      "Example: rustle load --sessions 50 --fps 60 --triangles 1333 --seconds 30\n"
      "         rustle load --ramp\n"
      "         rustle load --sessions 15 --heavy 1 --json\n"
      "         rustle load --kind tear --sessions 8\n"
      "         rustle load --kind cloth --sessions 8\n"
      "Every client is a live session with a sheet that sounds all the time, and listens to its sound. Without\n"
      "--control a daemon is started for it. Latencies are from frame() to the PCM message in which its moment sounds,\n"
      "playout delay included. Status 0 when every frame is accounted for.");
  std::string names;
  for (const auto known : sheets::loop_names()) names += (names.empty() ? "" : ", ") + std::string(known);
  command->add_option("--sessions", load.crowd.sessions, "How many; with --ramp, to begin with")
      ->check(CLI::Range(std::size_t{1}, kMostSessions))
      ->capture_default_str();
  command->add_option("--fps", load.crowd.frames_per_s, "Frames a second of each")
      ->check(CLI::Range(1.0, 10'000.0))
      ->capture_default_str();
  command->add_option("--triangles", load.crowd.triangles, "Of each sheet")
      ->check(CLI::Range(50, 1'000'000))
      ->capture_default_str();
  command->add_option("--seconds", arguments->seconds, "How long, after a second of warming up [30, with --ramp 10]")
      ->check(CLI::Range(1.0, 1e6));
  command->add_option("--sheets,--kind", load.crowd.sheets, "What they do, one after another: " + names + " [crumple,slide]")
      ->delimiter(',');
  command->add_option("--material", load.material, "Of every sheet");
  command->add_option("--jitter-ms", arguments->jitter_ms, "Frames are sent up to so much late")
      ->check(CLI::Range(0.0, 10'000.0))
      ->capture_default_str();
  command->add_option("--withheld", load.withheld, "Share of frames that are never sent")
      ->check(CLI::Range(0.0, 0.99))
      ->capture_default_str();
  command->add_option("--delay-ms", arguments->delay_ms, "Playout delay of the sessions; 0: the daemon's choice")
      ->check(CLI::Range(0.0, 10'000.0))
      ->capture_default_str();
  command->add_option("--blocks", load.blocks, "Blocks in a PCM message")->check(CLI::Range(1, 4))->capture_default_str();
  command->add_option("--vanish-every", load.vanish_every_s, "Seconds until a client is gone without a word; another comes")
      ->check(CLI::Range(0.0, 1e6))
      ->capture_default_str();
  command->add_option("--surge", arguments->surge,
                      "So many times the frames and events for a while: TIMES or TIMES:FROM:TO");
  command->add_option("--heavy", arguments->heavy_sessions, "Sessions beside them that ask for more than is theirs")
      ->check(CLI::Range(std::size_t{0}, std::size_t{64}))
      ->capture_default_str();
  command->add_option("--heavy-fps", arguments->heavy_frames_per_s, "Frames a second of those")
      ->check(CLI::Range(1.0, 10'000.0))
      ->capture_default_str();
  command->add_option("--heavy-triangles", arguments->heavy_triangles, "Of their sheets")
      ->check(CLI::Range(50, 1'000'000))
      ->capture_default_str();
  command->add_flag("--ramp", arguments->ramp, "Doubles the sessions until they are too many, and finds how many are not");
  add_daemon_options(*command, arguments->daemon);
  command->add_option("--daemon-cpus", arguments->daemon_cpus, "Processors that the daemon started here may use, such as 0");
  command->add_option("--seed", load.seed, "Seed of everything random")->capture_default_str();
  command->add_flag("--json", arguments->json, "Print the figures as JSON");
  command->callback([arguments, &action] { action = [arguments] { return run(*arguments); }; });
}

}  // namespace rustle::apps
