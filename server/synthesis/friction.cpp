#include "server/synthesis/friction.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <set>
#include <utility>

#include "server/synthesis/resonator_level.h"
#include "server/synthesis/stick_slip.h"
#include "sound_db/dsp/random.h"
#include "sound_db/pack/query.h"

namespace rustle::synthesis {
namespace {

using observation::FrictionContact;
using observation::Resonator;

constexpr float kInaudible = 1e-5F;

class FrictionPlan final : public PlanModel {
 public:
  explicit FrictionPlan(const PlanOptions& options) : options_(options) {}

  void plan(const SheetPlan& sheet, const observation::Observation& observation, SampleTime earliest,
            std::vector<Cue>& out) override {
    const SampleTime start = std::max(to_sample(options_, observation.previous_time_s), earliest);
    const SampleTime end = std::max(to_sample(options_, observation.time_s), start + samples(kLeastRamp_s));
    Sources& sources = sources_[sheet.id];
    Sources alive;
    forget_stuck(sheet.id, observation.friction);
    for (const FrictionContact& contact : observation.friction)
      plan_contact(sheet, contact, observation.friction, start, end, sources, alive, out);
    for (auto& [source, cue] : sources) fade(cue, start, end, out);
    sources = std::move(alive);
  }

  void release(SampleTime, std::vector<Cue>&) override {}

  void end_sheet(const SheetPlan& sheet, SampleTime time, std::vector<Cue>& out) override {
    const auto found = sources_.find(sheet.id);
    if (found == sources_.end()) return;
    for (auto& [source, cue] : found->second) fade(cue, time, time + samples(kFrictionEnd_s), out);
    sources_.erase(found);
    stuck_.erase(sheet.id);
  }

  void add_counters(PlanCounters& counters) const override { counters.sounds_missing += missing_; }

  void forget(const Material& material) override {
    for (auto& [sheet, sources] : sources_)
      std::erase_if(sources, [&](const auto& item) { return material.has_emission(item.second.emission); });
  }

 private:
  using Sources = std::map<std::uint64_t, FrictionCue>;  ///< the last cue of each sounding source

  SampleTime samples(double duration_s) const { return std::llround(duration_s * options_.rate_hz); }

  void plan_contact(const SheetPlan& sheet, const FrictionContact& contact, const std::vector<FrictionContact>& all,
                    SampleTime start, SampleTime end, Sources& sounding, Sources& alive, std::vector<Cue>& out) {
    const Material& material = sheet.on(contact.touched_surface);
    if (material.corpus()) return;
    const auto& section = material.pack().friction;
    const bool bare = contact.resonators.empty();
    const std::vector<Resonator> assumed(bare ? 1 : 0, bare_resonator(contact.position_m, contact.area_m2));
    const std::vector<Resonator>& resonators = bare ? assumed : contact.resonators;
    const bool loose = options_.mode != Mode::kPublished && section && comes_loose(sheet.id, contact, *section);
    for (const Share& share : shares(options_.mode, resonators)) {
      const Resonator& resonator = resonators[share.index];
      const pack::GridPoint wanted = resonator.constrained
                                         ? pack::GridPoint{}
                                         : pack::GridPoint{resonator.ruling_length_m, resonator.free_border_length_m};
      const pack::Spectrum* spectrum = section ? pack::nearest_spectrum(*section, wanted) : nullptr;
      if (!spectrum) {
        ++missing_;
        continue;
      }
      const double ratio = speed_ratio(contact.speed_m_per_s, *section);
      FrictionCue cue;
      cue.start = start;
      cue.end = end;
      cue.source = dsp::hash(dsp::hash(options_.seed, sheet.id, contact.id), static_cast<std::uint64_t>(share.index));
      if (sheet.pack_changes > 0) cue.source = dsp::hash(cue.source, sheet.pack_changes);
      cue.bus = bus_of(sheet.index, SoundKind::kFriction);
      cue.speed_ratio = static_cast<float>(ratio);
      const double part = options_.mode == Mode::kPublished ? 1 : std::sqrt(part_in(resonator, contact, all));
      const double load = options_.mode == Mode::kPublished ? 1 : load_factor(contact, sheet.grammage_kg_per_m2);
      cue.gain = static_cast<float>(part * load * share.amplitude * level(ratio, *section, resonator, *spectrum));
      cue.emission = material.emission(*spectrum);
      cue.gain_sigma = options_.mode == Mode::kPublished ? 0 : static_cast<float>(section->gain_sigma);
      cue.gain_cutoff_hz = static_cast<float>(section->gain_cutoff_hz);
      cue.emitter = emitter_of(options_.mode, resonator);
      if (sounding.erase(cue.source) == 0 && cue.gain < kInaudible) continue;
      out.emplace_back(cue);
      if (loose) add_slips(cue, material.slip(*spectrum), out);
      if (cue.gain >= kInaudible) alive[cue.source] = cue;
    }
  }

  /// The contact's part, by area, of all that touches along the same resonator: a pack's spectrum is that of a sheet with
  /// all its contacts.
  static double part_in(const Resonator& resonator, const FrictionContact& contact,
                        const std::vector<FrictionContact>& all) {
    double area_m2 = 0;
    int count = 0;
    for (const FrictionContact& other : all) {
      const bool shared =
          &other == &contact || (resonator.number != 0 && std::ranges::any_of(other.resonators, [&](const Resonator& r) {
                                   return r.number == resonator.number;
                                 }));
      if (!shared) continue;
      area_m2 += other.area_m2;
      ++count;
    }
    return area_m2 > 0 ? contact.area_m2 / area_m2 : 1.0 / count;
  }

  static double load_factor(const FrictionContact& contact, double grammage_kg_per_m2) {
    constexpr double kGravity_m_per_s2 = 9.81;
    const double weight_n = grammage_kg_per_m2 * kGravity_m_per_s2 * contact.area_m2;
    if (contact.normal_force_n < 0 || weight_n <= 0) return 1;
    return std::min(std::sqrt(contact.normal_force_n / weight_n), kMostLoadFactor);
  }

  void forget_stuck(sheet::SheetId sheet, const std::vector<FrictionContact>& contacts) {
    std::erase_if(stuck_[sheet],
                  [&](std::uint64_t id) { return std::ranges::find(contacts, id, &FrictionContact::id) == contacts.end(); });
  }

  /// Whether a contact that stuck slides now.
  bool comes_loose(sheet::SheetId sheet, const FrictionContact& contact, const pack::FrictionSection& section) {
    const double ratio = speed_ratio(contact.speed_m_per_s, section);
    if (ratio < kStuckRatio) stuck_[sheet].insert(contact.id);
    return ratio >= kLooseRatio && stuck_[sheet].erase(contact.id) > 0;
  }

  void add_slips(const FrictionCue& sliding, const std::vector<float>& unit, std::vector<Cue>& out) const {
    for (const Slip& slip : slips(dsp::hash(sliding.source, static_cast<std::uint64_t>(sliding.start)), options_.rate_hz)) {
      CrumpleCue cue;
      cue.start = sliding.start + slip.after;
      cue.onset = cue.start + kQuantum;
      cue.event = sliding.source;
      cue.bus = sliding.bus;
      cue.unit = unit.data();
      cue.unit_samples = static_cast<std::uint32_t>(unit.size());
      cue.gain = static_cast<float>(slip.gain) * sliding.gain;
      cue.emitter = sliding.emitter;
      out.emplace_back(cue);
    }
  }

  static double speed_ratio(double speed_m_per_s, const pack::FrictionSection& section) {
    if (!(speed_m_per_s > 0)) return 0;
    return std::min(speed_m_per_s / section.reference_speed_m_per_s, kMaxSpeedRatio);
  }

  double level(double ratio, const pack::FrictionSection& section, const Resonator& resonator,
               const pack::Spectrum& spectrum) const {
    const double size = size_factor(options_.mode, resonator.disc_radius_m, spectrum.radius_m);
    if (options_.mode == Mode::kPublished) return ratio * size;
    return ratio > 0 ? std::pow(ratio, section.speed_exponent) * size : 0;
  }

  static void fade(FrictionCue& cue, SampleTime start, SampleTime end, std::vector<Cue>& out) {
    cue.start = start;
    cue.end = end;
    cue.gain = 0;
    out.emplace_back(cue);
  }

  PlanOptions options_;
  std::map<sheet::SheetId, Sources> sources_;
  std::map<sheet::SheetId, std::set<std::uint64_t>> stuck_;  ///< contacts that stick
  std::uint64_t missing_ = 0;
};

}  // namespace

std::unique_ptr<PlanModel> make_friction_plan(const PlanOptions& options) {
  return std::make_unique<FrictionPlan>(options);
}

}  // namespace rustle::synthesis
