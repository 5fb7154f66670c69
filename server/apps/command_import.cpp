#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>

#include "client_sdk/capture/import.h"
#include "server/apps/command.h"
#include "server/apps/wording.h"
#include "sound_db/pack/library.h"

namespace rustle::apps {
namespace {

struct ImportArguments {
  std::string input, output, up = "z", kind = "paper";
  capture::ImportOptions options;
  bool no_reflections = false;
  bool json = false;
};

int run(ImportArguments& arguments) {
  auto& options = arguments.options;
  options.up_axis = arguments.up == "y" ? v1::UP_AXIS_Y : v1::UP_AXIS_Z;
  options.sheet_kind = arguments.kind == "cloth" ? v1::SHEET_KIND_CLOTH : v1::SHEET_KIND_PAPER;
  options.reflecting = !arguments.no_reflections;
  if (auto conflict = output_conflict({arguments.input}, {arguments.output}); !conflict.empty())
    return complain(conflict, kWrongUsage);
  if (std::error_code unknown;
      std::filesystem::exists(arguments.output, unknown) && !std::filesystem::is_regular_file(arguments.output, unknown)) {
    return complain(fmt::format("{} is no regular file; name one", arguments.output), kWrongUsage);
  }
  if (!options.material.empty()) {
    if (auto found = pack::PackLibrary().find(options.material); !found) warn(found.error().text());
  }
  capture::ImportResult result;
  {
    Progress progress("importing");
    result =
        capture::import_capture(arguments.input, arguments.output, options, [&](double share) { progress.show(share); });
  }
  if (!result) return complain(result.error().text(), kFailed);
  const auto& summary = *result;
  if (arguments.json) {
    fmt::print("{}\n", nlohmann::ordered_json{{"capture", arguments.output},
                                              {"frames", summary.frames},
                                              {"topologies", summary.topologies},
                                              {"obstacles", summary.obstacles},
                                              {"reflecting_planes", summary.reflecting_planes},
                                              {"vertices", {summary.min_vertices, summary.max_vertices}},
                                              {"triangles", {summary.min_triangles, summary.max_triangles}},
                                              {"first_time_s", summary.first_time_s},
                                              {"last_time_s", summary.last_time_s},
                                              {"material_coordinates", summary.material_coordinates},
                                              {"messages", summary.messages},
                                              {"bytes", summary.bytes},
                                              {"remarks", summary.remarks}}
                           .dump());
    return kDone;
  }
  const std::string least = summary.min_triangles == summary.max_triangles ? "" : fmt::format("{}-", summary.min_triangles);
  fmt::print("{}: {} from {:.3f} to {:.3f} s, {}, {}{}, {}, {:.1f} MB\n", arguments.output, counted(summary.frames, "frame"),
             summary.first_time_s, summary.last_time_s, counted(summary.topologies, "topology"), least,
             counted(summary.max_triangles, "triangle"), counted(summary.obstacles, "obstacle"),
             static_cast<double>(summary.bytes) / 1e6);
  for (const auto& remark : summary.remarks) fmt::print("  {}\n", remark);
  return kDone;
}

}  // namespace

void add_import(CLI::App& app, Action& action) {
  auto arguments = std::make_shared<ImportArguments>();
  auto* command = app.add_subcommand("import", "Turn a NumPy .npz file or an OBJ/PLY sequence into a capture");
  command->footer("Example: rustle import frames/ --fps 60 --up y --scale 0.01 -o shirt.mcap");
  command->add_option("INPUT", arguments->input, ".npz file, .obj or .ply file, folder of them, or a quoted pattern")
      ->required();
  command->add_option("-o,--output", arguments->output, "The capture to write (.mcap)")->required();
  command->add_option("--scale", arguments->options.metres_per_unit, "Metres per unit of the input: 0.01 for centimetres")
      ->check(CLI::Range(1e-6, 1e6))
      ->capture_default_str();
  command->add_option("--up", arguments->up, "The input's up axis")->check(CLI::IsMember({"y", "z"}))->capture_default_str();
  command->add_option("--fps", arguments->options.frames_per_s, "Frames per second, where the input has no times")
      ->check(CLI::Range(1e-3, 1e6));
  command->add_option("--material", arguments->options.material, "The sheet's material, such as printer-paper");
  command->add_option("--kind", arguments->kind, "What the sheet is")
      ->check(CLI::IsMember({"paper", "cloth"}))
      ->capture_default_str();
  command->add_option("--touched-surface", arguments->options.touched_surface,
                      "What the sheet touches, such as wooden-table");
  command->add_option("--obstacle-surface", arguments->options.obstacle_surface, "Surface material of the obstacles");
  command->add_flag("--no-reflections", arguments->no_reflections, "Flat obstacles do not reflect sound");
  command->add_flag("--uv-is-material", arguments->options.texture_coordinates_are_material,
                    "OBJ: vt are the flat sheet's coordinates");
  command->add_option("--session", arguments->options.session_id,
                      "Session id in the capture; the output's name when absent");
  command->add_flag("--json", arguments->json, "Print the summary as JSON");
  command->callback([arguments, &action] { action = [arguments] { return run(*arguments); }; });
}

}  // namespace rustle::apps
