#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>

#include "server/apps/command.h"
#include "server/apps/figures_client.h"
#include "server/monitor/http_client.h"
#include "server/session/frame_trace.h"

namespace rustle::apps {
namespace {

using Json = nlohmann::ordered_json;

struct TraceArguments {
  std::string session, http = kDefaultHttp;
  std::optional<std::uint64_t> frame, sequence;
  std::uint64_t newest = 20;
  bool json = false;
};

/// Milliseconds between two stations; "-" where the later has not been passed.
std::string lapse(const Json& frame, const char* from, const char* to) {
  if (frame.at(to).is_null() || (from != nullptr && frame.at(from).is_null())) return "-";
  return fmt::format("{:.3f}", frame.at(to).get<double>() - (from != nullptr ? frame.at(from).get<double>() : 0.0));
}

void print_table(const Json& told) {
  fmt::print("{:>8} {:>9} {:>6} {:>11} {:>9} {:>9} {:>9} {:>9} {:>9} {:>9} {:>9}\n", "frame", "sequence", "sheet", "time s",
             "decode", "wait", "analysis", "hand-over", "to sound", "delay", "beyond");
  for (const auto& frame : told.at("frames")) {
    const auto whole = [&](const char* name) { return frame.at(name).get<std::uint64_t>(); };
    fmt::print("{:>8} {:>9} {:>6} {:>11.4f} {:>9} {:>9} {:>9} {:>9} {:>9} {:>9} {:>9}{}\n", whole("frame"),
               whole("sequence"), whole("sheet"), frame.at("time_s").get<double>(), lapse(frame, nullptr, "decoded_ms"),
               lapse(frame, "decoded_ms", "begun_ms"), lapse(frame, "begun_ms", "analysed_ms"),
               lapse(frame, "analysed_ms", "accepted_ms"), lapse(frame, nullptr, "sent_ms"),
               lapse(frame, nullptr, "playout_delay_ms"), lapse(frame, nullptr, "beyond_delay_ms"),
               frame.at("dropped").is_null() ? "" : "  dropped: " + frame.at("dropped").get<std::string>());
  }
}

int run(const TraceArguments& arguments) {
  std::string target = fmt::format("/trace?session={}&newest={}", monitor::in_query(arguments.session), arguments.newest);
  if (arguments.frame) target += fmt::format("&frame={}", *arguments.frame);
  if (arguments.sequence) target += fmt::format("&sequence={}", *arguments.sequence);
  const auto told = ask_daemon(arguments.http, target);
  if (!told) return complain(told.error(), kFailed);
  if (told->at("frames").empty()) {
    return complain(fmt::format("session {} has no such frame among its newest {}; `rustle trace {}` shows which there are",
                                arguments.session, session::FrameTraces::kKept, arguments.session),
                    kFailed);
  }
  if (arguments.json) {
    fmt::print("{}\n", told->dump());
  } else {
    print_table(*told);
  }
  return kDone;
}

}  // namespace

void add_trace(CLI::App& app, Action& action) {
  auto arguments = std::make_shared<TraceArguments>();
  auto* command = app.add_subcommand("trace", "A session's newest frames on their way from receipt to their first sample");
  command->footer(
      "Example: rustle trace flag --newest 5\n"
      "         rustle trace flag --frame 1234 --json\n"
      "Columns in ms: decode from receipt, wait for analysis, analysis, hand-over to rendering; from receipt to the first\n"
      "sample sent, the playout delay, and what lies beyond it.");
  command->add_option("SESSION", arguments->session, "The session")->required();
  command->add_option("--frame", arguments->frame, "This frame, by its number among the session's, from 1");
  command->add_option("--sequence", arguments->sequence, "This frame, by the sequence number of its message");
  command->add_option("--newest", arguments->newest, "So many, the newest")
      ->check(CLI::Range(std::uint64_t{1}, std::uint64_t{session::FrameTraces::kKept}))
      ->capture_default_str();
  command->add_option("--http", arguments->http, "The daemon's HTTP address")->capture_default_str();
  command->add_flag("--json", arguments->json, "Print as JSON");
  command->callback([arguments, &action] { action = [arguments] { return run(*arguments); }; });
}

}  // namespace rustle::apps
