#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>

#include "server/apps/command_pack.h"
#include "server/apps/wording.h"
#include "sound_db/build/build.h"
#include "sound_db/pack/check.h"
#include "sound_db/pack/write.h"

namespace rustle::apps {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

struct BuildArguments {
  std::string folder, output, manifest;
  bool json = false, force = false, print_manifest = false;
};

/// Whether one folder is the other or lies below it: writing the pack would take the recordings away.
bool holds(const fs::path& outer, const fs::path& inner) {
  std::error_code failed;
  const fs::path whole = fs::weakly_canonical(outer, failed), part = fs::weakly_canonical(inner, failed);
  const auto relative = part.lexically_relative(whole);
  return !relative.empty() && *relative.begin() != "..";
}

Json source_json(const build::SourceReport& source) {
  auto segments = Json::array();
  for (const auto& segment : source.segments) {
    segments.push_back({{"from_s", segment.from_s},
                        {"to_s", segment.to_s},
                        {"seconds", segment.seconds},
                        {"level_dbfs", segment.level_dbfs},
                        {"kept_as", segment.kept_as.empty() ? Json() : Json(segment.kept_as)},
                        {"reason", segment.reason.empty() ? Json() : Json(segment.reason)}});
  }
  return {{"file", source.file},
          {"class", build::name(source.sound_class)},
          {"l_r_m", source.point.ruling_length_m},
          {"l_c_m", source.point.free_border_length_m},
          {"rate_hz", source.rate_hz},
          {"channels", source.channels},
          {"duration_s", source.duration_s},
          {"threshold_dbfs", source.threshold_dbfs},
          {"segments", segments}};
}

void print_source(const build::SourceReport& source) {
  fmt::print("{}: {}, {}; {} Hz, {}, {:.2f} s; sound from {:.0f} dBFS on\n", source.file, build::name(source.sound_class),
             place_text(source.point), source.rate_hz, counted(static_cast<std::size_t>(source.channels), "channel"),
             source.duration_s, source.threshold_dbfs);
  for (const auto& segment : source.segments) {
    const bool whole = segment.level_dbfs > -300;
    fmt::print("  {:8.3f} - {:8.3f} s  {:6.3f} s  {:>6} dBFS  {}\n", segment.from_s, segment.to_s, segment.seconds,
               whole ? fmt::format("{:.1f}", segment.level_dbfs) : "-",
               segment.kept_as.empty() ? "left out, " + segment.reason : "kept as " + segment.kept_as);
  }
}

int report_findings(const pack::Findings& findings) {
  for (const auto& [severity, what] : findings) {
    if (severity == pack::Severity::kError) complain(what.text(), kFailed);
  }
  return kFailed;
}

int run_build(const BuildArguments& arguments) {
  if (arguments.print_manifest) {
    fmt::print("{}", build::example_manifest());
    return kDone;
  }
  if (arguments.folder.empty())
    return complain("name the folder of recordings, as in `rustle pack build FOLDER -o PACK`", kWrongUsage);
  if (arguments.output.empty()) return complain("name the pack's folder with -o PACK", kWrongUsage);
  if (!fs::is_directory(arguments.folder))
    return complain(fmt::format("{}: is not a folder; name the folder of recordings", arguments.folder), kWrongUsage);
  if (holds(arguments.output, arguments.folder))
    return complain(fmt::format("{}: holds the recordings; choose another folder", arguments.output), kWrongUsage);
  if (const auto refusal = overwrite_refusal(arguments.output, arguments.force); !refusal.empty())
    return complain(refusal, kFailed);

  const fs::path manifest_file =
      arguments.manifest.empty() ? fs::path(arguments.folder) / build::kBuildManifestName : fs::path(arguments.manifest);
  pack::Findings wrong;
  const auto manifest = build::read_build_manifest(manifest_file, wrong);
  if (!manifest) return report_findings(wrong);
  std::optional<build::BuiltPack> built;
  {
    Progress progress("reading recordings");
    built = build::build_pack(*manifest, arguments.folder, wrong, [&](double share) { progress.show(share); });
  }
  if (!built) return report_findings(wrong);
  if (const auto written = pack::write(built->pack, arguments.output); !written)
    return complain(written.error().text(), kFailed);
  const pack::Findings findings = pack::check(arguments.output);

  const build::BuildReport& report = built->report;
  bool usable = true;
  auto sources = Json::array(), sessions = Json::array(), checks = Json::array();
  for (const auto& source : report.sources) {
    if (!arguments.json) print_source(source);
    sources.push_back(source_json(source));
  }
  for (const auto& session : report.sessions) {
    if (!arguments.json) {
      fmt::print("session \"{}\", {}: {:+.1f} dB to meet the reference events\n", session.session,
                 session.friction ? "friction" : "crumpling", session.gain_db);
    }
    sessions.push_back({{"session", session.session},
                        {"section", session.friction ? "friction" : "crumpling"},
                        {"gain_db", session.gain_db}});
  }
  for (const auto& missing : report.missing) {
    if (!arguments.json) fmt::print("missing: {}\n", missing);
  }
  for (const auto& [severity, what] : findings) {
    const bool error = severity == pack::Severity::kError;
    usable &= !error;
    if (!arguments.json) fmt::print("{}: {}\n", error ? "error" : "warning", what.text());
    checks.push_back({{"severity", error ? "error" : "warning"},
                      {"file", what.file},
                      {"field", what.field},
                      {"message", what.message},
                      {"remedy", what.remedy}});
  }
  if (arguments.json) {
    fmt::print("{}\n", Json{{"pack", arguments.output},
                            {"units", report.units},
                            {"spectra", report.spectra},
                            {"left_out", report.left_out},
                            {"sources", sources},
                            {"sessions", sessions},
                            {"missing", report.missing},
                            {"findings", checks}}
                           .dump());
  } else {
    fmt::print("{}: {} of crumpling and {} of friction written, {} left out\n", arguments.output,
               counted(static_cast<std::size_t>(report.units), "unit"),
               report.spectra == 1 ? "1 spectrum" : fmt::format("{} spectra", report.spectra),
               counted(static_cast<std::size_t>(report.left_out), "part"));
  }
  return usable ? kDone : kFailed;
}

}  // namespace

void add_pack_build(CLI::App& pack, Action& action) {
  auto arguments = std::make_shared<BuildArguments>();
  auto* command = pack.add_subcommand("build", "Make a pack of recordings");
  command->footer(
      "Example: rustle pack build --print-manifest > session/recordings.toml   # then say in it what the files are\n"
      "         rustle pack build session/ -o packs/my-paper && rustle pack show packs/my-paper -o my-paper.png\n"
      "Recordings are WAV, FLAC, OGG or MP3 of any rate and number of channels. Crumpling is cut into units by the energy "
      "in\n"
      "20 ms, slides are averaged into spectra; all that is left out is listed with its reason.");
  command->add_option("FOLDER", arguments->folder, "The folder of recordings");
  command->add_option("-o,--output", arguments->output, "The pack's folder to write");
  command->add_option("--manifest", arguments->manifest, "What the files are (TOML); FOLDER/recordings.toml when absent");
  command->add_flag("--force", arguments->force, "Replace a pack that is there already");
  command->add_flag("--json", arguments->json, "Print what was kept and left out as JSON");
  command->add_flag("--print-manifest,--example", arguments->print_manifest, "Print an explained manifest to start from");
  command->callback([arguments, &action] { action = [arguments] { return run_build(*arguments); }; });
}

}  // namespace rustle::apps
