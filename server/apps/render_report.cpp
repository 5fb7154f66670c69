#include "server/apps/render_report.h"

#include <algorithm>
#include <filesystem>

#include "server/synthesis/limiter.h"

namespace rustle::apps {
namespace {

report::EventKind kind_of(sinks::LoggedEvent::Kind kind) {
  switch (kind) {
    case sinks::LoggedEvent::Kind::kFriction:
      return report::EventKind::kFriction;
    case sinks::LoggedEvent::Kind::kTearing:
      return report::EventKind::kTearing;
    case sinks::LoggedEvent::Kind::kCrumpling:
      break;
  }
  return report::EventKind::kCrumpling;
}

}  // namespace

void RenderFacts::see(const engine::StreamItem& item) {
  if (const auto* described = std::get_if<engine::SheetDescription>(&item)) {
    auto& sheet = sheets[described->id];
    sheet.id = described->id;
    sheet.name = described->name;
    sheet.kind = described->kind == engine::SheetKind::kCloth ? "cloth" : "paper";
    sheet.material = described->material;
  } else if (const auto* frame = std::get_if<sheet::MeshFrame>(&item)) {
    auto& sheet = sheets[frame->sheet];
    sheet.vertices = frame->topology->vertex_count();
    sheet.triangles = frame->topology->triangle_count();
  }
}

std::vector<report::EventMark> marks_of(const std::vector<sinks::LoggedEvent>& events) {
  std::vector<report::EventMark> marks;
  marks.reserve(events.size());
  for (const auto& event : events) {
    report::EventMark mark;
    mark.id = event.id;
    mark.kind = kind_of(event.kind);
    mark.sheet = event.sheet;
    mark.time_s = event.time_s;
    mark.end_s = mark.kind == report::EventKind::kCrumpling ? event.time_s : event.end_s;
    mark.amplitude = event.amplitude;
    mark.area_m2 = event.area_m2;
    mark.position_m = event.position_m;
    for (const auto& speed : event.speeds) mark.speeds.push_back({speed.time_s, speed.speed_m_per_s});
    for (const auto& r : event.resonators) {
      mark.resonators.push_back({r.constrained, r.coarse, r.ruling_length_m, r.free_border_length_m, r.area_m2});
    }
    marks.push_back(std::move(mark));
  }
  return marks;
}

tl::expected<void, std::string> write_render_report(const std::filesystem::path& file, const RenderFacts& facts,
                                                    const std::vector<sinks::LoggedEvent>& events,
                                                    const std::vector<float>& interleaved, pack::PackLibrary& packs) {
  report::RenderReport page;
  const auto& options = facts.options;
  page.title = std::filesystem::path(facts.capture).stem().string();
  page.capture = facts.capture;
  page.duration_s = facts.duration_s;
  page.mesh_frames = facts.frames;
  for (const auto& [id, sheet] : facts.sheets) {
    page.sheets.push_back(sheet);
    auto& material = page.sheets.back().material;
    if (options.every_material) material = *options.every_material;
    if (material.empty()) material = options.default_material;
  }
  page.seed = options.seed;
  page.mode = options.mode == engine::Mode::kPublished ? "published" : "corrected";
  page.render_s = facts.render_s;
  page.sound = {interleaved, engine::channels_of(options.layout), static_cast<double>(options.rate_hz),
                options.time_origin_s};
  page.limited_samples = facts.limited_samples;
  page.limit_db = synthesis::kLimiterKnee_db;
  page.events = marks_of(events);
  if (!page.sheets.empty()) {
    if (auto pack = packs.load(page.sheets.front().material, {}, static_cast<std::uint32_t>(options.rate_hz))) {
      page.facts.emplace_back("Sound pack", (*pack)->name + " " + (*pack)->version);
      if ((*pack)->crumpling) {
        for (const auto& unit : (*pack)->crumpling->units) {
          page.pack_grid.push_back({unit.point.ruling_length_m, unit.point.free_border_length_m});
        }
      }
    }
  }
  page.notices = facts.notices;
  return report::write_html_report(file, page);
}

}  // namespace rustle::apps
