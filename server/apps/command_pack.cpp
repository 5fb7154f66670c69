#include "server/apps/command_pack.h"

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <set>

#include "sound_db/generate/generate.h"
#include "sound_db/pack/check.h"
#include "sound_db/pack/library.h"
#include "sound_db/pack/load.h"
#include "sound_db/pack/manifest.h"

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

int run_generate(const std::string& material, const std::string& folder, bool force) {
  if (const auto refusal = overwrite_refusal(folder, force); !refusal.empty()) return complain(refusal, kFailed);
  tl::expected<void, pack::PackError> written;
  {
    Progress progress("generating " + material);
    written = generate::write_pack(material, folder, [&](double share) { progress.show(share); });
  }
  if (!written) return complain(written.error().text(), kFailed);
  fmt::print("{}: {} written\n", folder, material);
  return kDone;
}

/// A file in the folder that the pack does not name; empty: none.
std::string stranger_in(const std::filesystem::path& folder) {
  pack::Findings findings;
  const auto manifest = pack::read_manifest(folder, findings);
  if (!manifest) return {};
  std::set<std::string> own = {pack::kManifestName};
  for (const auto& file : pack::named_files(*manifest)) {
    own.insert(std::filesystem::path(file).lexically_normal().generic_string());
  }
  std::error_code failed;
  for (std::filesystem::recursive_directory_iterator at(folder, failed), end; !failed && at != end; at.increment(failed)) {
    const auto name = at->path().lexically_relative(folder).generic_string();
    if (!at->is_directory(failed) && !own.contains(name)) return name;
  }
  return {};
}

}  // namespace

std::string overwrite_refusal(const std::string& folder, bool force) {
  namespace fs = std::filesystem;
  std::error_code failed;
  const auto status = fs::status(folder, failed);
  if (!fs::exists(status)) return {};
  if (!fs::is_directory(status)) return fmt::format("{}: is not a folder; choose another name", folder);
  if (fs::is_empty(folder, failed)) return {};
  if (!fs::exists(fs::path(folder) / pack::kManifestName, failed))
    return fmt::format("{}: is not empty and not a sound pack; choose another folder", folder);
  if (!force)
    return fmt::format("{}: holds a sound pack already; replace it with --force, or choose another folder", folder);
  if (const auto stranger = stranger_in(folder); !stranger.empty()) {
    return fmt::format("{}: holds {}, which is not of the pack and would be lost; move it away, or choose another folder",
                       folder, stranger);
  }
  return {};
}

std::string place_text(const pack::GridPoint& point) {
  if (point.constrained()) return "(0, 0)";
  return fmt::format("l_r {:g} cm, l_c {:g} cm", 100 * point.ruling_length_m, 100 * point.free_border_length_m);
}

std::shared_ptr<const pack::SoundPack> load_pack_or_complain(const std::string& folder_or_material, std::uint32_t rate_hz) {
  std::filesystem::path folder = folder_or_material;
  std::error_code failed;
  if (!std::filesystem::exists(folder, failed)) {
    const auto entry = pack::PackLibrary().find(folder_or_material);
    if (!entry) {
      complain(fmt::format("{}: is neither a folder nor a material: {}", folder_or_material, entry.error().text()), kFailed);
      return nullptr;
    }
    folder = entry->folder;
  }
  pack::LoadOptions options;
  options.rate_hz = rate_hz;
  if (rate_hz == 0) {
    pack::Findings findings;
    const auto manifest = pack::read_manifest(folder, findings);
    options.rate_hz = manifest ? std::clamp<std::uint32_t>(manifest->pack.stored_rate_hz, 8000, 192000) : 48000;
  }
  auto loaded = pack::load(folder, options);
  if (!loaded) {
    complain(loaded.error().text(), kFailed);
    return nullptr;
  }
  return *loaded;
}

void add_pack(CLI::App& app, Action& action) {
  auto* command = app.add_subcommand(
      "pack", "List, check, show, play, generate, build and calibrate sound packs; change them while a daemon sounds");
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
  generate->add_option("--material", *material, "Which one")->check(CLI::IsMember(generate::material_names()))->required();
  generate->add_option("-o,--output", *folder, "The folder to write")->required();
  auto force = std::make_shared<bool>(false);
  generate->add_flag("--force", *force, "Replace a pack that is there already");
  generate->callback([material, folder, force, &action] {
    action = [material, folder, force] { return run_generate(*material, *folder, *force); };
  });

  add_pack_build(*command, action);
  add_pack_calibrate(*command, action);
  add_pack_show(*command, action);
  add_pack_play(*command, action);
  add_pack_change(*command, action);
  add_pack_reload(*command, action);
}

}  // namespace rustle::apps
