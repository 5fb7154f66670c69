#include "server/analysis/crumpling.h"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <type_traits>

#include "server/sheet/point_grid.h"

namespace rustle::analysis {
namespace {

using observation::CrumplingEvent;
using sheet::Vec3d;

constexpr double kNever = -1e300;
constexpr double kLeastInterval_s = 1e-9;
constexpr double kOldestCrossing_s = 0.25;
constexpr double kLeastChange_per_m = 1e-9;

std::int8_t side_of(float h, double band) {
  return h > band ? 1 : h < -band ? -1 : 0;
}

void begin(const CrumplingInputs& in, const Parameters& parameters, CrumplingState& state) {
  const std::size_t n = in.positions_m.size();
  state.primed = true;
  state.time_s = in.time_s;
  state.curvature_per_m = state.now.mean_per_m;
  state.sign.resize(n);
  for (std::size_t i = 0; i < n; ++i) state.sign[i] = side_of(state.now.mean_per_m[i], parameters.event_band_per_m);
  state.crossed_s.assign(n, in.time_s);
  state.flipped_s.assign(n, kNever);
  state.flipped_to.assign(n, 0);
  state.flipped_in.assign(n, 0);
  state.past.clear();
  state.past.push_back({in.time_s, state.now.mean_per_m});
}

/// H at times of the amplitude window, interpolated between the frames kept and the present one.
class CurvatureHistory {
 public:
  CurvatureHistory(const CrumplingState& state, double now_s) : state_(state), now_s_(now_s) {}

  double at(std::size_t vertex, double time_s) const {
    const auto& past = state_.past;
    double after_s = now_s_;
    float after = state_.now.mean_per_m[vertex];
    for (auto frame = past.rbegin(); frame != past.rend(); ++frame) {
      const float before = frame->curvature_per_m[vertex];
      if (frame->time_s <= time_s || std::next(frame) == past.rend()) {
        const double share =
            after_s > frame->time_s ? std::clamp((time_s - frame->time_s) / (after_s - frame->time_s), 0.0, 1.0) : 0.0;
        return before + share * (after - before);
      }
      after_s = frame->time_s, after = before;
    }
    return after;
  }

  /// Change toward the side `way` over a window about the zero of H at `crossed_s`, but not later than about half a window
  /// ago. What of the window's second half is still to come mirrors the first: so the change does not depend on when the
  /// flip is seen.
  double change(std::size_t vertex, int way, double crossed_s, double window_s) const {
    const double half_s = window_s / 2, middle_s = std::max(crossed_s, now_s_ - half_s);
    const double change =
        state_.now.mean_per_m[vertex] + at(vertex, 2 * middle_s - now_s_) - 2 * at(vertex, middle_s - half_s);
    return std::max(way * change, 0.0);
  }

 private:
  const CrumplingState& state_;
  double now_s_;
};

/// Vertices whose kernel reaches a remade vertex.
std::vector<bool> touched_by(const std::vector<bool>& remade, const CurvatureStencils& stencils) {
  std::vector<sheet::Vec2d> points;
  std::vector<std::uint32_t> piece;
  double radius = 0;
  for (std::size_t i = 0; i < remade.size(); ++i) {
    radius = std::max(radius, stencils.radius_m[i]);
    if (remade[i]) points.push_back(stencils.plane.coordinates_m[i]), piece.push_back(stencils.plane.component[i]);
  }
  std::vector<bool> touched(remade.size(), false);
  if (points.empty()) return touched;
  const sheet::PointGrid<2> grid(points, radius / 2);
  for (std::size_t i = 0; i < remade.size(); ++i) {
    bool near = remade[i];
    if (!near) {
      grid.within(stencils.plane.coordinates_m[i], stencils.radius_m[i],
                  [&](std::uint32_t j, double) { near = near || piece[j] == stencils.plane.component[i]; });
    }
    touched[i] = near;
  }
  return touched;
}

class FlipFinder {
 public:
  FlipFinder(const CrumplingInputs& in, const Parameters& parameters, CrumplingState& state)
      : in_(in), parameters_(parameters), state_(state), member_(in.positions_m.size(), false) {}

  bool may_flip(std::uint32_t i) const {
    const std::int8_t now = side_of(state_.now.mean_per_m[i], parameters_.event_growth_per_m);
    return now != 0 && state_.sign[i] != 0 && now != state_.sign[i];
  }
  bool is_member(std::uint32_t i) const { return member_[i]; }

  /// The connected vertices that flip the way the seed does. Empty when an earlier flip holds the seed.
  std::vector<std::uint32_t> grow(std::uint32_t seed) {
    std::vector<std::uint32_t> flip;
    if (member_[seed]) return flip;
    flip.push_back(seed);
    member_[seed] = true;
    const bool up = state_.now.mean_per_m[seed] > 0;
    for (std::size_t k = 0; k < flip.size(); ++k) {
      for_neighbours(flip[k], [&](std::uint32_t j) {
        if (member_[j] || (state_.now.mean_per_m[j] > 0) != up || !may_flip(j)) return;
        member_[j] = true;
        flip.push_back(j);
      });
    }
    std::sort(flip.begin(), flip.end());
    return flip;
  }

  /// The youngest event of the same direction at a flip's vertices or beside them, in the frames before.
  struct Younger {
    double time_s = kNever;
    std::uint64_t event = 0;
  };
  Younger touched_flip(const std::vector<std::uint32_t>& flip) const {
    Younger youngest;
    const std::int8_t way = state_.now.mean_per_m[flip[0]] > 0 ? 1 : -1;
    const auto consider = [&](std::uint32_t j) {
      if (state_.flipped_to[j] != way || state_.flipped_in[j] == 0) return;
      const Younger other{state_.flipped_s[j], state_.flipped_in[j]};
      if (other.time_s > youngest.time_s || (other.time_s == youngest.time_s && other.event > youngest.event))
        youngest = other;
    };
    for (std::uint32_t i : flip) for_neighbours(i, consider);
    return youngest;
  }

 private:
  template <class Visit>
  void for_neighbours(std::uint32_t i, Visit&& visit) const {
    const auto& s = in_.stencils;
    for (std::uint32_t k = s.neighbour_start[i]; k < s.neighbour_start[i + 1]; ++k) visit(s.neighbour[k]);
  }

  const CrumplingInputs& in_;
  const Parameters& parameters_;
  const CrumplingState& state_;
  std::vector<bool> member_;
};

CrumplingEvent describe(const std::vector<std::uint32_t>& flip, const std::vector<float>& areas_m2,
                        const CurvatureHistory& history, double window_s, const CrumplingInputs& in,
                        const CrumplingState& state) {
  CrumplingEvent event;
  event.confirmed_s = in.time_s;
  event.direction = state.now.mean_per_m[flip[0]] > 0 ? 1 : -1;
  event.vertices = flip;
  double weights = 0;
  for (std::uint32_t i : flip) {
    const double area = areas_m2[i], h = state.now.mean_per_m[i];
    const double change = history.change(i, event.direction, state.crossed_s[i], window_s);
    const double weight = area * std::max(change, kLeastChange_per_m);
    event.area_m2 += area;
    event.amplitude_m += area * change;
    event.published_amplitude_per_m += std::fabs(h - static_cast<double>(state.curvature_per_m[i]));
    event.time_s += weight * std::min(std::max(state.crossed_s[i], state.time_s - kOldestCrossing_s), in.time_s);
    event.position_m += weight * in.positions_m[i].cast<double>();
    if (!in.velocities_m_per_s.empty()) {
      event.velocity_m_per_s += weight * in.velocities_m_per_s[i].cast<double>();
    } else if (!in.previous_positions_m.empty()) {
      const double interval = std::max(in.time_s - state.time_s, kLeastInterval_s);
      event.velocity_m_per_s += weight / interval * (in.positions_m[i] - in.previous_positions_m[i]).cast<double>();
    }
    weights += weight;
  }
  weights = std::max(weights, 1e-300);
  event.time_s = event.time_s / weights;
  event.position_m /= weights;
  event.velocity_m_per_s /= weights;
  return event;
}

void remember(const CrumplingInputs& in, const Parameters& parameters, CrumplingState& state) {
  auto& past = state.past;
  while (past.size() > 2 && past[1].time_s <= in.time_s - parameters.event_window_s) {
    state.spare_per_m.push_back(std::move(past.front().curvature_per_m));
    past.erase(past.begin());
  }
  if (state.spare_per_m.empty()) state.spare_per_m.emplace_back();
  state.spare_per_m.back().assign(state.now.mean_per_m.begin(), state.now.mean_per_m.end());
  past.push_back({in.time_s, std::move(state.spare_per_m.back())});
  state.spare_per_m.pop_back();
  state.curvature_per_m.swap(state.now.mean_per_m);
  state.time_s = in.time_s;
}

}  // namespace

std::vector<CrumplingEvent> find_crumpling(const CrumplingInputs& in, const Parameters& parameters, CrumplingState& state,
                                           std::uint64_t& next_event_id) {
  const std::size_t n = in.positions_m.size();
  std::vector<CrumplingEvent> events;
  measure_curvature(in.stencils, in.angles_rad, state.now);
  if (!state.primed) {
    begin(in, parameters, state);
    return events;
  }
  assert(state.sign.size() == n);
  const std::vector<float>& now = state.now.mean_per_m;
  const std::vector<float>& before = state.curvature_per_m;
  const double interval = std::max(in.time_s - state.time_s, kLeastInterval_s);
  state.seeds.clear();
  const auto least_band = static_cast<float>(parameters.event_band_per_m);
  for (std::uint32_t i = 0; i < n; ++i) {
    const float h = now[i];
    if (before[i] * h <= 0 && before[i] != h)
      state.crossed_s[i] = state.time_s + interval * (before[i] / (static_cast<double>(before[i]) - h));
    if (std::fabs(h) <= least_band) continue;
    const std::int8_t side = h > 0 ? 1 : -1;
    if (state.sign[i] == 0) {
      state.sign[i] = side;  // a first sign makes no event
    } else if (state.sign[i] != side) {
      state.seeds.push_back(i);
    }
  }
  std::vector<bool> touched;
  if (in.remade != nullptr && std::find(in.remade->begin(), in.remade->end(), true) != in.remade->end()) {
    touched = touched_by(*in.remade, in.stencils);
  }
  std::vector<std::uint32_t> silent;  // seeds that the new mesh alone may have made
  std::erase_if(state.seeds, [&](std::uint32_t i) {
    const double band =
        parameters.event_band_per_m + parameters.event_band_relative * static_cast<double>(state.now.bending_per_m[i]);
    if (std::fabs(now[i]) <= band) return true;
    const bool held =
        !touched.empty() && ((touched[i] && std::fabs(before[i]) <= band) || (in.remade_are_silent && (*in.remade)[i]));
    if (held) silent.push_back(i);
    return held;
  });

  if (!state.seeds.empty()) {
    FlipFinder finder(in, parameters, state);
    const CurvatureHistory history(state, in.time_s);
    std::vector<sheet::Vec4f> relative_m;
    std::vector<float> face_areas_m2, areas_m2;
    sheet::relative_positions_m(in.positions_m, in.positions_m[state.seeds[0]], relative_m);
    sheet::face_areas_m2(*in.stencils.topology, relative_m, face_areas_m2);
    sheet::vertex_areas_m2(*in.stencils.topology, face_areas_m2, areas_m2);
    struct Flip {
      std::vector<std::uint32_t> vertices;
      std::uint64_t event;
    };
    std::vector<Flip> flips;
    for (std::uint32_t seed : state.seeds) {
      std::vector<std::uint32_t> vertices = finder.grow(seed);
      if (vertices.empty()) continue;
      const auto younger = finder.touched_flip(vertices);
      const std::uint64_t continues = younger.time_s > in.time_s - parameters.event_merge_s ? younger.event : 0;
      CrumplingEvent event = describe(vertices, areas_m2, history, parameters.event_window_s, in, state);
      if (!(event.area_m2 >= parameters.event_min_area_m2) || !std::isfinite(event.amplitude_m)) {
        flips.push_back({std::move(vertices), continues});
        continue;
      }
      event.id = next_event_id++;
      event.continues = continues;
      flips.push_back({std::move(vertices), event.id});
      events.push_back(std::move(event));
    }
    for (const Flip& flip : flips) {
      const std::int8_t way = now[flip.vertices[0]] > 0 ? 1 : -1;
      for (std::uint32_t i : flip.vertices) {
        state.sign[i] = way;
        state.flipped_s[i] = in.time_s;
        state.flipped_to[i] = way;
        state.flipped_in[i] = flip.event;
      }
    }
    for (std::uint32_t i : silent) {
      if (!finder.is_member(i)) state.sign[i] = now[i] > 0 ? 1 : -1;
    }
  } else {
    for (std::uint32_t i : silent) state.sign[i] = now[i] > 0 ? 1 : -1;
  }
  // Around new vertices the discretisation has changed: they take the sign of where they are.
  for (std::uint32_t i = 0; i < touched.size(); ++i) {
    const std::int8_t weak = side_of(now[i], parameters.event_growth_per_m);
    if (weak != 0 && touched[i] && ((*in.remade)[i] || state.flipped_s[i] != in.time_s)) state.sign[i] = weak;
  }
  remember(in, parameters, state);
  return events;
}

void carry(const sheet::Transfer& transfer, const Parameters& parameters, CrumplingState& state) {
  if (!state.primed) return;
  const auto blended = [&](std::vector<float>& values) {
    std::vector<float> out(transfer.origins.size());
    for (std::size_t i = 0; i < out.size(); ++i) {
      const auto& o = transfer.origins[i];
      out[i] =
          o.weights[0] * values[o.vertices[0]] + o.weights[1] * values[o.vertices[1]] + o.weights[2] * values[o.vertices[2]];
    }
    values = std::move(out);
  };
  const auto taken = [&](auto& values) {
    std::remove_reference_t<decltype(values)> out(transfer.origins.size());
    for (std::size_t i = 0; i < out.size(); ++i) out[i] = values[transfer.origins[i].closest()];
    values = std::move(out);
  };
  blended(state.curvature_per_m);
  for (auto& past : state.past) blended(past.curvature_per_m);
  taken(state.sign);
  for (std::size_t i = 0; i < state.sign.size(); ++i) {
    const std::int8_t side = side_of(state.curvature_per_m[i], parameters.event_band_per_m);
    if (transfer.remade[i] && side != 0) state.sign[i] = side;
  }
  taken(state.crossed_s);
  taken(state.flipped_s);
  taken(state.flipped_to);
  taken(state.flipped_in);
}

}  // namespace rustle::analysis
