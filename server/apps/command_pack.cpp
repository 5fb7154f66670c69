#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <memory>
#include <nlohmann/json.hpp>

#include "server/apps/command.h"
#include "sound_db/generate/generate.h"
#include "sound_db/pack/check.h"
#include "sound_db/pack/library.h"

namespace rustle::apps {
namespace {

int run_list(bool json) {
  const pack::PackLibrary packs;
  auto list = nlohmann::ordered_json::array();
  for (const auto& entry : packs.entries()) {
    if (!json) {
      fmt::print("{:<16} on {:<14} version {}, {}, {}\n  {}\n", entry.material, entry.touched_surface, entry.version,
                 entry.licence, entry.origin, entry.folder.string());
    }
    list.push_back({{"name", entry.name},
                    {"material", entry.material},
                    {"touched_surface", entry.touched_surface},
                    {"version", entry.version},
                    {"licence", entry.licence},
                    {"origin", entry.origin},
                    {"folder", entry.folder.string()}});
  }
  if (json) fmt::print("{}\n", list.dump());
  for (const auto& broken : packs.broken()) warn(broken.text());
  if (list.empty()) {
    std::string folders;
    for (const auto& folder : packs.search_folders()) folders += "\n  " + folder.string();
    return complain(
        "no sound pack found; make one with `rustle pack generate`, or name its folder in RUSTLE_PACK_PATH. Looked in:" +
            folders,
        kFailed);
  }
  return kDone;
}

int run_check(const std::string& folder, bool json) {
  const auto findings = pack::check(folder);
  auto list = nlohmann::ordered_json::array();
  bool usable = true;
  for (const auto& [severity, what] : findings) {
    const char* name = severity == pack::Severity::kError ? "error" : "warning";
    usable &= severity != pack::Severity::kError;
    if (!json) fmt::print("{}: {}\n", name, what.text());
    list.push_back({{"severity", name},
                    {"file", what.file},
                    {"field", what.field},
                    {"message", what.message},
                    {"remedy", what.remedy}});
  }
  if (json) fmt::print("{}\n", nlohmann::ordered_json{{"folder", folder}, {"findings", list}}.dump());
  if (!json && list.empty()) fmt::print("{}: in order\n", folder);
  return usable ? kDone : kFailed;
}

int run_generate(const std::string& material, const std::string& folder) {
  tl::expected<void, pack::PackError> written;
  {
    Progress progress("generating " + material);
    written = generate::write_pack(material, folder, [&](double share) { progress.show(share); });
  }
  if (!written) return complain(written.error().text(), kFailed);
  fmt::print("{}: {} written\n", folder, material);
  return kDone;
}

std::vector<std::string> generatable() {
  std::vector<std::string> names;
  for (const auto& paper : generate::papers()) names.emplace_back(paper.name);
  return names;
}

}  // namespace

void add_pack(CLI::App& app, Action& action) {
  auto* command = app.add_subcommand("pack", "List, check and generate sound packs");
  command->require_subcommand(1);
  command->footer("Example: rustle pack list && rustle pack check my-paper/");

  auto json = std::make_shared<bool>(false);
  auto folder = std::make_shared<std::string>();
  auto material = std::make_shared<std::string>();

  auto* list = command->add_subcommand("list", "The packs that are found");
  list->footer("Example: rustle pack list --json");
  list->add_flag("--json", *json, "Print as JSON");
  list->callback([json, &action] { action = [json] { return run_list(*json); }; });

  auto* check = command->add_subcommand("check", "Say what is wrong with a pack's folder");
  check->footer("Example: rustle pack check /usr/share/rustle/packs/printer-paper");
  check->add_option("FOLDER", *folder, "The pack's folder")->required();
  check->add_flag("--json", *json, "Print as JSON");
  check->callback([json, folder, &action] { action = [json, folder] { return run_check(*folder, *json); }; });

  auto* generate = command->add_subcommand("generate", "Generate a default pack");
  generate->footer("Example: rustle pack generate --material printer-paper -o packs/printer-paper");
  generate->add_option("--material", *material, "Which one")->check(CLI::IsMember(generatable()))->required();
  generate->add_option("-o,--output", *folder, "The folder to write")->required();
  generate->callback(
      [material, folder, &action] { action = [material, folder] { return run_generate(*material, *folder); }; });
}

}  // namespace rustle::apps
