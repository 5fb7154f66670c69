#include "server/synthesis/acoustic_scene.h"

#include <algorithm>

namespace rustle::synthesis {
namespace {

using spatial::Listener;
using spatial::Plane;
using spatial::Vec3;

Vec3 between(const Vec3& a, const Vec3& b, double t) noexcept {
  if (t <= 0) return a;
  return t >= 1 ? b : a + t * (b - a);
}

Vec3 turned(const Vec3& a, const Vec3& b, double t) noexcept {
  if (t <= 0) return a;
  return t >= 1 ? b : spatial::normalized(between(a, b, t), b);
}

}  // namespace

SceneTrack::SceneTrack(spatial::Layout layout) noexcept : layout_(layout) {
  for (Ramp<Plane>& ramp : planes_) ramp.from.reflection = ramp.to.reflection = 0;
  evaluate(0, span_.after);
  span_.before = span_.after;
}

Listener SceneTrack::listener_at(SampleTime time) const noexcept {
  const double t = listener_.progress(time);
  return {between(listener_.from.position_m, listener_.to.position_m, t),
          turned(listener_.from.forward, listener_.to.forward, t), turned(listener_.from.up, listener_.to.up, t)};
}

Plane SceneTrack::plane_at(int slot, SampleTime time) const noexcept {
  const Ramp<Plane>& ramp = planes_[static_cast<std::size_t>(slot)];
  const double t = ramp.progress(time);
  return {between(ramp.from.point_m, ramp.to.point_m, t), turned(ramp.from.normal, ramp.to.normal, t),
          ramp.from.reflection + t * (ramp.to.reflection - ramp.from.reflection)};
}

void SceneTrack::apply(const ListenerCue& cue, SampleTime quantum_start) noexcept {
  const SampleTime start = std::max(cue.start, quantum_start);
  const Listener now = placed_ ? listener_at(start) : cue.listener;
  listener_ = {start, cue.end, now, cue.listener};
  placed_ = true;
  changed_ = true;
}

void SceneTrack::apply(const PlaneCue& cue, SampleTime quantum_start) noexcept {
  if (cue.slot >= spatial::kMaxPlanes) return;
  const SampleTime start = std::max(cue.start, quantum_start);
  Plane now = plane_at(cue.slot, start);
  if (cue.fresh) {
    now = cue.plane;
    now.reflection = 0;
  }
  planes_[cue.slot] = {start, cue.end, now, cue.plane};
  plane_count_ = std::max(plane_count_, cue.slot + 1);
  changed_ = true;
}

void SceneTrack::evaluate(SampleTime time, AcousticScene& out) const noexcept {
  out.listener = listener_at(time);
  out.receivers = spatial::receivers(out.listener, layout_);
  out.plane_count = plane_count_;
  for (int slot = 0; slot < plane_count_; ++slot) out.planes[static_cast<std::size_t>(slot)] = plane_at(slot, time);
}

void SceneTrack::advance(SampleTime quantum_start) noexcept {
  const SampleTime end = quantum_start + kQuantum;
  const auto used = std::span(planes_).first(static_cast<std::size_t>(plane_count_));
  const bool moved = span_.moves;
  span_.moves =
      changed_ || listener_.moves_within(quantum_start, end) ||
      std::any_of(used.begin(), used.end(), [&](const auto& ramp) { return ramp.moves_within(quantum_start, end); });
  if (changed_) {
    evaluate(quantum_start, span_.before);
  } else if (moved) {
    span_.before = span_.after;
  }
  if (span_.moves) evaluate(end, span_.after);
  changed_ = false;
}

}  // namespace rustle::synthesis
