#include <fmt/format.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <chrono>
#include <cstdint>
#include <map>
#include <memory>
#include <string>
#include <thread>

#include "server/apps/command.h"
#include "server/apps/figures_client.h"

namespace rustle::apps {
namespace {

using Json = nlohmann::ordered_json;

struct TopArguments {
  std::string http = kDefaultHttp;
  double interval_s = 1;
  bool once = false, json = false;
};

struct Reading {
  Json told;
  std::chrono::steady_clock::time_point at;
};

std::uint64_t dropped_of(const Json& figures) {
  std::uint64_t sum = 0;
  for (const auto& [cause, frames] : figures.at("frames_dropped").items()) sum += frames.get<std::uint64_t>();
  return sum;
}

std::map<std::string, const Json*> by_session(const Json& told) {
  std::map<std::string, const Json*> out;
  for (const auto& session : told.at("sessions")) out[session.at("session_id").get<std::string>()] = &session;
  return out;
}

std::string fitted(std::string text, std::size_t width) {
  if (text.size() > width) text = text.substr(0, width - 1) + "~";
  return fmt::format("{:<{}}", text, width);
}

/// One screen: what is, and per second what has happened since `before`.
std::string screen_of(const Reading& before, const Reading& now) {
  const double lapse_s = std::chrono::duration<double>(now.at - before.at).count();
  const Json& told = now.told;
  const Json& totals = told.at("totals");
  const double cpu = (told.at("cpu_s").get<double>() - before.told.at("cpu_s").get<double>()) / lapse_s;
  std::string out = fmt::format("rustled {}, up {:.0f} s, {:.1f} % of a processor, {:.0f} MB; {} of {} sessions\n",
                                told.at("version").get<std::string>(), told.at("up_s").get<double>(), 100 * cpu,
                                told.at("resident_bytes").get<double>() / 1e6, told.at("sessions").size(),
                                told.at("sessions_limit").get<std::uint64_t>());
  out += fmt::format(
      "since its start: {} frames, {} analysed, {} dropped; blocks late by own time {}, by waiting for a processor {}; gaps "
      "in "
      "input {}, in PCM {}\n\n",
      totals.at("frames_received").get<std::uint64_t>(), totals.at("frames_analysed").get<std::uint64_t>(),
      dropped_of(totals), totals.at("deadline_misses").get<std::uint64_t>(),
      totals.at("late_by_run_delay").get<std::uint64_t>(), totals.at("input_gaps").get<std::uint64_t>(),
      totals.at("pcm_gaps").get<std::uint64_t>());
  out += fmt::format("{} {:<10} {:>6} {:>8} {:>7} {:>7} {:>8} {:>6} {:>8} {:>9} {:>5} {:>5} {:>5}\n", fitted("session", 24),
                     "clock", "sheets", "frames/s", "dropped", "waiting", "events/s", "voices", "delay ms", "drift ppm",
                     "gaps", "late", "level");
  const auto earlier = by_session(before.told);
  for (const auto& session : told.at("sessions")) {
    const auto whole = [&](const char* name) { return session.at(name).get<std::uint64_t>(); };
    const auto id = session.at("session_id").get<std::string>();
    const auto met = earlier.find(id);
    const auto rate = [&](std::initializer_list<const char*> names) {
      double sum = 0;
      for (const char* name : names) {
        sum += session.at(name).get<double>();
        if (met != earlier.end()) sum -= met->second->at(name).get<double>();
      }
      return sum / lapse_s;
    };
    out += fmt::format("{} {:<10} {:>6} {:>8.1f} {:>7} {:>7} {:>8.1f} {:>6} {:>8.1f} {:>9.1f} {:>5} {:>5} {:>5}\n",
                       fitted(id, 24), session.at("ended").get<bool>() ? "ended" : session.at("clock").get<std::string>(),
                       whole("sheets"), rate({"frames_analysed"}), dropped_of(session), whole("frames_waiting"),
                       rate({"crumpling_events", "friction_episodes", "tear_events"}), whole("voices"),
                       1000 * session.at("playout_delay_s").get<double>(), session.at("clock_drift_ppm").get<double>(),
                       whole("input_gaps") + whole("pcm_gaps"), whole("deadline_misses") + whole("late_by_run_delay"),
                       whole("load_level"));
  }
  return out;
}

int run(const TopArguments& arguments) {
  const auto read = [&]() -> tl::expected<Reading, std::string> {
    auto told = ask_daemon(arguments.http, "/figures");
    if (!told) return tl::unexpected(told.error());
    return Reading{std::move(*told), std::chrono::steady_clock::now()};
  };
  catch_interrupts();
  auto before = read();
  if (!before) return complain(before.error(), kFailed);
  const bool on_terminal = isatty(STDOUT_FILENO) != 0 && !arguments.json && !arguments.once;
  if (arguments.json) fmt::print("{}\n", before->told.dump());
  if (arguments.json && arguments.once) return kDone;
  while (true) {
    const auto next = before->at + std::chrono::duration_cast<std::chrono::steady_clock::duration>(
                                       std::chrono::duration<double>(arguments.interval_s));
    while (!interrupted() && std::chrono::steady_clock::now() < next)
      std::this_thread::sleep_for(std::min<std::chrono::steady_clock::duration>(std::chrono::milliseconds(50),
                                                                                next - std::chrono::steady_clock::now()));
    if (interrupted()) return kDone;
    auto now = read();
    if (!now) return complain(now.error(), kFailed);
    if (arguments.json) {
      fmt::print("{}\n", now->told.dump());
    } else {
      fmt::print("{}{}", on_terminal ? "\033[H\033[J" : "", screen_of(*before, *now));
      if (!on_terminal && !arguments.once) fmt::print("\n");
    }
    std::fflush(stdout);
    if (arguments.once) return kDone;
    before = std::move(now);
  }
}

}  // namespace

void add_top(CLI::App& app, Action& action) {
  auto arguments = std::make_shared<TopArguments>();
  auto* command = app.add_subcommand("top", "A daemon's sessions with their figures, again and again");
  command->footer(
      "Example: rustle top\n"
      "         rustle top --once --json\n"
      "Ends on Ctrl-C. \"late\": blocks of sound rendered late by more than a PCM message.");
  command->add_option("--http", arguments->http, "The daemon's HTTP address")->capture_default_str();
  command->add_option("--interval", arguments->interval_s, "Seconds between two looks, over which rates are taken")
      ->check(CLI::Range(0.1, 3600.0))
      ->capture_default_str();
  command->add_flag("--once", arguments->once, "One look, then end");
  command->add_flag("--json", arguments->json, "Print all that the daemon tells, a line a look");
  command->callback([arguments, &action] { action = [arguments] { return run(*arguments); }; });
}

}  // namespace rustle::apps
