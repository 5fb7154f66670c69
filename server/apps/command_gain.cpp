#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <cmath>
#include <memory>
#include <nlohmann/json.hpp>

#include "server/apps/command.h"
#include "server/apps/daemon_address.h"
#include "server/apps/gain_text.h"
#include "server/apps/session_choice.h"
#include "server/wire/topics.h"

namespace rustle::apps {
namespace {

struct GainArguments {
  std::vector<std::string> gains;
  std::string session;
  DaemonAddress daemon;
  bool reset = false, json = false;
};

client::Gain to_sdk(const synthesis::Gain& gain) {
  client::Gain out{gain.gain_db, gain.sheet_id, {}, gain.material};
  if (gain.kind) out.kind = static_cast<client::SoundKind>(*gain.kind);
  return out;
}

synthesis::Gain from_sdk(const client::Gain& gain) {
  synthesis::Gain out{gain.gain_db, gain.sheet_id, {}, gain.material};
  if (gain.kind) out.kind = static_cast<synthesis::SoundKind>(*gain.kind);
  return out;
}

nlohmann::ordered_json to_json(const synthesis::Gain& gain) {
  // JSON has no infinity: null is silence.
  nlohmann::ordered_json out{{"gain", to_text(gain)}, {"gain_db", nullptr}};
  if (std::isfinite(gain.gain_db)) out["gain_db"] = gain.gain_db;
  if (gain.sheet_id) out["sheet_id"] = *gain.sheet_id;
  if (gain.kind) out["kind"] = wire::kind_name(*gain.kind);
  if (!gain.material.empty()) out["material"] = gain.material;
  return out;
}

int run(const GainArguments& arguments) {
  std::vector<client::Gain> changes;
  for (const std::string& text : arguments.gains) {
    const auto gain = parse_gain(text);
    if (!gain) return complain(gain.error(), kWrongUsage);
    changes.push_back(to_sdk(*gain));
  }
  auto connection = connect_to(arguments.daemon);
  if (!connection) return complain(client::to_string(connection.error()), kFailed);
  const auto session = choose_session(*connection, arguments.session);
  if (!session) return complain(session.error().message, session.error().status);
  if (arguments.reset) {
    auto now = connection->set_gains(*session, {});
    if (!now) return complain(client::to_string(now.error()), kFailed);
    for (client::Gain& gain : *now) gain.gain_db = 0;
    changes.insert(changes.begin(), now->begin(), now->end());
  }
  const auto in_force = connection->set_gains(*session, changes);
  if (!in_force) return complain(client::to_string(in_force.error()), kFailed);
  auto list = nlohmann::ordered_json::array();
  std::string line;
  for (const client::Gain& gain : *in_force) {
    list.push_back(to_json(from_sdk(gain)));
    line += " " + to_text(from_sdk(gain));
  }
  if (arguments.json) {
    fmt::print("{}\n", nlohmann::ordered_json{{"session", *session}, {"gains", list}}.dump());
  } else {
    fmt::print("{}:{}\n", *session, line.empty() ? " all at 0 dB" : line);
  }
  return kDone;
}

}  // namespace

void add_gain(CLI::App& app, Action& action) {
  auto arguments = std::make_shared<GainArguments>();
  auto* command = app.add_subcommand("gain", "Change a session's gains while it sounds, and tell those in force");
  command->footer(
      "Example: rustle gain friction=-6 sheet:2=+3 --session flag\n"
      "A sound has the product of all gains that concern it. A gain takes the place of the one for the same sounds, 0 "
      "takes\n"
      "it away; without gains they are only told.");
  command->add_option("GAIN", arguments->gains, kGainSyntax);
  command->add_option("--session", arguments->session, "The session; the only one there is when absent");
  command->add_flag("--reset", arguments->reset, "Take all others away");
  add_daemon_options(*command, arguments->daemon);
  command->add_flag("--json", arguments->json, "Print the gains in force as JSON");
  command->callback([arguments, &action] { action = [arguments] { return run(*arguments); }; });
}

}  // namespace rustle::apps
