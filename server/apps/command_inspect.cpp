#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <cmath>
#include <filesystem>
#include <limits>
#include <memory>
#include <nlohmann/json.hpp>

#include "server/analysis/sheet_analyzer.h"
#include "server/apps/capture_source.h"
#include "server/apps/command.h"
#include "server/report/sheet_picture.h"
#include "server/scene/scene_state.h"
#include "server/sinks/event_log.h"

namespace rustle::apps {
namespace {

constexpr double kEventsShown_s = 0.1;  // before the frame

struct InspectArguments {
  std::string capture, output;
  double time_s = std::numeric_limits<double>::quiet_NaN();
  std::optional<std::uint32_t> sheet;
  bool json = false;
};

/// The analysis of the sheets up to one time, and what is known of that moment.
struct Moment {
  sheet::MeshFrame frame;
  observation::Observation observation;
  std::vector<observation::CrumplingEvent> recent;
  std::vector<scene::Obstacle> obstacles;
  std::optional<sheet::Vec3d> listener_m;
  std::string sheet_name;
};

tl::expected<Moment, std::string> analyse_until(const InspectArguments& arguments, CaptureSource& source) {
  struct Sheet {
    engine::SheetDescription description;
    std::unique_ptr<analysis::SheetAnalyzer> analyzer;
    std::optional<sheet::MeshFrame> newest, previous;
    observation::Observation observation;
    std::vector<observation::CrumplingEvent> recent;
  };
  std::map<sheet::SheetId, Sheet> sheets;
  scene::SceneState scene;
  std::uint64_t next_event_id = 1;
  std::optional<sheet::SheetId> shown = arguments.sheet;
  while (auto item = source.next()) {
    if (auto* described = std::get_if<engine::SheetDescription>(&*item)) {
      auto& sheet = sheets[described->id];
      sheet.description = *described;
      sheet.analyzer = std::make_unique<analysis::SheetAnalyzer>(described->id, analysis::Parameters{});
    } else if (auto* update = std::get_if<scene::SceneUpdate>(&*item)) {
      if (auto applied = scene.apply(*update); !applied) warn(applied.error());
    } else if (auto* listener = std::get_if<scene::Listener>(&*item)) {
      if (auto applied = scene.apply(*listener); !applied) warn(applied.error());
    } else if (auto* frame = std::get_if<sheet::MeshFrame>(&*item)) {
      if (frame->time_s > arguments.time_s + 1e-9) break;
      if (!shown) shown = frame->sheet;
      Sheet& sheet = sheets[frame->sheet];
      std::vector<analysis::NeighbourSheet> others;
      for (const auto& [id, other] : sheets) {
        if (id == frame->sheet || !other.newest) continue;
        const bool comparable = other.previous && other.previous->topology == other.newest->topology;
        others.push_back({id, &*other.newest, comparable ? &*other.previous : nullptr, other.description.material});
      }
      sheet.observation = sheet.analyzer->analyze(
          *frame, {&scene, others, sheet.description.touched_surface, sheet.description.material}, next_event_id);
      for (const auto& event : sheet.observation.crumpling) sheet.recent.push_back(event);
      std::erase_if(sheet.recent, [&](const auto& event) { return event.time_s < frame->time_s - kEventsShown_s; });
      sheet.previous = std::move(sheet.newest);
      sheet.newest = std::move(*frame);
    }
  }
  const auto found = shown ? sheets.find(*shown) : sheets.end();
  if (found == sheets.end() || !found->second.newest) {
    return tl::unexpected(fmt::format("{}: {} has no frame up to {} s; its first is at {:.3f} s", arguments.capture,
                                      shown ? fmt::format("sheet {}", *shown) : "it", arguments.time_s,
                                      source.first_time_s()));
  }
  Moment moment;
  moment.frame = std::move(*found->second.newest);
  moment.observation = std::move(found->second.observation);
  moment.recent = std::move(found->second.recent);
  moment.sheet_name = found->second.description.name;
  for (const auto& [id, track] : scene.obstacles()) {
    scene::Obstacle obstacle = track.description();
    obstacle.pose = track.pose(moment.frame.time_s);
    if (auto* mesh = std::get_if<scene::MeshShape>(&obstacle.shape)) track.vertices_m(moment.frame.time_s, mesh->vertices_m);
    moment.obstacles.push_back(std::move(obstacle));
  }
  if (auto listener = scene.listener(moment.frame.time_s)) moment.listener_m = listener->position_m;
  return moment;
}

report::EventMark mark_of(const observation::CrumplingEvent& event, sheet::SheetId sheet) {
  report::EventMark mark;
  mark.id = event.id;
  mark.sheet = sheet;
  mark.time_s = mark.end_s = event.time_s;
  mark.amplitude = event.amplitude_m;
  mark.area_m2 = event.area_m2;
  mark.position_m = event.position_m;
  return mark;
}

report::SheetView view_of(const Moment& moment, const analysis::RegionPicture& picture, const std::string& title) {
  report::SheetView view;
  const auto& topology = *picture.topology;
  view.title = title;
  view.time_s = moment.frame.time_s;
  view.positions_m = picture.positions_m;
  view.triangles.assign(topology.triangles().begin(), topology.triangles().end());
  view.triangle_regions = picture.map.region;
  view.region_curved = picture.map.region_curved;
  for (const auto ridge : picture.map.ridge) view.ridge_triangles.push_back(ridge != 0);
  view.curvature_per_m = picture.map.curvature_per_m;
  view.ruling_directions = picture.map.ruling;
  const auto borders = topology.border_edges();
  for (std::size_t k = 0; k < borders.size(); ++k) {
    view.borders.push_back(
        {borders[k].start, borders[k].end, k < picture.map.free_border.size() ? picture.map.free_border[k] : 0.0f});
  }
  const bool own_mesh = picture.topology == moment.frame.topology;
  if (own_mesh) {
    view.anchored = moment.frame.anchored;
    for (const auto& contact : moment.observation.friction) {
      for (const auto& vertex : contact.vertices) view.contacts.push_back(vertex.vertex);
    }
  }
  view.material_coordinates_m.assign(topology.material_coordinates_m().begin(), topology.material_coordinates_m().end());
  for (const auto& event : moment.recent) view.events.push_back(mark_of(event, moment.frame.sheet));
  view.obstacles = moment.obstacles;
  view.listener_m = moment.listener_m;
  if (!own_mesh) {
    view.facts.emplace_back("Drawn on",
                            fmt::format("the coarse proxy of {} triangles", moment.frame.topology->triangle_count()));
  }
  return view;
}

int run(const InspectArguments& arguments) {
  auto source = CaptureSource::open(arguments.capture);
  if (!source) return complain(source.error(), std::filesystem::exists(arguments.capture) ? kFailed : kWrongUsage);
  auto moment = analyse_until(arguments, *source);
  if (!moment) return complain(moment.error(), kFailed);
  const auto picture = analysis::picture_regions(moment->frame, analysis::Parameters{});
  if (!arguments.output.empty()) {
    const auto title = fmt::format("{} {}", std::filesystem::path(arguments.capture).stem().string(), moment->sheet_name);
    if (auto drawn = report::write_sheet_png(arguments.output, view_of(*moment, picture, title)); !drawn)
      return complain(drawn.error(), kFailed);
  }
  std::size_t contacts = 0, sliding = 0;
  for (const auto& contact : moment->observation.friction) {
    contacts += contact.vertices.size();
    sliding += contact.speed_m_per_s > 1e-3 ? 1 : 0;
  }
  if (arguments.json) {
    auto regions = nlohmann::ordered_json::array();
    for (std::size_t k = 0; k < picture.regions.size(); ++k) {
      const auto& r = picture.regions[k];
      regions.push_back({{"curved", static_cast<bool>(picture.map.region_curved[k])},
                         {"constrained", r.constrained},
                         {"coarse", r.coarse},
                         {"l_r_m", r.ruling_length_m},
                         {"l_c_m", r.free_border_length_m},
                         {"area_m2", r.area_m2},
                         {"position_m", {r.position_m.x(), r.position_m.y(), r.position_m.z()}}});
    }
    fmt::print("{}\n", nlohmann::ordered_json{{"time_s", moment->frame.time_s},
                                              {"sheet", moment->frame.sheet},
                                              {"triangles", moment->frame.topology->triangle_count()},
                                              {"regions", regions},
                                              {"touching_vertices", contacts},
                                              {"sliding_contacts", sliding},
                                              {"recent_events", moment->recent.size()}}
                           .dump());
  } else {
    fmt::print(
        "{} at {:.4f} s: {} triangles, {} regions, {} touching vertices, {} sliding contacts, {} events in the last {:.0f} "
        "ms{}\n",
        arguments.capture, moment->frame.time_s, moment->frame.topology->triangle_count(), picture.map.region_count,
        contacts, sliding, moment->recent.size(), 1e3 * kEventsShown_s,
        arguments.output.empty() ? "" : "; drawn to " + arguments.output);
  }
  return kDone;
}

}  // namespace

void add_inspect(CLI::App& app, Action& action) {
  auto arguments = std::make_shared<InspectArguments>();
  auto* command = app.add_subcommand("inspect", "Draw what the analysis sees in one frame of a capture");
  command->footer("Example: rustle inspect crumple.mcap --time 1.5 -o frame.png");
  command->add_option("CAPTURE", arguments->capture, "The capture (.mcap)")->required();
  command->add_option("--time", arguments->time_s, "Simulation time in s: the last frame up to it is shown")->required();
  command->add_option("--sheet", arguments->sheet, "Id of the sheet; the first one when absent");
  command->add_option("-o,--output", arguments->output, "PNG file to draw");
  command->add_flag("--json", arguments->json, "Print regions and contacts as JSON");
  command->callback([arguments, &action] { action = [arguments] { return run(*arguments); }; });
}

}  // namespace rustle::apps
