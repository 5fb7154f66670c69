#include "server/synthesis/planner.h"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <limits>

#include "server/synthesis/model_registry.h"
#include "server/synthesis/source_paths.h"
#include "sound_db/dsp/level.h"

namespace rustle::synthesis {
namespace {

constexpr double kLongestAfter_s = 1;  ///< what an observation leads to has begun by then: slips, bursts and aftershocks
constexpr double kLongestEcho_s = 3;   ///< after a unit's end: paths are 2 s long at most, an unrenewed source holds 0.3 s

}  // namespace

SampleTime to_sample(const PlanOptions& options, double time_s) noexcept {
  constexpr double kMost = 4503599627370496.0;
  const double samples = (time_s - options.origin_s) * options.rate_hz;
  return std::isnan(samples) ? 0 : std::llround(std::clamp(samples, -kMost, kMost));
}

Planner::Planner(const PlanOptions& options) : options_(options), bursts_(options) {
  for (const SoundModel& model : sound_models()) models_.push_back(model.make_plan(options));
}

Planner::~Planner() = default;

SampleTime Planner::samples(double duration_s) const {
  return std::llround(duration_s * options_.rate_hz);
}

const Material* Planner::material(const std::shared_ptr<const pack::SoundPack>& pack) {
  for (const auto& known : materials_) {
    if (known.material->shared() == pack) return known.material.get();
  }
  materials_.push_back(
      {shared_material(pack, options_.rate_hz, options_.friction_fft_size, options_.cloth_search), true, 0, {}});
  return materials_.back().material.get();
}

void Planner::see_who_uses_materials() {
  for (KnownMaterial& known : materials_) {
    const Material* material = known.material.get();
    const bool in_use = std::any_of(sheets_.begin(), sheets_.end(), [&](const auto& sheet) {
      const auto in = [&](const auto& others) {
        return std::any_of(others.begin(), others.end(), [&](const auto& other) { return other.second == material; });
      };
      return sheet.second.material == material || in(sheet.second.by_surface) || in(sheet.second.partners);
    });
    if (known.in_use && !in_use) known.planned_until = planned_until_;
    known.in_use = in_use;
    if (in_use) known.until.reset();
  }
}

void Planner::forget_silent(SampleTime settled) {
  std::erase_if(materials_, [&](KnownMaterial& known) {
    if (known.in_use) return false;
    if (!known.until) {
      known.until = std::max(known.planned_until, settled) + known.material->longest_unit() + samples(kLongestEcho_s);
      return false;
    }
    if (settled <= *known.until) return false;
    for (const auto& model : models_) model->forget(*known.material);
    bursts_.forget(*known.material);
    return true;
  });
}

void Planner::add_sheet(const SheetSetup& setup, SampleTime earliest, std::vector<Cue>& out) {
  SheetPlan sheet;
  sheet.id = setup.id;
  sheet.index = setup.index;
  sheet.material = material(setup.pack);
  sheet.fine_events = setup.fine_events;
  sheet.grammage_kg_per_m2 = setup.grammage_kg_per_m2.value_or(setup.pack->grammage_kg_per_m2);
  for (const auto& [surface, pack] : setup.by_surface) sheet.by_surface[surface] = material(pack);
  const auto before = sheets_.find(setup.id);
  const bool known = before != sheets_.end();
  if (known) {
    const bool same = before->second.material == sheet.material && before->second.by_surface == sheet.by_surface;
    sheet.pack_changes = before->second.pack_changes + (same ? 0 : 1);
  }
  const SheetPlan& added = sheets_[setup.id] = std::move(sheet);
  see_who_uses_materials();
  send_gains(added, earliest, known ? earliest + samples(kGainRamp_s) : earliest, out);
}

void Planner::add_partner(sheet::SheetId id, const std::string& name, const std::shared_ptr<const pack::SoundPack>& pack) {
  const auto sheet = sheets_.find(id);
  if (sheet == sheets_.end()) return;
  sheet->second.partners[name] = material(pack);
  see_who_uses_materials();
}

void Planner::complete(SampleTime until, std::vector<Cue>& out) {
  for (const auto& model : models_) model->complete(until, out);
}

SampleTime Planner::settled(sheet::SheetId id) const {
  SampleTime settled = std::numeric_limits<SampleTime>::max();
  for (const auto& model : models_) settled = std::min(settled, model->settled(id));
  return settled;
}

SampleTime Planner::latency() const {
  SampleTime latency = 0;
  const auto see = [&](const Material* material) {
    if (material->corpus()) latency = std::max(latency, material->corpus()->latency_samples() + kPathLag);
  };
  for (const auto& [id, sheet] : sheets_) {
    see(sheet.material);
    for (const auto& [surface, material] : sheet.by_surface) see(material);
    for (const auto& [name, material] : sheet.partners) see(material);
  }
  return latency;
}

void Planner::plan(const observation::Observation& observation, SampleTime earliest, std::vector<Cue>& out) {
  const auto sheet = sheets_.find(observation.sheet);
  if (sheet == sheets_.end()) return;
  const std::size_t first = out.size();
  const SampleTime time = to_sample(options_, observation.time_s);
  const SampleTime interval = std::max<SampleTime>(0, time - to_sample(options_, observation.previous_time_s));
  planned_until_ = std::max(planned_until_, std::max(time, earliest) + interval + samples(kLongestAfter_s));
  for (const auto& model : models_) model->plan(sheet->second, observation, earliest, out);
  if (observation.motion) {
    const auto& [from_m, to_m, turn_rad] = *observation.motion;
    const Motion way = motion(observation.time_s, to_sample(options_, observation.previous_time_s), earliest);
    const Bus bus = bus_of(sheet->second.index, SoundKind::kCrumpling);
    out.emplace_back(EmitterMotionCue{way.start, way.end, bus, from_m, to_m, turn_rad});
  }
  bursts_.redirect_raises(out, first);
  bursts_.forget(time);
}

void Planner::release(SampleTime until, std::vector<Cue>& out) {
  const std::size_t first = out.size();
  const SampleTime whole = bursts_.whole_slots(until);
  for (const auto& model : models_) model->release(whole, out);
  bursts_.merge(out, first);
}

Planner::Motion Planner::motion(double time_s, SampleTime previous, SampleTime earliest) const {
  const SampleTime time = to_sample(options_, time_s);
  const SampleTime start = std::max({earliest, previous, time - samples(kMostMotion_s)});
  return {start, std::max(time, start + samples(kLeastMotion_s))};
}

void Planner::listener(const spatial::Listener& listener, double time_s, SampleTime earliest, std::vector<Cue>& out) {
  const bool same = placed_ && listener.position_m == listener_.position_m && listener.forward == listener_.forward &&
                    listener.up == listener_.up;
  if (!same) {
    const Motion way = motion(time_s, listener_time_, earliest);
    out.emplace_back(ListenerCue{placed_ ? way.start : earliest, way.end, listener});
  }
  listener_ = listener;
  tell_places();
  listener_time_ = to_sample(options_, time_s);
  placed_ = true;
}

void Planner::planes(std::span<const IdentifiedPlane> planes, double time_s, SampleTime earliest, std::vector<Cue>& out) {
  const Motion way = motion(time_s, planes_time_, earliest);
  planes_time_ = to_sample(options_, time_s);
  std::array<bool, spatial::kMaxPlanes> present{};
  const auto send = [&](std::size_t slot, const spatial::Plane& plane, bool fresh) {
    slots_[slot].plane = plane;
    present[slot] = true;
    out.emplace_back(PlaneCue{way.start, way.end, static_cast<std::uint16_t>(slot), fresh, plane});
  };
  for (const IdentifiedPlane& wanted : planes) {
    const auto known =
        std::find_if(slots_.begin(), slots_.end(), [&](const PlaneSlot& s) { return s.used && s.id == wanted.id; });
    if (known != slots_.end()) {
      const auto slot = static_cast<std::size_t>(known - slots_.begin());
      present[slot] = true;
      const spatial::Plane& now = known->plane;
      const bool same = now.point_m == wanted.plane.point_m && now.normal == wanted.plane.normal &&
                        now.reflection == wanted.plane.reflection;
      if (!same) send(slot, wanted.plane, false);
      continue;
    }
    const auto longest_free = std::min_element(slots_.begin(), slots_.end(), [](const PlaneSlot& a, const PlaneSlot& b) {
      return a.used != b.used ? !a.used : a.free_from < b.free_from;
    });
    if (longest_free->used) {
      ++planes_left_out_;
      continue;
    }
    longest_free->used = true;
    longest_free->id = wanted.id;
    send(static_cast<std::size_t>(longest_free - slots_.begin()), wanted.plane, true);
  }
  for (std::size_t slot = 0; slot < slots_.size(); ++slot) {
    if (!slots_[slot].used || present[slot]) continue;
    spatial::Plane gone = slots_[slot].plane;
    gone.reflection = 0;
    send(slot, gone, false);
    slots_[slot].used = false;
    slots_[slot].free_from = way.end;
  }
  tell_places();
}

void Planner::tell_places() {
  std::vector<spatial::Plane> planes;
  for (const PlaneSlot& slot : slots_) {
    if (slot.used) planes.push_back(slot.plane);
  }
  for (const auto& model : models_) model->place(listener_, planes);
}

float Planner::bus_gain(const SheetPlan& sheet, SoundKind kind) const {
  return static_cast<float>(dsp::db_to_gain(gain_db_of(gains_, sheet.id, kind, sheet.material->pack().material)));
}

void Planner::send_gains(const SheetPlan& sheet, SampleTime start, SampleTime end, std::vector<Cue>& out) {
  for (const SoundKind kind : {SoundKind::kCrumpling, SoundKind::kFriction, SoundKind::kTearing}) {
    const Bus bus = bus_of(sheet.index, kind);
    const float gain = bus_gain(sheet, kind);
    const auto [sent, fresh] = sent_gains_.try_emplace(bus, 1.0F);
    if (sent->second == gain) continue;
    sent->second = gain;
    out.emplace_back(GainCue{start, end, bus, gain});
  }
}

void Planner::gains(std::vector<Gain> gains, SampleTime time, std::vector<Cue>& out) {
  gains_ = std::move(gains);
  for (const auto& [id, sheet] : sheets_) send_gains(sheet, time, time + samples(kGainRamp_s), out);
}

void Planner::economize(int joined_slots, int most_voices, SampleTime time, std::vector<Cue>& out) {
  bursts_.join_slots(joined_slots);
  out.emplace_back(VoiceLimitCue{time, most_voices});
}

void Planner::quieten(sheet::SheetId id, SampleTime time, std::vector<Cue>& out) {
  const auto sheet = sheets_.find(id);
  if (sheet == sheets_.end()) return;
  for (const auto& model : models_) model->end_sheet(sheet->second, time, out);
}

void Planner::end_sheet(sheet::SheetId id, SampleTime time, std::vector<Cue>& out) {
  quieten(id, time, out);
  sheets_.erase(id);
  see_who_uses_materials();
}

PlanCounters Planner::counters() const {
  PlanCounters counters;
  counters.planes_left_out = planes_left_out_;
  counters.voices_merged = bursts_.merged();
  for (const auto& model : models_) model->add_counters(counters);
  return counters;
}

}  // namespace rustle::synthesis
