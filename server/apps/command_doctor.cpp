#include <fmt/color.h>
#include <fmt/format.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <memory>
#include <nlohmann/json.hpp>

#include "server/apps/command.h"
#include "server/apps/machine.h"

namespace rustle::apps {
namespace {

fmt::text_style style_of(Grade grade) {
  if (isatty(STDOUT_FILENO) == 0) return {};
  switch (grade) {
    case Grade::kGranted:
      return fmt::fg(fmt::terminal_color::green);
    case Grade::kLimited:
      return fmt::fg(fmt::terminal_color::yellow);
    case Grade::kMissing:
      break;
  }
  return fmt::fg(fmt::terminal_color::red);
}

int run(bool json) {
  bool ready = true;
  auto list = nlohmann::ordered_json::array();
  for (const auto& check : check_machine()) {
    ready &= check.grade != Grade::kMissing;
    list.push_back(
        {{"name", check.name}, {"grade", to_string(check.grade)}, {"found", check.found}, {"remedy", check.remedy}});
    if (json) continue;
    fmt::print("{:<19}", check.name);
    fmt::print(style_of(check.grade), "{:<9}", to_string(check.grade));
    fmt::print("{}\n", check.found);
    if (!check.remedy.empty()) fmt::print("{:<28}-> {}\n", "", check.remedy);
  }
  if (json) {
    fmt::print("{}\n", nlohmann::ordered_json{{"checks", list}, {"ready", ready}}.dump());
  } else {
    fmt::print("{}\n", ready ? "rustled can run here." : "rustled cannot run here yet: mend what is missing.");
  }
  return ready ? kDone : kFailed;
}

}  // namespace

void add_doctor(CLI::App& app, Action& action) {
  auto* command = app.add_subcommand("doctor", "What this machine grants the daemon, what it does not, and what to do");
  command->footer(
      "Example: rustle doctor\n"
      "Exit status 1 where rustled could not start.");
  auto json = std::make_shared<bool>(false);
  command->add_flag("--json", *json, "Print as JSON");
  command->callback([json, &action] { action = [json] { return run(*json); }; });
}

}  // namespace rustle::apps
