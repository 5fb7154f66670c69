#include "server/synthesis/crumpling.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <tuple>
#include <utility>

#include "server/synthesis/fine_events.h"
#include "server/synthesis/resonator_level.h"
#include "server/synthesis/unit_loudness.h"
#include "sound_db/dsp/level.h"
#include "sound_db/dsp/random.h"
#include "sound_db/pack/emission.h"
#include "sound_db/pack/query.h"

namespace rustle::synthesis {
namespace {

using observation::CrumplingEvent;
using observation::Resonator;

/// An event, and what continued it.
struct Event {
  SheetPlan sheet;
  SampleTime start = 0;
  SampleTime onset = 0;
  double amplitude_m = 0;
  double published_amplitude_per_m = 0;
  double largest_m = 0;  ///< amplitude of the part whose resonators are kept
  std::vector<Resonator> resonators;
  bool released = false;
};

class CrumplingPlan final : public PlanModel {
 public:
  explicit CrumplingPlan(const PlanOptions& options) : options_(options), fine_(options) {}

  void plan(const SheetPlan& sheet, const observation::Observation& observation, SampleTime earliest,
            std::vector<Cue>& out) override {
    if (sheet.material->corpus()) return;
    fine_.plan(sheet, observation, earliest);
    for (const CrumplingEvent& event : observation.crumpling) {
      if (!(event.amplitude_m > 0) || !std::isfinite(event.amplitude_m)) continue;
      const SampleTime onset = std::max(to_sample(options_, event.time_s), earliest);
      fine_.plan_burst(sheet, event, peak(sheet, event), onset, earliest);
      add(sheet, observation, event, onset, earliest, out);
    }
    forget(to_sample(options_, observation.time_s));
  }

  void release(SampleTime until, std::vector<Cue>& out) override {
    std::vector<std::pair<SampleTime, std::uint64_t>> due;
    for (const auto& [id, event] : events_) {
      if (!event.released && event.start < until) due.emplace_back(event.start, id);
    }
    std::sort(due.begin(), due.end());
    for (const auto& [start, id] : due) sound(id, events_.at(id), out);
    fine_.release(until, out);
  }

  void end_sheet(const SheetPlan&, SampleTime, std::vector<Cue>&) override {}

  void add_counters(PlanCounters& counters) const override { counters.sounds_missing += missing_ + fine_.missing(); }

  void forget(const Material& material) override {
    std::erase_if(events_, [&](const auto& item) { return item.second.sheet.material == &material; });
    std::erase_if(roots_, [&](const auto& item) { return !events_.contains(item.second); });
    fine_.forget(material);
    loudness_.forget(material);
  }

 private:
  void add(const SheetPlan& sheet, const observation::Observation& seen, const CrumplingEvent& event, SampleTime onset,
           SampleTime earliest, std::vector<Cue>& out) {
    const auto first = roots_.find(event.continues);
    if (event.continues != 0 && first != roots_.end()) {
      const std::uint64_t root = first->second;
      Event& begun = events_.at(root);
      if (!begun.released || onset - begun.onset < std::llround(kRaiseWindow_s * options_.rate_hz)) {
        grow(root, begun, seen, event, onset, out);
        roots_[event.id] = root;
        return;
      }
    }
    Event begun;
    begun.sheet = sheet;
    begun.onset = onset;
    begun.start = std::max(onset - kQuantum, earliest);
    begun.amplitude_m = begun.largest_m = event.amplitude_m;
    begun.published_amplitude_per_m = event.published_amplitude_per_m;
    begun.resonators = resonators_at(onset, seen, event);
    events_[event.id] = std::move(begun);
    roots_[event.id] = event.id;
  }

  static pack::GridPoint wanted_by(const Resonator& resonator) {
    if (resonator.constrained) return {};
    return {resonator.ruling_length_m, resonator.free_border_length_m};
  }

  /// Of the loudest unit that the event may start, at 1 m on the axis.
  double peak(const SheetPlan& sheet, const CrumplingEvent& event) {
    const auto& section = sheet.material->pack().crumpling;
    if (!section) return 0;
    const std::vector<Resonator> resonators = resonators_of(event);
    double loudest = 0;
    for (const Share& share : shares(options_.mode, resonators)) {
      const Resonator& resonator = resonators[share.index];
      const auto variants = pack::nearest_variants(*section, wanted_by(resonator));
      if (variants.empty()) continue;
      const pack::Unit& unit = section->units[variants.front()];
      const double gain =
          share.amplitude * level(event.amplitude_m, event.published_amplitude_per_m, *section, unit, resonator);
      const auto& figures = loudness_.of(unit.samples.data(), static_cast<std::uint32_t>(unit.samples.size()));
      loudest = std::max(loudest, gain * figures.peak);
    }
    return loudest;
  }

  static std::vector<Resonator> resonators_of(const CrumplingEvent& event) {
    if (!event.resonators.empty()) return event.resonators;
    return {bare_resonator(event.position_m, event.area_m2)};
  }

  /// The event's resonators where they were when its sound begins: they were seen in a later frame, and their voices will go
  /// the sheet's way from the beginning on.
  std::vector<Resonator> resonators_at(SampleTime time, const observation::Observation& seen,
                                       const CrumplingEvent& event) const {
    std::vector<Resonator> out = resonators_of(event);
    const double interval_s = seen.time_s - seen.previous_time_s;
    if (!seen.motion || !(interval_s > 0)) return out;
    const double since_s = static_cast<double>(to_sample(options_, seen.time_s) - time) / options_.rate_hz;
    const sheet::Vec3d way_m = since_s / interval_s * (seen.motion->to_m - seen.motion->from_m);
    for (Resonator& resonator : out) resonator.position_m -= way_m;
    return out;
  }

  void grow(std::uint64_t root, Event& begun, const observation::Observation& seen, const CrumplingEvent& event,
            SampleTime onset, std::vector<Cue>& out) const {
    const double before_m = begun.amplitude_m;
    begun.amplitude_m += event.amplitude_m;
    begun.published_amplitude_per_m += event.published_amplitude_per_m;
    if (begun.released) {
      const auto factor = static_cast<float>(begun.amplitude_m / before_m);
      out.emplace_back(CrumpleRaiseCue{onset, root, bus_of(begun.sheet.index, SoundKind::kCrumpling), factor});
    } else if (event.amplitude_m > begun.largest_m) {
      begun.largest_m = event.amplitude_m;
      begun.resonators = resonators_at(begun.onset, seen, event);
    }
  }

  void sound(std::uint64_t id, Event& event, std::vector<Cue>& out) {
    event.released = true;
    const auto& section = event.sheet.material->pack().crumpling;
    for (const Share& share : shares(options_.mode, event.resonators)) {
      const Resonator& resonator = event.resonators[share.index];
      const pack::GridPoint wanted = wanted_by(resonator);
      const pack::Unit* unit = section ? choose(event.sheet, id, share.index, *section, wanted) : nullptr;
      if (!unit) {
        ++missing_;
        continue;
      }
      CrumpleCue cue;
      cue.start = event.start;
      cue.onset = event.onset;
      cue.event = id;
      cue.bus = bus_of(event.sheet.index, SoundKind::kCrumpling);
      cue.resonator = static_cast<std::uint16_t>(share.index);
      cue.unit = unit->samples.data();
      cue.unit_samples = static_cast<std::uint32_t>(unit->samples.size());
      cue.gain = static_cast<float>(share.amplitude *
                                    level(event.amplitude_m, event.published_amplitude_per_m, *section, *unit, resonator));
      cue.emitter = emitter_of(options_.mode, resonator);
      out.emplace_back(cue);
    }
  }

  const pack::Unit* choose(const SheetPlan& sheet, std::uint64_t event, std::size_t resonator,
                           const pack::CrumplingSection& section, const pack::GridPoint& wanted) {
    const auto variants = pack::nearest_variants(section, wanted);
    if (variants.empty()) return nullptr;
    const auto place = std::make_tuple(sheet.id, sheet.pack_changes, variants.front());
    const auto last = last_.find(place);
    const double draw =
        dsp::to_uniform(dsp::hash(dsp::hash(options_.seed, sheet.id, event), static_cast<std::uint64_t>(resonator)));
    const std::uint32_t chosen = pack::choose_variant(variants, draw, last == last_.end() ? pack::kNoUnit : last->second);
    last_[place] = chosen;
    if (last == last_.end()) forget_packs_before(sheet);
    return &section.units[chosen];
  }

  /// What was chosen from packs that the sheet had long ago.
  void forget_packs_before(const SheetPlan& sheet) {
    std::erase_if(last_, [&](const auto& item) {
      const auto& [id, pack_changes, first] = item.first;
      return id == sheet.id && pack_changes + 1 < sheet.pack_changes;
    });
  }

  double level(double amplitude_m, double published_per_m, const pack::CrumplingSection& section, const pack::Unit& unit,
               const Resonator& resonator) const {
    const double reference_m = std::max(1e-9, section.reference_amplitude_m(unit.point));
    const double size = size_factor(options_.mode, resonator.disc_radius_m, unit.radius_m);
    const double emitted = pack::emission_gain(section.geometry);
    if (options_.mode == Mode::kPublished) {
      return std::min(published_per_m / (reference_m * kPublishedVertices_per_m2) * size, 1e4) * emitted;
    }
    return std::min(amplitude_m / reference_m, dsp::db_to_gain(kMaxCrumpling_db)) * size * emitted;
  }

  /// Events that no continuation can reach any more.
  void forget(SampleTime now) {
    if (now - forgotten_ < options_.rate_hz / 4 && now >= forgotten_) return;
    forgotten_ = now;
    const SampleTime old = now - options_.rate_hz;
    std::erase_if(events_, [&](const auto& item) { return item.second.released && item.second.onset < old; });
    std::erase_if(roots_, [&](const auto& item) { return !events_.contains(item.second); });
  }

  PlanOptions options_;
  std::map<std::uint64_t, Event> events_;         ///< by the id of the first of a chain
  std::map<std::uint64_t, std::uint64_t> roots_;  ///< event to the first of its chain
  /// By sheet, pack and first variant of a place: never by what is freed at some time, which would change the choice.
  std::map<std::tuple<sheet::SheetId, std::uint64_t, std::uint32_t>, std::uint32_t> last_;
  SampleTime forgotten_ = 0;  ///< when events were looked through for such
  FineEventsPlan fine_;
  UnitLoudness loudness_;
  std::uint64_t missing_ = 0;
};

}  // namespace

std::unique_ptr<PlanModel> make_crumpling_plan(const PlanOptions& options) {
  return std::make_unique<CrumplingPlan>(options);
}

}  // namespace rustle::synthesis
