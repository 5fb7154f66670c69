#include "server/analysis/sheet_analyzer.h"

#include <algorithm>
#include <array>
#include <cassert>
#include <cmath>
#include <limits>
#include <numbers>
#include <numeric>
#include <utility>

#include "server/analysis/resonators.h"
#include "server/analysis/rigid_motion.h"
#include "server/analysis/shared_stencils.h"
#include "server/sheet/simd.h"
#include "server/sheet/transfer.h"

namespace rustle::analysis {
namespace {

using observation::Observation;
using observation::Resonator;
using sheet::Vec3d;
using sheet::Vec3f;
using sheet::Vec4f;

constexpr int kUnidentifiedFrames = 3;  // in a row: a single cut or repair is no matter
constexpr double kLongestUnit_s = 1.0;  // a crumpling unit sounds no longer after its event
constexpr double kSameEvent = 2;        // a continuation beyond so many times its event's amplitude is measured by itself

/// How much a moment may change for a partition to serve on.
struct BendingChange {
  float least_per_m, share, growth;
};

/// Whether at every node the moment m is what it was, or has become one between (1 - growth) m and (1 + growth) m, but for
/// least · area + share · Σ |θ||e| in each of its numbers.
RUSTLE_SIMD bool bent_alike(const Moment* then, const Moment* now, const float* areas_m2, std::size_t count,
                            const BendingChange& allowed) {
  const float low = 1 - allowed.growth, high = 1 + allowed.growth;
  std::int32_t others = 0;
  for (std::size_t n = 0; n < count; ++n) {
    const float *const m = then[n].data(), *const here = now[n].data();
    const float squared = m[0] * m[0] + m[1] * m[1] + m[2] * m[2], along = m[0] * here[0] + m[1] * here[1] + m[2] * here[2];
    const float ratio = along / (squared > 0 ? squared : 1.0f), clamped = ratio < low ? low : ratio > high ? high : ratio;
    const float grown = squared > 0 ? clamped : 1.0f, size = std::fabs(here[3] - m[3]);
    const float most = allowed.least_per_m * areas_m2[n] + allowed.share * m[3];
    const auto differs = [&](std::size_t k, float times) { return std::fabs(here[k] - times * m[k]) > most; };
    const bool moved = differs(0, 1) | differs(1, 1) | differs(2, 1) | (size > most);
    const bool turned = differs(0, grown) | differs(1, grown) | differs(2, grown) | (size - allowed.growth * m[3] > most);
    others += moved & turned;
  }
  return others == 0;
}

/// Σ |x|, in so many sums that none waits for itself.
double sum_of_sizes(std::span<const float> values) {
  constexpr std::size_t kSums = 8;
  std::array<double, kSums> sums{};
  std::size_t i = 0;
  for (; i + kSums <= values.size(); i += kSums) {
    for (std::size_t k = 0; k < kSums; ++k) sums[k] += static_cast<double>(std::fabs(values[i + k]));
  }
  for (; i < values.size(); ++i) sums[0] += static_cast<double>(std::fabs(values[i]));
  return std::accumulate(sums.begin(), sums.end(), 0.0);
}

/// What sounds where there is no triangle to vibrate.
Resonator constrained_at(const Vec3d& position_m, double area_m2) {
  Resonator out;
  out.coarse = true;
  out.position_m = position_m;
  out.area_m2 = area_m2;
  out.disc_radius_m = std::sqrt(area_m2 / std::numbers::pi);
  return out;
}

/// Numbers the resonators of `contact` as those of the contacts before it, which are reached alike, and on from them.
void number_resonators(const std::vector<observation::FrictionContact>& contacts, observation::FrictionContact& contact) {
  std::uint32_t most = 0;
  for (Resonator& resonator : contact.resonators) {
    for (auto before = contacts.data(); before != &contact; ++before) {
      for (const Resonator& known : before->resonators) {
        most = std::max(most, known.number);
        if (known.position_m == resonator.position_m && known.area_m2 == resonator.area_m2) resonator.number = known.number;
      }
    }
  }
  for (Resonator& resonator : contact.resonators) {
    if (resonator.number == 0) resonator.number = ++most;
  }
}

/// Keeps the greatest events, in their order, which become greater by what the others had. Returns how many went.
/// \pre most > 0
std::size_t join_to_greatest(std::vector<observation::CrumplingEvent>& events, std::size_t most) {
  if (events.size() <= most) return 0;
  const auto squares_m2 = [&] {
    return std::accumulate(events.begin(), events.end(), 0.0,
                           [](double sum, const auto& event) { return sum + event.amplitude_m * event.amplitude_m; });
  };
  std::vector<std::size_t> by_amplitude(events.size());
  std::iota(by_amplitude.begin(), by_amplitude.end(), std::size_t{0});
  std::stable_sort(by_amplitude.begin(), by_amplitude.end(),
                   [&](std::size_t a, std::size_t b) { return events[a].amplitude_m > events[b].amplitude_m; });
  std::sort(by_amplitude.begin(), by_amplitude.begin() + static_cast<std::ptrdiff_t>(most));
  const double all_m2 = squares_m2();
  const std::size_t joined = events.size() - most;
  for (std::size_t k = 0; k < most; ++k) {
    if (by_amplitude[k] != k) events[k] = std::move(events[by_amplitude[k]]);
  }
  events.resize(most);
  const double kept_m2 = squares_m2();
  for (auto& event : events) event.amplitude_m *= kept_m2 > 0 ? std::sqrt(all_m2 / kept_m2) : 1;
  return joined;
}

std::uint32_t nearest_triangle(const RegionStencils& stencils, std::span<const Vec4f> positions_m, const Vec3d& point_m) {
  std::uint32_t best = sheet::kNone;
  float best_distance = std::numeric_limits<float>::infinity();
  const Vec3f near = point_m.cast<float>();
  const Vec4f point(near.x(), near.y(), near.z(), 0);
  const auto triangles = stencils.topology->triangles();
  for (std::uint32_t f = 0; f < triangles.size(); ++f) {
    const sheet::Triangle& v = triangles[f];
    const float distance = ((positions_m[v[0]] + positions_m[v[1]] + positions_m[v[2]]) / 3.0f - point).squaredNorm();
    if (distance < best_distance) best = f, best_distance = distance;
  }
  return best;
}

/// The triangles around the corner nearest to the point of the triangle nearest to it.
void triangles_at(const RegionStencils& stencils, std::span<const Vec4f> positions_m, const Vec3d& point_m,
                  std::vector<std::uint32_t>& out) {
  out.clear();
  const std::uint32_t f = nearest_triangle(stencils, positions_m, point_m);
  if (f == sheet::kNone) return;
  const sheet::Triangle& corners = stencils.topology->triangles()[f];
  const std::uint32_t v = *std::min_element(corners.begin(), corners.end(), [&](std::uint32_t a, std::uint32_t b) {
    const Vec3f point = point_m.cast<float>();
    return (positions_m[a].head<3>() - point).squaredNorm() < (positions_m[b].head<3>() - point).squaredNorm();
  });
  for (std::uint32_t k = stencils.triangle_start[v]; k < stencils.triangle_start[v + 1]; ++k)
    out.push_back(stencils.triangles_around[k]);
}

std::vector<Vec3f> carried(const sheet::Transfer& transfer, const std::vector<Vec3f>& values) {
  std::vector<Vec3f> out(transfer.origins.size());
  for (std::size_t i = 0; i < out.size(); ++i) {
    const auto& o = transfer.origins[i];
    out[i] =
        o.weights[0] * values[o.vertices[0]] + o.weights[1] * values[o.vertices[1]] + o.weights[2] * values[o.vertices[2]];
  }
  return out;
}

}  // namespace

SheetAnalyzer::SheetAnalyzer(sheet::SheetId sheet, const Parameters& parameters)
    : sheet_(sheet), parameters_(parameters), finder_(parameters), bent_finder_(parameters) {}

Observation SheetAnalyzer::analyze(const sheet::MeshFrame& frame, const SheetSurroundings& surroundings,
                                   std::uint64_t& next_event_id, const Effort& effort) {
  assert(frame.topology != nullptr && frame.positions_m.size() == frame.topology->vertex_count());
  if (frame.reset_history || (state_.last && frame.time_s < state_.last->time_s)) forget();
  Observation out;
  out.sheet = sheet_;
  out.time_s = frame.time_s;
  out.topology = frame.topology;
  out.previous_time_s = state_.last ? state_.last->time_s : frame.time_s;

  const std::shared_ptr<const sheet::Topology> before = state_.curvature ? state_.curvature->topology : nullptr;
  const std::optional<Arrival> arrival = follow_topology(frame);
  if (arrival) out.origins = arrival->origins;
  const CurvatureStencils& curvature = *state_.curvature;
  const Vec3f near_m = sheet::mean_position_m(frame.positions_m);
  const Vec3d origin_m = near_m.cast<double>();
  sheet::relative_positions_m(frame.positions_m, near_m, scratch_.relative_m);
  scratch_.angles_rad.resize(curvature.hinges.size());
  sheet::dihedral_angles_rad(curvature.hinges, scratch_.relative_m, scratch_.angles_rad);
  const CrumplingInputs inputs{curvature,
                               scratch_.angles_rad,
                               frame.positions_m,
                               frame.velocities_m_per_s,
                               last_positions_m(),
                               frame.time_s,
                               arrival ? &arrival->remade : nullptr,
                               arrival && arrival->silent};
  out.crumpling = find_crumpling(inputs, parameters_, state_.crumpling, next_event_id);
  out.events_joined = join_to_greatest(out.crumpling, effort.most_events);
  state_.unidentified_frames = arrival && arrival->unidentified ? state_.unidentified_frames + 1 : 0;
  out.unidentified = state_.unidentified_frames >= kUnidentifiedFrames;
  const BendingInputs bending{state_.patches,      curvature, state_.crumpling.curvature_per_m,
                              scratch_.relative_m, origin_m,  arrival.has_value()};
  find_bending(bending, state_.bending, out.bending);
  if (!out.crumpling.empty() || !out.bending.empty()) state_.crumpled_s = frame.time_s;
  if (frame.time_s - state_.crumpled_s < kLongestUnit_s && last_positions_m().size() == frame.positions_m.size())
    out.motion = nearest_rigid_motion(last_positions_m(), frame.positions_m);

  out.tears = tears_of(frame, before.get(), arrival, next_event_id);
  if (state_.last_applies) state_.last->topology = frame.topology;
  out.friction = contacts_.update({frame, state_.last ? &*state_.last : nullptr, surroundings, parameters_.contact_radius_m,
                                   near_m, scratch_.relative_m},
                                  next_event_id);

  const bool tears = std::any_of(out.tears.begin(), out.tears.end(), [](const auto& t) { return t.speed_m_per_s > 0; });
  const bool begins = !all_ring_on(out) || tears ||
                      std::any_of(out.friction.begin(), out.friction.end(),
                                  [&](const auto& contact) { return contact.speed_m_per_s > parameters_.sliding_m_per_s; });
  remember_bending(frame.time_s);
  if (begins) find_resonators(frame, origin_m, effort, out);
  remember(frame);
  return out;
}

std::span<const Vec3f> SheetAnalyzer::last_positions_m() const {
  if (state_.last_applies) return state_.last->positions_m;
  return state_.carried_m;
}

void SheetAnalyzer::forget() {
  state_.crumpling.primed = false;
  state_.bending = {};
  state_.region_history = {};
  state_.partition_moments.clear();
  state_.last.reset();
  state_.last_applies = false;
  state_.earlier_m.clear();
  state_.bent.clear();
  state_.rung.clear();
  state_.sent_tips.clear();
  state_.sends_tips = false;
  state_.tears = {};
  state_.crumpled_s = -std::numeric_limits<double>::infinity();
  contacts_.reset();
}

std::optional<SheetAnalyzer::Arrival> SheetAnalyzer::follow_topology(const sheet::MeshFrame& frame) {
  if (state_.last_applies && state_.last->topology == frame.topology) return std::nullopt;
  if (state_.curvature && sheet::same_structure(*state_.curvature->topology, *frame.topology)) return std::nullopt;
  std::optional<sheet::Transfer> transfer;
  Arrival arrival;
  const bool has_history = state_.curvature && state_.crumpling.primed && state_.last && !state_.last->positions_m.empty();
  if (has_history) {
    const sheet::Topology& from = *state_.curvature->topology;
    const sheet::Topology& to = *frame.topology;
    if (!from.material_coordinates_m().empty() && !to.material_coordinates_m().empty()) {
      transfer = sheet::transfer_by_material(from, to);
      ++changes_.by_material;
    } else {
      arrival.silent = true;
      if (!from.rest_positions_m().empty() && !to.rest_positions_m().empty()) {
        transfer = sheet::transfer_by_position(from, from.rest_positions_m(), to, to.rest_positions_m());
      }
      if (!transfer) {
        std::vector<Vec3f> expected = state_.last->positions_m;
        const double step = state_.last->time_s - state_.earlier_s;
        if (!state_.earlier_m.empty() && step > 0) {
          const auto share = static_cast<float>((frame.time_s - state_.last->time_s) / step);
          for (std::size_t i = 0; i < expected.size(); ++i) expected[i] += share * (expected[i] - state_.earlier_m[i]);
        }
        transfer = sheet::transfer_by_position(from, expected, to, frame.positions_m);
      }
      ++(transfer ? changes_.by_position : changes_.history_lost);
    }
  }
  const bool own_shape = frame.topology->material_coordinates_m().empty() && frame.topology->rest_positions_m().empty();
  const bool whole = transfer && std::find(transfer->remade.begin(), transfer->remade.end(), true) == transfer->remade.end();
  sheet::RestPlane plane = own_shape && whole ? sheet::renumbered(state_.curvature->plane, *transfer, *frame.topology)
                                              : sheet::rest_plane(*frame.topology, frame.positions_m);
  if (has_history && transfer && !arrival.silent) {
    carry_by_material(*state_.curvature->topology, state_.patches, *frame.topology, state_.bending);
  } else if (whole) {
    carry(*transfer, state_.bending);
  } else {
    carry_by_rank(state_.patches, state_.bending);
  }
  arrival.unidentified = arrival.silent && !whole;
  state_.patches = bending_patches(*frame.topology, plane);
  state_.curvature = shared_curvature_stencils(frame.topology, std::move(plane), parameters_);
  state_.regions.reset();
  state_.sent_regions.reset();
  state_.region_history = {};
  state_.partition_moments.clear();
  state_.bent.clear();
  state_.earlier_m.clear();
  state_.last_applies = false;
  if (!transfer) {
    state_.crumpling.primed = false;
    return has_history ? std::optional<Arrival>(std::move(arrival)) : std::nullopt;
  }
  carry(*transfer, parameters_, state_.crumpling);
  state_.carried_m = carried(*transfer, state_.last->positions_m);
  for (const sheet::Transfer::Origin& origin : transfer->origins) arrival.origins.push_back(origin.closest());
  arrival.remade = std::move(transfer->remade);
  return arrival;
}

bool SheetAnalyzer::all_ring_on(Observation& observation) {
  std::erase_if(state_.rung,
                [&](const auto& known) { return observation.time_s - known.second->time_s >= parameters_.event_merge_s; });
  bool all = true;
  for (auto& event : observation.crumpling) {
    const auto before = state_.rung.find(event.continues);
    if (before == state_.rung.end() || event.amplitude_m > kSameEvent * before->second->amplitude_m) {
      all = false;
      continue;
    }
    event.resonators = before->second->resonators;
    state_.rung[event.id] = before->second;
  }
  return all;
}

/// Whether the last partition is still that of the sheet as it is now bent. Where regions end is settled by the directions
/// of bending and by its size beside that nearby: where it merely grows or shrinks somewhat, regions stay.
bool SheetAnalyzer::partition_serves(double time_s, const Effort& effort) const {
  const auto &then = state_.partition_moments, &now = state_.crumpling.now.moments;
  if (then.size() != now.size()) return false;
  const double age_s = time_s - state_.partition_s;
  if (age_s < effort.partition_serves_s) return true;
  if (age_s > parameters_.partition_age_s) return false;
  const BendingChange allowed{static_cast<float>(parameters_.partition_change_per_m),
                              static_cast<float>(parameters_.partition_change_relative),
                              static_cast<float>(parameters_.partition_growth)};
  return bent_alike(then.data(), now.data(), state_.curvature->node_area_m2.data(), now.size(), allowed);
}

void SheetAnalyzer::find_resonators(const sheet::MeshFrame& frame, const Vec3d& origin_m, const Effort& effort,
                                    Observation& observation) {
  const sheet::SentPartition* sent =
      frame.partition && usable(*frame.partition, *frame.topology) ? &*frame.partition : nullptr;
  std::shared_ptr<const RegionMesh>& mesh = sent != nullptr ? state_.sent_regions : state_.regions;
  if (!mesh) mesh = shared_region_mesh(state_.curvature->topology, state_.curvature->plane, parameters_, sent == nullptr);
  const RegionStencils& stencils = mesh->stencils;
  Scratch& scratch = scratch_;
  const std::span<const Vec4f> positions_m = mesh->positions_m(state_.bent.back().relative_m, scratch.positions_m);
  RegionFrame here{positions_m, {}};
  if (!mesh->proxy && state_.curvature->in_edge_order) {
    here.angles_rad = scratch.angles_rad;
    if (stencils.nodes.of_vertex == state_.curvature->nodes.of_vertex) here.moments = state_.crumpling.now.moments;
  }
  const bool same_map = sent == nullptr && partition_serves(frame.time_s, effort);
  if (sent != nullptr) {
    adopt_partition(*sent, stencils, here, parameters_, scratch.regions, scratch.map);
    state_.partition_moments.clear();
  } else if (!same_map) {
    state_.partition_moments = state_.crumpling.now.moments;
    state_.partition_s = frame.time_s;
    segment(stencils, here, frame.time_s, parameters_, &state_.region_history, scratch.regions, scratch.map);
  }
  mesh->gather_marks(frame.anchored, scratch.holds.anchored);
  scratch.holds.touching.assign(stencils.topology->vertex_count(), 0);
  scratch.marks.assign(stencils.topology->vertex_count(), 0);
  const auto vertices_of = [&](const observation::FrictionContact& contact) {
    scratch.vertices.clear();
    for (const auto& vertex : contact.vertices) scratch.vertices.push_back(vertex.vertex);
    return std::span<const std::uint32_t>(scratch.vertices);
  };
  for (const auto& contact : observation.friction) mesh->mark(vertices_of(contact), scratch.holds.touching);
  finder_.turn_to({stencils, scratch.map, positions_m, origin_m, scratch.holds, sent}, same_map);

  // What flips passes through flat; it sounds as what it was when it was bent most.
  bool has_bent = false;
  const auto is_flat = [](const Resonator& resonator) { return resonator.constrained && resonator.ruling_length_m == 0; };
  for (auto& event : observation.crumpling) {
    mesh->gather_triangles(event.vertices, scratch.marks, scratch.triangles);
    event.resonators = finder_.reached_from(scratch.triangles, ResonatorFinder::StopAt::kRidgesAndHolds);
    if (sent == nullptr && !state_.bent.empty() && std::all_of(event.resonators.begin(), event.resonators.end(), is_flat)) {
      if (!has_bent) {
        has_bent = true;
        const auto bent_m = mesh->positions_m(state_.bent.front().relative_m, scratch.bent_positions_m);
        segment(stencils, {bent_m, {}}, frame.time_s, parameters_, nullptr, scratch.regions, scratch.bent_map);
        bent_finder_.turn_to({stencils, scratch.bent_map, bent_m, origin_m, scratch.holds, nullptr});
      }
      event.resonators = bent_finder_.reached_from(scratch.triangles, ResonatorFinder::StopAt::kRidgesAndHolds);
    }
    if (event.resonators.empty()) event.resonators.push_back(constrained_at(event.position_m, event.area_m2));
    state_.rung[event.id] = std::make_shared<const Rung>(Rung{frame.time_s, event.amplitude_m, event.resonators});
  }
  for (auto& contact : observation.friction) {
    if (contact.speed_m_per_s <= parameters_.sliding_m_per_s) continue;
    mesh->gather_triangles(vertices_of(contact), scratch.marks, scratch.triangles);
    contact.resonators = finder_.reached_from(scratch.triangles, ResonatorFinder::StopAt::kRidgesAndAnchors);
    number_resonators(observation.friction, contact);
    if (contact.resonators.empty()) contact.resonators.push_back(constrained_at(contact.position_m, contact.area_m2));
  }
  for (auto& tear : observation.tears) {
    if (tear.speed_m_per_s <= 0) continue;
    if (tear.vertex != sheet::kNone) {
      mesh->gather_triangles(std::span(&tear.vertex, 1), scratch.marks, scratch.triangles);
    } else {
      triangles_at(stencils, positions_m, tear.position_m - origin_m, scratch.triangles);
    }
    tear.resonators = finder_.reached_from(scratch.triangles, ResonatorFinder::StopAt::kRidgesAndHolds);
    if (tear.resonators.empty()) tear.resonators.push_back(constrained_at(tear.position_m, 0));
  }
}

void SheetAnalyzer::remember_bending(double time_s) {
  const auto& curvature_per_m = state_.crumpling.curvature_per_m;
  const double bending_per_m =
      curvature_per_m.empty() ? 0 : sum_of_sizes(curvature_per_m) / static_cast<double>(curvature_per_m.size());
  auto& bent = state_.bent;
  const auto let_go = [&](auto entry) {  // its memory is used again
    scratch_.spare_m.push_back(std::move(entry->relative_m));
    bent.erase(entry);
  };
  while (!bent.empty() && bent.front().time_s < time_s - parameters_.flip_memory_s) let_go(bent.begin());
  while (!bent.empty() && bent.back().bending_per_m <= bending_per_m) let_go(bent.end() - 1);
  bent.push_back({time_s, bending_per_m, std::move(scratch_.relative_m)});
  scratch_.relative_m.clear();
  if (scratch_.spare_m.empty()) return;
  scratch_.relative_m.swap(scratch_.spare_m.back());
  scratch_.spare_m.pop_back();
}

void SheetAnalyzer::remember(const sheet::MeshFrame& frame) {
  state_.earlier_m.swap(state_.last_applies ? state_.last->positions_m : state_.carried_m);
  if (state_.last) state_.earlier_s = state_.last->time_s;
  state_.carried_m.clear();
  state_.last = frame;
  state_.last_applies = true;
}

RegionPicture picture_regions(const sheet::MeshFrame& frame, const Parameters& parameters,
                              std::span<const observation::FrictionContact> contacts) {
  RegionPicture out;
  const Vec3f near_m = sheet::mean_position_m(frame.positions_m);
  const Vec3d origin_m = near_m.cast<double>();
  std::vector<Vec4f> relative_m, gathered_m;
  sheet::relative_positions_m(frame.positions_m, near_m, relative_m);
  const sheet::SentPartition* sent =
      frame.partition && usable(*frame.partition, *frame.topology) ? &*frame.partition : nullptr;
  const RegionMesh mesh =
      region_mesh(frame.topology, sheet::rest_plane(*frame.topology, frame.positions_m), parameters, sent == nullptr);
  const std::span<const Vec4f> positions_m = mesh.positions_m(relative_m, gathered_m);
  RegionScratch scratch;
  if (sent != nullptr) {
    adopt_partition(*sent, mesh.stencils, {positions_m, {}}, parameters, scratch, out.map);
  } else {
    segment(mesh.stencils, {positions_m, {}}, frame.time_s, parameters, nullptr, scratch, out.map);
  }
  out.topology = mesh.stencils.topology;
  for (const Vec4f& p : positions_m) out.positions_m.push_back((origin_m + p.head<3>().cast<double>()).cast<float>());
  for (std::size_t f = 0; f < out.map.region.size(); ++f) {
    out.rulings.push_back(ruling_in_space(mesh.stencils, out.map, positions_m, f));
  }
  mesh.gather_marks(frame.anchored, out.holds.anchored);
  out.holds.touching.assign(positions_m.size(), 0);
  std::vector<std::uint32_t> vertices;
  for (const auto& contact : contacts) {
    for (const auto& vertex : contact.vertices) vertices.push_back(vertex.vertex);
  }
  mesh.mark(vertices, out.holds.touching);
  ResonatorFinder finder(parameters);
  finder.turn_to({mesh.stencils, out.map, positions_m, origin_m, out.holds, sent});
  for (std::uint32_t r = 0; r < out.map.region_count; ++r) out.regions.push_back(finder.region(r));
  return out;
}

}  // namespace rustle::analysis
