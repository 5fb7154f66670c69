#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <chrono>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <thread>

#include "client_sdk/capture/import.h"
#include "server/apps/capture_source.h"
#include "server/apps/command.h"
#include "server/apps/scratch_folder.h"
#include "server/report/image_canvas.h"
#include "server/validation/page.h"
#include "server/validation/validate.h"

namespace rustle::apps {
namespace {

struct ValidateArguments {
  std::string pack = "printer-paper", report, against, captures, manifest;
  std::vector<std::string> only;
  std::uint64_t seed = 1;
  int workers = 0;
  bool json = false, list = false;
};

int run_list(bool json) {
  auto list = nlohmann::ordered_json::array();
  for (const auto& group : validation::groups()) {
    if (!json) {
      fmt::print("{:<13}{}: {}{}\n", group.name, group.title, group.about,
                 group.needs_recordings ? " (with --against)" : "");
    }
    list.push_back({{"name", group.name}, {"title", group.title}, {"about", group.about}});
  }
  if (json) fmt::print("{}\n", nlohmann::ordered_json{{"groups", list}}.dump());
  return kDone;
}

void print_table(const std::vector<validation::GroupFindings>& all) {
  for (const auto& [group, findings] : all) {
    if (findings.checks.empty()) continue;
    fmt::print("\n{}\n", group->title);
    fmt::print("  {:<44} {:>12} {:>10} {:>10}  {:<28} {}\n", "", "ours", "paper", "as printed", "bound", "holds");
    for (const auto& check : findings.checks) {
      const auto text = [](const std::optional<double>& value) {
        return value ? validation::figure_text(*value) : std::string();
      };
      fmt::print("  {:<44} {:>12} {:>10} {:>10}  {:<28} {}\n", check.name, validation::figure_text(check.ours),
                 text(check.paper), text(check.published), check.bound.text, check.holds() ? "yes" : "NO");
    }
  }
}

nlohmann::ordered_json figure(double value) {
  return std::isfinite(value) ? nlohmann::ordered_json(value) : nlohmann::ordered_json(nullptr);
}

void print_json(const std::vector<validation::GroupFindings>& all) {
  auto list = nlohmann::ordered_json::array();
  for (const auto& [group, findings] : all) {
    for (const auto& check : findings.checks) {
      nlohmann::ordered_json row{{"name", check.name},
                                 {"ours", figure(check.ours)},
                                 {"paper", check.paper ? figure(*check.paper) : nlohmann::ordered_json(nullptr)},
                                 {"bound", check.bound.text},
                                 {"holds", check.holds()}};
      if (check.published) row["published"] = figure(*check.published);
      list.push_back(std::move(row));
    }
  }
  fmt::print("{}\n", nlohmann::ordered_json{{"checks", list}}.dump(2));
}

/// Whether a file is named after a material that there is a pack of cloth of.
bool named_after_cloth(const std::filesystem::path& file, pack::PackLibrary& packs) {
  const std::string name = file.stem().string();
  for (const std::string& material : packs.materials()) {
    if (name.find(material) == std::string::npos) continue;
    const auto pack = packs.load(material, {}, validation::kRate_hz);
    if (pack && (*pack)->cloth) return true;
  }
  return false;
}

/// What a capture holds, or a .npz file that could be one.
tl::expected<std::vector<engine::StreamItem>, std::string> read_motion(const std::filesystem::path& file) {
  std::filesystem::path readable = file;
  std::optional<ScratchFolder> scratch;
  if (file.extension() == ".npz") {
    scratch.emplace();
    if (scratch->path().empty())
      return tl::unexpected(std::string("no folder for captures could be made; set TMPDIR to one that is yours"));
    readable = scratch->path() / "motion.mcap";
    capture::ImportOptions options;
    options.sheet_kind = v1::SHEET_KIND_CLOTH;
    if (auto imported = capture::import_capture(file.string(), readable, options); !imported)
      return tl::unexpected(imported.error().text());
  }
  auto source = CaptureSource::open(readable);
  if (!source) return tl::unexpected(source.error());
  std::vector<engine::StreamItem> items;
  while (auto item = source->next()) items.push_back(std::move(*item));
  return items;
}

int run(const ValidateArguments& arguments) {
  if (arguments.list) return run_list(arguments.json);
  const auto began = std::chrono::steady_clock::now();
  validation::Setting setting;
  setting.seed = arguments.seed;
  setting.workers =
      arguments.workers > 0 ? arguments.workers : static_cast<int>(std::max(1U, std::thread::hardware_concurrency()));
  setting.recordings = arguments.against;
  setting.recordings_manifest = arguments.manifest;
  if (!arguments.manifest.empty() && arguments.against.empty())
    return complain("--manifest says what recordings are: name their folder with --against", kWrongUsage);
  if (!arguments.manifest.empty() && !std::filesystem::is_regular_file(arguments.manifest))
    return complain(fmt::format("--manifest {}: there is no such file; `rustle pack build --print-manifest` writes one to "
                                "fill in",
                                arguments.manifest),
                    kWrongUsage);
  if (!arguments.against.empty() && !std::filesystem::is_directory(arguments.against)) {
    return complain(fmt::format("--against {}: there is no such folder", arguments.against), kWrongUsage);
  }
  if (std::filesystem::is_directory(arguments.pack)) {
    setting.packs = std::make_shared<pack::PackLibrary>(std::vector<std::filesystem::path>{arguments.pack});
    const auto materials = setting.packs->materials();
    if (materials.size() != 1) {
      for (const auto& broken : setting.packs->broken()) warn(broken.text());
      return complain(fmt::format("--pack {}: {}; name the folder of one pack", arguments.pack,
                                  materials.empty() ? "no sound pack is there" : "several sound packs are there"),
                      kWrongUsage);
    }
    setting.material = materials.front();
  } else {
    setting.packs = std::make_shared<pack::PackLibrary>();
    setting.material = arguments.pack;
    if (auto found = setting.packs->find(setting.material); !found) return complain(found.error().text(), kWrongUsage);
  }
  auto pack = setting.packs->load(setting.material, {}, validation::kRate_hz);
  if (!pack) return complain(pack.error().text(), kFailed);
  setting.pack = *pack;
  if (!arguments.captures.empty()) {
    if (!std::filesystem::is_directory(arguments.captures))
      return complain(fmt::format("--captures {}: there is no such folder", arguments.captures), kWrongUsage);
    std::vector<std::filesystem::path> files;
    for (const auto& entry : std::filesystem::directory_iterator(arguments.captures)) {
      const auto extension = entry.path().extension();
      if ((extension == ".mcap" || extension == ".npz") && named_after_cloth(entry.path(), *setting.packs))
        files.push_back(entry.path());
    }
    std::ranges::sort(files);
    for (const auto& file : files) {
      auto items = read_motion(file);
      if (!items) return complain(items.error(), kFailed);
      setting.captures.emplace_back(file.stem().string(), std::move(*items));
    }
    if (files.empty()) warn(fmt::format("--captures {}: no .mcap or .npz file is named after a cloth", arguments.captures));
  }
  const auto chosen = validation::chosen_groups(setting, arguments.only);
  if (!chosen) return complain("--only: " + chosen.error(), kWrongUsage);

  std::vector<validation::GroupFindings> all;
  {
    Progress progress("validating");
    all = validation::validate(setting, *chosen, arguments.only, [&](double share) { progress.show(share); });
  }
  for (const auto& name : arguments.only) {
    const bool there = std::any_of(all.begin(), all.end(), [&](const validation::GroupFindings& group) {
      return std::any_of(group.findings.checks.begin(), group.findings.checks.end(),
                         [&](const validation::Check& check) { return check.name.starts_with(name); });
    });
    if (!there) {
      return complain(fmt::format("--only {}: no check has this name; run its group to see those there are", name),
                      kWrongUsage);
    }
  }
  const double elapsed_s = std::chrono::duration<double>(std::chrono::steady_clock::now() - began).count();
  if (!arguments.report.empty()) {
    const std::vector<std::pair<std::string, std::string>> facts = {
        {"Sound pack", fmt::format("{} {}, {} on {}", setting.pack->name, setting.pack->version, setting.pack->material,
                                   setting.pack->touched_surface)},
        {"Origin of the pack", setting.pack->origin},
        {"Seed", fmt::format("{}", setting.seed)},
        {"Rate", fmt::format("{} Hz", validation::kRate_hz)},
        {"Recordings", arguments.against.empty() ? "none compared" : arguments.against},
        {"Took", fmt::format("{:.0f} s", elapsed_s)}};
    if (auto written = report::write_file(arguments.report, validation::page(all, facts)); !written) {
      return complain(written.error(), kFailed);
    }
  }
  const auto sum = validation::verdict(all);
  if (arguments.json) {
    print_json(all);
  } else {
    print_table(all);
    fmt::print("\n{} of {} checks hold; {} in {:.0f} s\n", sum.checks - sum.failed, sum.checks, setting.pack->name,
               elapsed_s);
  }
  return sum.failed == 0 ? kDone : kFailed;
}

}  // namespace

void add_validate(CLI::App& app, Action& action) {
  auto arguments = std::make_shared<ValidateArguments>();
  auto* command = app.add_subcommand("validate", "Repeat the papers' tables and figures, ours beside theirs");
  command->footer(
      "Example: rustle validate --report validation.html\n"
      "         rustle validate --only table1 levels --json\n"
      "         rustle validate --only cloth --captures captures/\n"
      "         rustle validate --against session/ --manifest session.toml --report beside.html\n"
      "Sheets that exist on the computer only go through the whole pipeline. \"as printed\": with the papers' formulas\n"
      "unchanged. Status 0 when every check holds, else 1.");
  command->add_flag("--json", arguments->json, "Print as JSON: {\"checks\": [{name, ours, paper, bound, holds}]}");
  command->add_option("--report", arguments->report, "Write a page with every figure and plot (.html)");
  command->add_option("--pack", arguments->pack, "Material, or the folder of a sound pack")->capture_default_str();
  command->add_option("--against", arguments->against, "Folder of recordings to compare the pack with, class by class");
  command->add_option(
      "--captures", arguments->captures,
      "Folder of captures (.mcap, .npz); those named after a cloth, such as cotton, are heard in all of them");
  command->add_option("--manifest", arguments->manifest,
                      "What each recording is, as for `rustle pack build`; else the folder's recordings.toml, else the "
                      "files' names");
  command->add_option("--only", arguments->only, "Groups or checks to run, such as table1 or table1/d_r; see --list");
  command->add_flag("--list", arguments->list, "List the groups of checks");
  command->add_option("--seed", arguments->seed, "Seed of everything random")->capture_default_str();
  command->add_option("--workers", arguments->workers, "Threads; 0: as many as there are cores; changes no figure")
      ->check(CLI::Range(0, 64))
      ->capture_default_str();
  command->callback([arguments, &action] { action = [arguments] { return run(*arguments); }; });
}

}  // namespace rustle::apps
