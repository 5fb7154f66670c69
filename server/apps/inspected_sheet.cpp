#include "server/apps/inspected_sheet.h"

#include <fmt/format.h>

#include <algorithm>

#include "server/apps/command.h"

namespace rustle::apps {
namespace {

template <typename Ids>
std::string nothing_of(const std::optional<sheet::SheetId>& wanted, const Ids& present) {
  if (present.empty()) return "has no frame at all; make a capture with `rustle import`";
  std::string ids;
  for (const auto id : present) ids += fmt::format("{}{}", ids.empty() ? "" : ", ", id);
  return fmt::format("sheet {} has no frame; name one that has with --sheet: {}", wanted.value_or(0), ids);
}

template <typename Distance>
std::optional<std::uint32_t> nearest(std::size_t count, const Distance& distance) {
  std::optional<std::uint32_t> best;
  double least = 0;
  for (std::uint32_t i = 0; i < count; ++i) {
    const double here = distance(i);
    if (best && here >= least) continue;
    best = i;
    least = here;
  }
  return best;
}

report::ResonatorMark mark_of(const observation::Resonator& resonator) {
  return {resonator.constrained, resonator.coarse, resonator.ruling_length_m, resonator.free_border_length_m,
          resonator.area_m2};
}

report::EventMark mark_of(const observation::CrumplingEvent& event, sheet::SheetId sheet, const sheet::Vec3d& place_m) {
  report::EventMark mark;
  mark.id = event.id;
  mark.sheet = sheet;
  mark.time_s = mark.end_s = event.time_s;
  mark.amplitude = event.amplitude_m;
  mark.area_m2 = event.area_m2;
  mark.position_m = place_m;
  for (const auto& resonator : event.resonators) mark.resonators.push_back(mark_of(resonator));
  return mark;
}

/// What is drawn of a partition. A border edge is free as P5 has it: curved, of a bent region, and held at neither end.
void draw_partition(const analysis::RegionPicture& picture, report::SheetView& view) {
  const auto& topology = *picture.topology;
  view.positions_m = picture.positions_m;
  view.triangles.assign(topology.triangles().begin(), topology.triangles().end());
  view.triangle_regions = picture.map.region;
  view.region_curved = picture.map.region_curved;
  for (const auto& region : picture.regions) view.resonators.push_back(mark_of(region));
  for (const auto ridge : picture.map.ridge) view.ridge_triangles.push_back(ridge != 0);
  view.curvature_per_m = picture.map.curvature_per_m;
  view.ruling_directions = picture.rulings;
  const auto held = [&](std::uint32_t vertex) {
    return picture.holds.anchored[vertex] != 0 || picture.holds.touching[vertex] != 0;
  };
  const auto borders = topology.border_edges();
  for (std::size_t k = 0; k < borders.size(); ++k) {
    const auto& edge = borders[k];
    const bool free = picture.map.region_curved[picture.map.region[edge.triangle]] && !held(edge.start) && !held(edge.end);
    view.borders.push_back({edge.start, edge.end, free ? static_cast<double>(picture.map.free_border[k]) : 0});
  }
  for (const auto anchored : picture.holds.anchored) view.anchored.push_back(anchored != 0);
  view.material_coordinates_m.assign(topology.material_coordinates_m().begin(), topology.material_coordinates_m().end());
}

}  // namespace

std::string SheetTimes::nothing() const {
  return nothing_of(sheet, present);
}

SheetTimes sheet_times(CaptureSource& source, std::optional<sheet::SheetId> wanted) {
  SheetTimes out;
  while (auto item = source.next()) {
    const auto* frame = std::get_if<sheet::MeshFrame>(&*item);
    if (frame == nullptr) continue;
    if (!wanted) wanted = frame->sheet;
    if (std::find(out.present.begin(), out.present.end(), frame->sheet) == out.present.end())
      out.present.push_back(frame->sheet);
    if (frame->sheet == *wanted) out.times_s.push_back(frame->time_s);
  }
  std::sort(out.present.begin(), out.present.end());
  out.sheet = wanted.value_or(0);
  return out;
}

std::size_t InspectedMoment::coarse_regions() const {
  return static_cast<std::size_t>(std::count_if(regions.begin(), regions.end(), [](const auto& r) { return r.coarse; }));
}

void InspectedSheet::analyse(sheet::MeshFrame frame) {
  Sheet& sheet = sheets_[frame.sheet];
  if (!sheet.analyzer) sheet.analyzer = std::make_unique<analysis::SheetAnalyzer>(frame.sheet, analysis::Parameters{});
  std::vector<analysis::NeighbourSheet> others;
  for (const auto& [id, other] : sheets_) {
    if (id == frame.sheet || !other.newest) continue;
    const bool comparable = other.previous && other.previous->topology == other.newest->topology;
    others.push_back({id, &*other.newest, comparable ? &*other.previous : nullptr, other.description.material});
  }
  sheet.observation = sheet.analyzer->analyze(
      frame, {&scene_, others, sheet.description.touched_surface, sheet.description.material}, next_event_id_);
  if (frame.sheet == *shown_) {
    for (const auto& event : sheet.observation.crumpling) {
      const auto at = nearest(event.vertices.size(), [&](std::uint32_t i) {
        return (frame.positions_m[event.vertices[i]].cast<double>() - event.position_m).squaredNorm();
      });
      events_.push_back({event, frame.topology, at ? std::optional(event.vertices[*at]) : std::nullopt});
    }
  }
  sheet.previous = std::move(sheet.newest);
  sheet.newest = std::move(frame);
}

bool InspectedSheet::next(double until_s) {
  while (!ended_) {
    auto item = source_.next();
    if (!item) break;
    if (auto* described = std::get_if<engine::SheetDescription>(&*item)) {
      auto& sheet = sheets_[described->id];
      sheet.description = *described;
      sheet.analyzer = std::make_unique<analysis::SheetAnalyzer>(described->id, analysis::Parameters{});
    } else if (auto* update = std::get_if<scene::SceneUpdate>(&*item)) {
      if (auto applied = scene_.apply(*update); !applied) warn(applied.error());
    } else if (auto* listener = std::get_if<scene::Listener>(&*item)) {
      if (auto applied = scene_.apply(*listener); !applied) warn(applied.error());
    } else if (auto* frame = std::get_if<sheet::MeshFrame>(&*item)) {
      if (frame->time_s > until_s) break;
      if (!shown_) shown_ = frame->sheet;
      const auto of = frame->sheet;
      analyse(std::move(*frame));
      if (of == *shown_) return true;
    }
  }
  ended_ = true;
  return false;
}

double InspectedSheet::time_s() const {
  return sheets_.at(*shown_).newest->time_s;
}

void InspectedSheet::forget_events_before(double time_s) {
  std::erase_if(events_, [&](const Placed& placed) { return placed.event.time_s < time_s; });
}

std::string InspectedSheet::nothing_until(double until_s) const {
  std::vector<sheet::SheetId> present;
  for (const auto& [id, sheet] : sheets_) {
    if (sheet.newest) present.push_back(id);
  }
  if (!present.empty()) return nothing_of(shown_, present);
  return fmt::format("{} has no frame up to {} s; its first is at {:.3f} s",
                     shown_ ? fmt::format("sheet {}", *shown_) : "it", until_s, source_.first_time_s());
}

sheet::Vec3d InspectedSheet::place_now(const Placed& placed, const sheet::MeshFrame& frame) const {
  if (!placed.vertex) return placed.event.position_m;
  if (placed.topology == frame.topology) return frame.positions_m[*placed.vertex].cast<double>();
  const auto then = placed.topology->material_coordinates_m(), now = frame.topology->material_coordinates_m();
  if (then.empty() || now.empty()) return placed.event.position_m;
  const sheet::Vec2f place = then[*placed.vertex];
  const auto vertex =
      nearest(now.size(), [&](std::uint32_t i) { return static_cast<double>((now[i] - place).squaredNorm()); });
  return vertex ? sheet::Vec3d(frame.positions_m[*vertex].cast<double>()) : placed.event.position_m;
}

void InspectedSheet::add_contacts(const Sheet& shown, InspectedMoment& moment) const {
  const double sliding_m_per_s = analysis::Parameters{}.sliding_m_per_s;
  const auto add = [&](const observation::FrictionContact& contact, const sheet::MeshFrame& frame, bool own) {
    const bool sliding = contact.speed_m_per_s > sliding_m_per_s;
    moment.touching_vertices += contact.vertices.size();
    moment.sliding_contacts += sliding ? 1 : 0;
    const auto material = frame.topology->material_coordinates_m();
    for (const auto& vertex : contact.vertices) {
      report::SheetView::Contact mark;
      mark.position_m = frame.positions_m[vertex.vertex].cast<double>();
      if (own && !material.empty()) mark.material_m = material[vertex.vertex];
      mark.sliding = sliding;
      moment.view.contacts.push_back(mark);
    }
  };
  for (const auto& contact : shown.observation.friction) add(contact, *shown.newest, true);
  for (const auto& [id, other] : sheets_) {  // what the sheet of the lower id reports of both
    if (id == *shown_ || !other.newest) continue;
    for (const auto& contact : other.observation.friction) {
      if (contact.partner == sheet::ContactPartner(sheet::SheetPartner{*shown_})) add(contact, *other.newest, false);
    }
  }
}

InspectedMoment InspectedSheet::moment() const {
  const Sheet& shown = sheets_.at(*shown_);
  const sheet::MeshFrame& frame = *shown.newest;
  const auto picture = analysis::picture_regions(frame, analysis::Parameters{}, shown.observation.friction);
  InspectedMoment moment;
  moment.sheet = *shown_;
  moment.sheet_name = shown.description.name;
  moment.triangles = frame.topology->triangle_count();
  moment.regions = picture.regions;
  report::SheetView& view = moment.view;
  view.time_s = frame.time_s;
  draw_partition(picture, view);
  moment.ridge_triangles =
      static_cast<std::size_t>(std::count(view.ridge_triangles.begin(), view.ridge_triangles.end(), true));
  add_contacts(shown, moment);
  for (const auto& placed : events_) view.events.push_back(mark_of(placed.event, *shown_, place_now(placed, frame)));
  for (const auto& [id, track] : scene_.obstacles()) {
    scene::Obstacle obstacle = track.description();
    obstacle.pose = track.pose(frame.time_s);
    if (auto* mesh = std::get_if<scene::MeshShape>(&obstacle.shape)) track.vertices_m(frame.time_s, mesh->vertices_m);
    view.obstacles.push_back(std::move(obstacle));
  }
  if (auto listener = scene_.listener(frame.time_s)) view.listener_m = listener->position_m;
  if (picture.topology != frame.topology) view.sheet_triangles = moment.triangles;
  return moment;
}

}  // namespace rustle::apps
