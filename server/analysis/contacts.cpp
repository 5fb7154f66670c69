#include "server/analysis/contacts.h"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <limits>
#include <utility>

#include "server/sheet/point_grid.h"

namespace rustle::analysis {
namespace {

using observation::FrictionContact;
using observation::Source;
using scene::Box;
using sheet::ContactPartner;
using sheet::MeshFrame;
using sheet::Vec3d;
using sheet::Vec3f;

constexpr std::uint64_t kNoId = std::numeric_limits<std::uint64_t>::max();
constexpr double kNeighbourReach_m = 0.1;  ///< a neighbour is moved on by less

Box bounds_of(std::span<const Vec3f> positions_m) {
  Eigen::AlignedBox3f box;
  for (const Vec3f& p : positions_m) box.extend(p);
  return box.isEmpty() ? Box() : Box(box.min().cast<double>(), box.max().cast<double>());
}

Box grown(const Box& box, double by_m) {
  if (box.isEmpty()) return box;
  return {Vec3d(box.min() - Vec3d::Constant(by_m)), Vec3d(box.max() + Vec3d::Constant(by_m))};
}

/// A third of every triangle around the vertices, all together. \pre vertices ascending
double dual_area_m2(const sheet::Topology& topology, std::span<const Vec3f> positions_m,
                    std::span<const std::uint32_t> vertices) {
  double sum_m2 = 0;
  for (const sheet::Triangle& t : topology.triangles()) {
    const auto among = std::count_if(
        t.begin(), t.end(), [&](std::uint32_t v) { return std::binary_search(vertices.begin(), vertices.end(), v); });
    if (among == 0) continue;
    const Vec3f& a = positions_m[t[0]];
    const double area_m2 = static_cast<double>((positions_m[t[1]] - a).cross(positions_m[t[2]] - a).norm()) / 2;
    sum_m2 += area_m2 * static_cast<double>(among) / 3;
  }
  return sum_m2;
}

}  // namespace

std::vector<FrictionContact> ContactTracker::update(const ContactInputs& inputs, std::uint64_t& next_event_id) {
  const MeshFrame& frame = inputs.frame;
  const MeshFrame* before = frame.reset_history ? nullptr : inputs.before;
  assert(frame.topology && frame.positions_m.size() == frame.topology->vertex_count() && inputs.radius_m > 0);
  if (before == nullptr) state_.episodes.clear();
  Work work{frame, before, inputs.surroundings, inputs.radius_m};
  if (before != nullptr && frame.velocities_m_per_s.empty()) work.over_s = std::max(0.0, frame.time_s - before->time_s);
  scratch_.geometry.update(frame, inputs.origin_m, inputs.relative_m);
  scratch_.found.clear();
  update_obstacles(work);
  if (frame.contacts) {
    add_sent_contacts({frame, inputs.surroundings, state_.surfaces, velocities(work), work.over_s, inputs.radius_m,
                       parameters_.longest_extrapolation_s},
                      scratch_.components, scratch_.found);
  } else if (!scratch_.geometry.bounds_m.isEmpty()) {
    touch_obstacles(work);
    touch_itself(work);
    touch_others(work);
  }
  keep_identities(work);
  return report(frame, next_event_id);
}

VertexVelocities ContactTracker::velocities(Work& work) {
  VertexVelocities out;
  if (!work.frame.velocities_m_per_s.empty()) {
    out.sent_m_per_s = work.frame.velocities_m_per_s;
  } else if (work.over_s > 0 && work.before->topology == work.frame.topology) {
    out.now_m = work.frame.positions_m;
    out.before_m = work.before->positions_m;
    out.interval_s = work.over_s;
  } else if (work.over_s > 0) {
    if (!work.located) locate_velocities(work.frame, *work.before, work.over_s, scratch_.located_m_per_s);
    work.located = true;
    out.located_m_per_s = scratch_.located_m_per_s;
  }
  return out;
}

void ContactTracker::update_obstacles(const Work& work) {
  if (!work.surroundings.scene) {
    state_.surfaces.clear();
    return;
  }
  std::erase_if(state_.surfaces, [&](const auto& entry) { return !work.surroundings.scene->find(entry.first); });
  for (const auto& [id, track] : work.surroundings.scene->obstacles()) {
    state_.surfaces[id].update(track, work.frame.time_s, work.over_s);
  }
}

void ContactTracker::touch_obstacles(Work& work) {
  const Box reach = grown(scratch_.geometry.bounds_m, work.radius_m);
  for (const auto& [id, obstacle] : state_.surfaces) {
    if (!obstacle.may_meet(reach)) continue;
    scratch_.obstacle.set(obstacle);
    const ContactPatch& patch =
        scratch_.meter.measure(scratch_.geometry, scratch_.obstacle, velocities(work), parameters_.weight, work.radius_m);
    if (patch.vertices.empty()) continue;
    const ContactPartner partner = sheet::ObstaclePartner{id};
    scratch_.components.split(work.frame, patch, partner, surface_of(work.surroundings, partner, work.frame.sheet), false,
                              scratch_.found);
  }
}

void ContactTracker::touch_itself(Work& work) {
  if (state_.unfolded.holds(scratch_.geometry)) return;
  const double least_m = parameters_.self_exclusion_radii * work.radius_m;
  if (!state_.along_surface || state_.along_surface->topology() != work.frame.topology ||
      state_.along_surface->least_m() != least_m) {
    state_.along_surface.emplace(work.frame.topology, work.frame.positions_m, least_m, parameters_.self_exclusion_edges);
  }
  state_.posed.update(work.frame.topology, work.frame.positions_m, scratch_.geometry.origin_m);
  const VertexVelocities moving = velocities(work);
  state_.self.set_same(state_.posed, moving, *state_.along_surface);
  const ContactPatch& patch =
      scratch_.meter.measure(scratch_.geometry, state_.self, moving, parameters_.weight, work.radius_m);
  if (patch.vertices.empty()) return;
  scratch_.components.split(work.frame, patch, sheet::SheetPartner{work.frame.sheet}, work.surroundings.material, true,
                            scratch_.found);
}

void ContactTracker::touch_others(Work& work) {
  std::vector<const NeighbourSheet*>& others = scratch_.others;
  others.clear();
  for (const NeighbourSheet& other : work.surroundings.others) {
    // The pair is the lower id's to report, or that of the one that sends its contacts.
    if (other.frame && other.id > work.frame.sheet && !lists_sheet(*other.frame, work.frame.sheet)) others.push_back(&other);
  }
  std::erase_if(state_.neighbours, [&](const auto& entry) {
    return std::none_of(others.begin(), others.end(), [&](const auto* other) { return other->id == entry.first; });
  });
  if (others.empty()) return;
  std::sort(others.begin(), others.end(), [](const auto* a, const auto* b) { return a->id < b->id; });
  const Box reach = grown(scratch_.geometry.bounds_m, work.radius_m);
  bool posed = false;
  for (const NeighbourSheet* other : others) {
    if (!reach.intersects(grown(bounds_of(other->frame->positions_m), kNeighbourReach_m))) continue;
    Neighbour& neighbour = state_.neighbours[other->id];
    NeighbourNow& now = neighbour.now;
    now.update(*other, work.frame.time_s, work.over_s, parameters_.longest_extrapolation_s);
    if (!reach.intersects(bounds_of(now.positions_m))) continue;
    if (!posed) state_.posed.update(work.frame.topology, work.frame.positions_m, scratch_.geometry.origin_m);
    posed = true;
    neighbour.posed.update(other->frame->topology, now.positions_m, scratch_.geometry.origin_m);
    neighbour.contact.set(state_.posed, neighbour.posed, now.velocities);
    const ContactPatch& patch = scratch_.meter.measure(scratch_.geometry, neighbour.contact,
                                                       now.velocity_known ? velocities(work) : VertexVelocities{},
                                                       parameters_.weight, work.radius_m);
    if (patch.vertices.empty()) continue;
    scratch_.components.split(work.frame, patch, sheet::SheetPartner{other->id}, other->material, false, scratch_.found);
  }
}

void ContactTracker::assign_overlaps() {
  std::sort(scratch_.overlaps.begin(), scratch_.overlaps.end(), [](const Overlap& a, const Overlap& b) {
    return a.area_m2 != b.area_m2 ? a.area_m2 > b.area_m2
                                  : std::pair(a.episode, a.contact) < std::pair(b.episode, b.contact);
  });
  for (const Overlap& overlap : scratch_.overlaps) {
    if (scratch_.ids[overlap.contact] != kNoId || scratch_.taken[overlap.episode]) continue;
    scratch_.ids[overlap.contact] = state_.episodes[overlap.episode].id;
    scratch_.taken[overlap.episode] = true;
  }
  scratch_.overlaps.clear();
}

/// By the vertices shared, on one topology.
void ContactTracker::match_vertices() {
  for (std::size_t e = 0; e < state_.episodes.size(); ++e) {
    const Episode& episode = state_.episodes[e];
    for (std::size_t c = 0; c < scratch_.found.size(); ++c) {
      const FrictionContact& contact = scratch_.found[c];
      if (!(contact.partner == episode.partner)) continue;
      double shared_m2 = 0;
      bool any = false;
      auto mine = episode.vertices.begin();
      for (const observation::VertexContact& vertex : contact.vertices) {
        while (mine != episode.vertices.end() && *mine < vertex.vertex) ++mine;
        if (mine == episode.vertices.end()) break;
        if (*mine != vertex.vertex) continue;
        any = true;
        shared_m2 += static_cast<double>(vertex.area_m2);
      }
      if (any) scratch_.overlaps.push_back({shared_m2, c, e});
    }
  }
  assign_overlaps();
}

/// By what lies within reach of where the episode would have slid.
void ContactTracker::match_places(const MeshFrame& frame, const MeshFrame& before, double reach_m) {
  const double interval_s = frame.time_s - before.time_s;
  for (std::size_t e = 0; e < state_.episodes.size(); ++e) {
    if (scratch_.taken[e]) continue;
    const Episode& episode = state_.episodes[e];
    double within_m = 0;
    std::optional<sheet::PointGrid<3>> grid;
    for (std::size_t c = 0; c < scratch_.found.size(); ++c) {
      const FrictionContact& contact = scratch_.found[c];
      if (scratch_.ids[c] != kNoId || !(contact.partner == episode.partner)) continue;
      if (!grid) {
        scratch_.expected_m.clear();
        for (const std::uint32_t v : episode.vertices) {
          scratch_.expected_m.push_back(before.positions_m[v].cast<double>() + interval_s * episode.slip_m_per_s);
        }
        const double area_m2 = dual_area_m2(*before.topology, before.positions_m, episode.vertices);
        within_m = std::max(reach_m, 1.5 * std::sqrt(area_m2 / static_cast<double>(episode.vertices.size())));
        grid.emplace(scratch_.expected_m, within_m);
      }
      double near_m2 = 0;
      bool any = false;
      for (const observation::VertexContact& vertex : contact.vertices) {
        bool near = false;
        grid->within(frame.positions_m[vertex.vertex].cast<double>(), within_m, [&](std::uint32_t, double) { near = true; });
        any = any || near;
        if (near) near_m2 += static_cast<double>(vertex.area_m2);
      }
      if (any) scratch_.overlaps.push_back({near_m2, c, e});
    }
  }
  assign_overlaps();
}

void ContactTracker::keep_identities(const Work& work) {
  scratch_.ids.assign(scratch_.found.size(), kNoId);
  scratch_.taken.assign(state_.episodes.size(), false);
  scratch_.overlaps.clear();
  if (work.before == nullptr) return;
  if (work.before->topology == work.frame.topology) match_vertices();
  match_places(work.frame, *work.before, work.radius_m);
}

bool ContactTracker::lone(const FrictionContact& contact, const MeshFrame& frame) const {
  if (contact.vertices.size() != 1) return false;
  const std::uint32_t vertex = contact.vertices.front().vertex;
  return dual_area_m2(*frame.topology, frame.positions_m, {&vertex, 1}) < parameters_.least_single_area_m2;
}

std::vector<FrictionContact> ContactTracker::report(const MeshFrame& frame, std::uint64_t& next_event_id) {
  std::vector<FrictionContact> reported;
  std::vector<Episode>& now = scratch_.episodes;  // those of two frames ago lend their memory
  now.resize(scratch_.found.size());
  if (!scratch_.found.empty()) reported.reserve(scratch_.found.size());
  for (std::size_t c = 0; c < scratch_.found.size(); ++c) {
    FrictionContact& contact = scratch_.found[c];
    Episode& episode = now[c];
    episode.partner = contact.partner;
    episode.slip_m_per_s = contact.speed_m_per_s * contact.direction;
    episode.vertices.clear();
    for (const observation::VertexContact& vertex : contact.vertices) episode.vertices.push_back(vertex.vertex);
    const bool detected = contact.source == Source::kDetected;
    const bool tiny = detected && contact.area_m2 < parameters_.least_area_m2;
    const bool followed = scratch_.ids[c] != kNoId;
    if (followed && scratch_.ids[c] != 0) {
      contact.id = scratch_.ids[c];
    } else if (!tiny && (followed || !detected || !lone(contact, frame))) {
      contact.id = next_event_id++;
    }
    episode.id = contact.id;
    if (contact.id != 0) reported.push_back(std::move(contact));
  }
  state_.episodes.swap(now);
  return reported;
}

void ContactTracker::reset() {
  state_ = State();
}

}  // namespace rustle::analysis
