#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <memory>
#include <nlohmann/json.hpp>

#include "client_sdk/cpp/connection.h"
#include "server/apps/command_pack.h"
#include "server/apps/daemon_address.h"
#include "server/apps/session_choice.h"
#include "server/apps/wording.h"

namespace rustle::apps {
namespace {

struct ChangeArguments {
  std::uint32_t sheet = 1;
  std::string material, surface, session, name;
  DaemonAddress daemon;
  bool json = false;
};

nlohmann::ordered_json to_json(const client::PackInfo& pack) {
  return {{"name", pack.name},       {"material", pack.material}, {"touched_surface", pack.touched_surface},
          {"version", pack.version}, {"licence", pack.licence},   {"rate_hz", pack.rate_hz},
          {"units", pack.units},     {"spectra", pack.spectra}};
}

std::string line_of(const client::PackInfo& pack) {
  return fmt::format("{} {}: {} on {}, {}, {}", pack.name, pack.version, pack.material, pack.touched_surface,
                     counted(pack.units, "unit"),
                     pack.spectra == 1 ? "1 spectrum" : fmt::format("{} spectra", pack.spectra));
}

int run_change(const ChangeArguments& arguments) {
  auto connection = connect_to(arguments.daemon);
  if (!connection) return complain(client::to_string(connection.error()), kFailed);
  const auto session = choose_session(*connection, arguments.session);
  if (!session) return complain(session.error().message, session.error().status);
  const auto pack = connection->change_pack(*session, arguments.sheet, arguments.material, arguments.surface);
  if (!pack) return complain(client::to_string(pack.error()), kFailed);
  if (arguments.json) {
    fmt::print(
        "{}\n",
        nlohmann::ordered_json{{"session", *session}, {"sheet_id", arguments.sheet}, {"pack", to_json(*pack)}}.dump());
  } else {
    fmt::print("{}, sheet {}: {}\n", *session, arguments.sheet, line_of(*pack));
  }
  return kDone;
}

int run_reload(const ChangeArguments& arguments) {
  auto connection = connect_to(arguments.daemon);
  if (!connection) return complain(client::to_string(connection.error()), kFailed);
  const auto packs = connection->reload_pack(arguments.name);
  if (!packs) return complain(client::to_string(packs.error()), kFailed);
  auto list = nlohmann::ordered_json::array();
  for (const auto& pack : *packs) {
    list.push_back(to_json(pack));
    if (!arguments.json) fmt::print("{}\n", line_of(pack));
  }
  if (arguments.json) fmt::print("{}\n", list.dump());
  return kDone;
}

}  // namespace

void add_pack_change(CLI::App& pack, Action& action) {
  auto arguments = std::make_shared<ChangeArguments>();
  auto* command = pack.add_subcommand("change", "Give a sheet another material's pack while a daemon sounds it");
  command->footer(
      "Example: rustle pack change --session flag --sheet 1 --material banknote\n"
      "What sounds goes on as it began, what begins has the new pack, and friction goes over to it.");
  command->add_option("--sheet", arguments->sheet, "The sheet's id")->capture_default_str();
  auto* material = command->add_option("--material", arguments->material, "The material; as it is when absent");
  command->add_option("--surface", arguments->surface, "The surface it touches; as it is when absent");
  command->add_option("--session", arguments->session, "The session; the only one there is when absent");
  add_daemon_options(*command, arguments->daemon);
  command->add_flag("--json", arguments->json, "Print the pack as JSON");
  command->callback([arguments, material, &action] {
    if (material->empty() && arguments->surface.empty()) throw CLI::RequiredError("--material or --surface");
    action = [arguments] { return run_change(*arguments); };
  });
}

void add_pack_reload(CLI::App& pack, Action& action) {
  auto arguments = std::make_shared<ChangeArguments>();
  auto* command = pack.add_subcommand("reload", "Have a daemon read packs from disk anew, while it sounds them");
  command->footer(
      "Example: rustle pack reload printer-paper\n"
      "Where one cannot be read its file is named, and all packs stay as they were.");
  command->add_option("NAME", arguments->name, "The pack's name or material; all that are there when absent, new ones too");
  add_daemon_options(*command, arguments->daemon);
  command->add_flag("--json", arguments->json, "Print what was read as JSON");
  command->callback([arguments, &action] { action = [arguments] { return run_reload(*arguments); }; });
}

}  // namespace rustle::apps
