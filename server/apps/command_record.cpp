#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <chrono>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <thread>
#include <vector>

#include "client_sdk/cpp/connection.h"
#include "server/apps/command.h"
#include "server/apps/daemon_address.h"
#include "server/apps/wording.h"

namespace rustle::apps {
namespace {

using SteadyClock = std::chrono::steady_clock;

constexpr std::chrono::milliseconds kLookEvery{100};  // at what is recorded
constexpr std::chrono::milliseconds kWaitStep{20};    // for a session that comes: what it sends meanwhile is missing

struct RecordArguments {
  std::string session, output;
  DaemonAddress daemon;
  double seconds = 0;
  bool next = false, all = false, json = false;
};

/// Recordings that this command began, by session.
class Recordings {
 public:
  explicit Recordings(client::Connection connection) : connection_(std::move(connection)) {}

  /// Error: of the daemon.
  tl::expected<void, client::Error> begin(const std::string& session, const std::string& name) {
    auto file = connection_.start_recording(session, name);
    if (!file) return tl::unexpected(file.error());
    under_way_[session] = {*file, 0, 0};
    return {};
  }
  bool any() const { return !under_way_.empty(); }
  bool has(const std::string& session) const { return under_way_.contains(session); }

  /// What the daemon says of them. Those that have ended are taken to the finished ones.
  void look(const std::vector<client::SessionInfo>& sessions) {
    for (auto each = under_way_.begin(); each != under_way_.end();) {
      const auto there =
          std::find_if(sessions.begin(), sessions.end(), [&](const auto& s) { return s.session_id == each->first; });
      const bool goes_on =
          there != sessions.end() && there->recording && there->recording->file_name == each->second.file_name;
      if (goes_on) each->second = *there->recording;
      const std::string session = each->first;
      ++each;
      if (!goes_on) finish(session);
    }
  }
  void finish_all() {
    while (!under_way_.empty()) finish(under_way_.begin()->first);
  }

  struct Finished {
    std::string session;
    client::RecordingInfo file;
    std::string failure;  ///< empty: none
  };
  const std::vector<Finished>& finished() const { return finished_; }
  std::uint64_t bytes() const {
    std::uint64_t sum = 0;
    for (const auto& [session, file] : under_way_) sum += file.bytes;
    for (const auto& done : finished_) sum += done.file.bytes;
    return sum;
  }

 private:
  void finish(const std::string& session) {
    Finished done{session, under_way_.at(session), {}};
    under_way_.erase(session);
    if (auto stopped = connection_.stop_recording(session)) {
      done.file = *stopped;
    } else {
      done.failure = client::to_string(stopped.error());
    }
    finished_.push_back(std::move(done));
  }

  client::Connection connection_;
  std::map<std::string, client::RecordingInfo> under_way_;
  std::vector<Finished> finished_;
};

/// Empty: the arguments make sense together.
std::string misuse(const RecordArguments& arguments) {
  if (arguments.next && arguments.all) return "--next records one session and --all every one; leave one of them out";
  if (arguments.all && !arguments.session.empty()) return "--all records every session; leave the session out";
  if (arguments.next && !arguments.session.empty()) return "--next records whatever session comes; leave the session out";
  if (arguments.all && !arguments.output.empty())
    return "-o names one file and --all makes several; leave it out and each is named after its session and time";
  return {};
}

/// The session to record, where the arguments mean one that is there. Error: which there are.
tl::expected<std::string, std::string> chosen(const RecordArguments& arguments,
                                              const std::vector<client::SessionInfo>& sessions) {
  std::string names;
  for (const auto& s : sessions) names += " " + s.session_id;
  if (arguments.session.empty()) {
    if (sessions.size() == 1) return sessions.front().session_id;
    if (sessions.empty())
      return tl::unexpected(std::string("no session is attached; start a simulator, or wait for one with --next"));
    return tl::unexpected("several sessions are attached, name one or add --all:" + names);
  }
  const auto is_asked = [&](const auto& s) { return s.session_id == arguments.session; };
  if (std::none_of(sessions.begin(), sessions.end(), is_asked)) {
    return tl::unexpected(fmt::format("there is no session \"{}\"; {}", arguments.session,
                                      names.empty() ? "none is attached" : "there are:" + names));
  }
  return arguments.session;
}

int tell(const RecordArguments& arguments, const Recordings& recordings) {
  std::vector<std::string> notices;
  auto files = nlohmann::ordered_json::array();
  for (const auto& [session, file, failure] : recordings.finished()) {
    files.push_back(
        {{"session", session}, {"file_name", file.file_name}, {"records", file.messages}, {"bytes", file.bytes}});
    if (!failure.empty()) {
      notices.push_back(fmt::format("{}: {}", session, failure));
    } else if (!arguments.json) {
      fmt::print("{}: {}, {:.1f} MB from {}, in the daemon's recording folder\n", file.file_name,
                 counted(file.messages, "record"), 1e-6 * static_cast<double>(file.bytes), session);
    }
  }
  if (arguments.json) fmt::print("{}\n", nlohmann::ordered_json{{"recordings", files}, {"failures", notices}}.dump());
  return done_with(notices);
}

int run(const RecordArguments& arguments) {
  if (auto wrong = misuse(arguments); !wrong.empty()) return complain(wrong, kWrongUsage);
  auto connection = connect_to(arguments.daemon);
  if (!connection) return complain(client::to_string(connection.error()) + " Start one with `rustled`.", kFailed);
  auto sessions = connection->list_sessions();
  if (!sessions) return complain(client::to_string(sessions.error()), kFailed);
  catch_interrupts();

  Recordings recordings(*connection);
  std::vector<std::string> passed;  // sessions that are not to be recorded, or not again
  if (arguments.next) {
    for (const auto& s : *sessions) passed.push_back(s.session_id);
  } else if (!arguments.all) {
    const auto session = chosen(arguments, *sessions);
    if (!session) return complain(session.error(), kWrongUsage);
    if (auto begun = recordings.begin(*session, arguments.output); !begun)
      return complain(client::to_string(begun.error()), kFailed);
  }
  std::optional<SteadyClock::time_point> since;
  if (recordings.any()) since = SteadyClock::now();
  Progress progress("recording");
  while (!interrupted()) {
    for (const auto& s : *sessions) {
      const bool wanted = arguments.all || (arguments.next && !since);
      if (!wanted || s.recording || std::find(passed.begin(), passed.end(), s.session_id) != passed.end()) continue;
      if (auto begun = recordings.begin(s.session_id, arguments.output); !begun) {
        if (begun.error().code_name == "unknown_session") continue;  // it has gone already
        return complain(client::to_string(begun.error()), kFailed);
      }
      if (arguments.all) passed.push_back(s.session_id);
      if (!since) since = SteadyClock::now();
    }
    const double passed_s = since ? std::chrono::duration<double>(SteadyClock::now() - *since).count() : 0;
    progress.show(fmt::format("{:.1f} s, {:.1f} MB{}", passed_s, 1e-6 * static_cast<double>(recordings.bytes()),
                              recordings.any() ? "" : ", waiting for a session"));
    if (arguments.seconds > 0 && since && passed_s >= arguments.seconds) break;
    std::this_thread::sleep_for(arguments.all || !since ? kWaitStep : kLookEvery);
    sessions = connection->list_sessions();
    if (!sessions) return complain(client::to_string(sessions.error()), kFailed);
    recordings.look(*sessions);
    // A session's name may come again.
    std::erase_if(passed, [&](const std::string& id) {
      return std::none_of(sessions->begin(), sessions->end(), [&](const auto& s) { return s.session_id == id; });
    });
    if (!arguments.all && since && !recordings.any()) break;
  }
  recordings.finish_all();
  return tell(arguments, recordings);
}

}  // namespace

void add_record(CLI::App& app, Action& action) {
  auto arguments = std::make_shared<RecordArguments>();
  auto* command = app.add_subcommand("record", "Have a daemon record sessions, until they end or Ctrl-C");
  command->footer(
      "Example: rustle record flag -o take-1 --seconds 30\n"
      "         rustle record --all\n"
      "The daemon writes, into the folder that `rustled --recordings FOLDER` names: every message as it arrived, and what "
      "it\n"
      "decided, so that `rustle render take-1.mcap -o take-1.wav` gives what it sent. What sounded before the recording\n"
      "began is missing; a session attached with the option `record` is recorded from its first sample, and so is every\n"
      "one of a daemon started with --record-all. Stored is what the daemon has brought to the disk, at the latest a\n"
      "quarter of a second after it came.");
  command->add_option("SESSION", arguments->session, "The session; the only one there is when absent");
  command->add_option("-o,--output", arguments->output,
                      "The file's name, .mcap added where it lacks; after session and time when absent");
  command->add_option("--seconds", arguments->seconds, "Stop after that time; at the session's end otherwise")
      ->check(CLI::PositiveNumber);
  command->add_flag("--next", arguments->next, "Wait for the next session that attaches, and record that");
  command->add_flag("--all", arguments->all, "Every session that is there or comes, each into a file of its own");
  add_daemon_options(*command, arguments->daemon);
  command->add_flag("--json", arguments->json, "Print the files as JSON");
  command->callback([arguments, &action] { action = [arguments] { return run(*arguments); }; });
}

}  // namespace rustle::apps
