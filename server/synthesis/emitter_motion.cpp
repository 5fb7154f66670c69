#include "server/synthesis/emitter_motion.h"

#include <algorithm>
#include <cmath>

namespace rustle::synthesis {
namespace {

using spatial::Vec3;

/// Rows of the rotation by |turn| about turn (Rodrigues).
std::array<Vec3, 3> rotation(const Vec3& turn_rad) noexcept {
  const double angle = spatial::norm(turn_rad);
  if (angle < 1e-12) return {Vec3{1, 0, 0}, Vec3{0, 1, 0}, Vec3{0, 0, 1}};
  const Vec3 a = (1 / angle) * turn_rad;
  const double s = std::sin(angle);
  const double c = std::cos(angle);
  const double v = 1 - c;
  return {Vec3{c + v * a.x * a.x, v * a.x * a.y - s * a.z, v * a.x * a.z + s * a.y},
          Vec3{v * a.x * a.y + s * a.z, c + v * a.y * a.y, v * a.y * a.z - s * a.x},
          Vec3{v * a.x * a.z - s * a.y, v * a.y * a.z + s * a.x, c + v * a.z * a.z}};
}

Vec3 turned(const std::array<Vec3, 3>& rows, const Vec3& a) noexcept {
  return {spatial::dot(rows[0], a), spatial::dot(rows[1], a), spatial::dot(rows[2], a)};
}

}  // namespace

EmitterMotions::EmitterMotions(int buses)
    : ways_(static_cast<std::size_t>(buses)), steps_(ways_.size()), step_counts_(ways_.size()) {}

void EmitterMotions::apply(const EmitterMotionCue& cue, SampleTime quantum_start) noexcept {
  auto& ways = ways_[cue.bus];
  buses_ = std::max(buses_, std::size_t{cue.bus} + 1);
  Way way{
      {std::max(cue.start, quantum_start), std::max(cue.end, quantum_start + 1), cue.from_m, cue.to_m}, cue.turn_rad, true};
  const auto free = std::find_if(ways.begin(), ways.end(), [](const Way& w) { return !w.used; });
  if (free != ways.end()) {
    *free = way;
    ++used_;
    return;
  }
  const Ramp<Vec3>& oldest = ways.front().centre_m;
  way.centre_m.to = way.centre_m.to + (1 - oldest.progress(quantum_start)) * (oldest.to - oldest.from);
  std::move(ways.begin() + 1, ways.end(), ways.begin());
  ways.back() = way;
}

void EmitterMotions::advance(SampleTime quantum_start) noexcept {
  if (used_ == 0 && !stepping_) return;
  used_ = 0;
  stepping_ = false;
  for (std::size_t bus = 0; bus < buses_; ++bus) {
    std::size_t kept = 0;
    step_counts_[bus] = 0;
    for (Way& way : ways_[bus]) {
      if (!way.used) break;
      const Ramp<Vec3>& centre = way.centre_m;
      const double from = centre.progress(quantum_start);
      const double to = centre.progress(quantum_start + kQuantum);
      const Vec3 whole = centre.to - centre.from;
      if (to > from) {
        steps_[bus][step_counts_[bus]++] = {centre.from + from * whole, centre.from + to * whole,
                                            rotation((to - from) * way.turn_rad)};
        stepping_ = true;
      }
      way.used = false;
      if (to < 1) {
        Way& place = ways_[bus][kept++];
        place = way;
        place.used = true;
        ++used_;
      }
    }
  }
}

spatial::Emitter EmitterMotions::moved(Bus bus, const spatial::Emitter& emitter) const noexcept {
  spatial::Emitter out = emitter;
  for (std::size_t k = 0; k < step_counts_[bus]; ++k) {
    const Step& step = steps_[bus][k];
    out.position_m = step.to_m + turned(step.rows, out.position_m - step.from_m);
    out.normal = turned(step.rows, out.normal);
  }
  return out;
}

}  // namespace rustle::synthesis
