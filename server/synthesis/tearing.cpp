#include "server/synthesis/tearing.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <utility>
#include <vector>

#include "server/synthesis/resonator_level.h"
#include "server/synthesis/tear_colour.h"
#include "server/synthesis/tear_gate.h"
#include "sound_db/dsp/level.h"
#include "sound_db/dsp/random.h"
#include "sound_db/pack/emission.h"
#include "sound_db/pack/query.h"

namespace rustle::synthesis {
namespace {

using observation::Resonator;
using observation::TearEvent;

class TearingPlan final : public PlanModel {
 public:
  explicit TearingPlan(const PlanOptions& options) : options_(options) {}

  void plan(const SheetPlan& sheet, const observation::Observation& observation, SampleTime earliest,
            std::vector<Cue>& out) override {
    if (observation.tears.empty() && !tips_.contains(sheet.id)) return;
    const SampleTime start = std::max(to_sample(options_, observation.previous_time_s), earliest);
    const SampleTime end = std::max(to_sample(options_, observation.time_s), start + samples(kLeastTearRamp_s));
    Tips& tips = tips_[sheet.id];
    Tips alive;
    for (const TearEvent& tear : observation.tears) {
      const auto known = tips.find(tear.id);
      const double speed = tear.speed_m_per_s > 0 ? std::min(tear.speed_m_per_s, kMostTearSpeed_m_per_s) : 0;
      if (known == tips.end() && speed == 0) continue;
      TearCue cue = known == tips.end() ? begun(sheet, tear.id) : known->second;
      cue.start = start;
      cue.end = end;
      cue.speed_m_per_s = static_cast<float>(speed);
      settle_at(sheet, tear, cue);
      out.emplace_back(cue);
      if (known != tips.end()) tips.erase(known);
      alive[tear.id] = cue;
    }
    for (auto& [id, cue] : tips) finish(cue, start, end, out);
    tips = std::move(alive);
  }

  void release(SampleTime, std::vector<Cue>&) override {}

  void end_sheet(const SheetPlan& sheet, SampleTime time, std::vector<Cue>& out) override {
    const auto found = tips_.find(sheet.id);
    if (found == tips_.end()) return;
    for (auto& [id, cue] : found->second) finish(cue, time, time + samples(kTearEnd_s), out);
    tips_.erase(found);
  }

  void add_counters(PlanCounters&) const override {}

  void forget(const Material& material) override {
    const auto gone = colours_.find(&material);
    if (gone == colours_.end()) return;
    for (auto& [sheet, tips] : tips_) {
      std::erase_if(tips, [&](const auto& tip) {
        return std::ranges::any_of(gone->second, [&](const auto& c) { return c.second.data() == tip.second.colour; });
      });
    }
    colours_.erase(gone);
  }

 private:
  using Tips = std::map<std::uint64_t, TearCue>;  ///< the last cue of each tip

  SampleTime samples(double duration_s) const { return std::llround(duration_s * options_.rate_hz); }

  TearCue begun(const SheetPlan& sheet, std::uint64_t tip) {
    TearCue cue;
    const std::uint64_t times = begun_[{sheet.id, tip}]++;
    cue.tip = dsp::hash(dsp::hash(options_.seed, sheet.id, tip), times);
    cue.bus = bus_of(sheet.index, SoundKind::kTearing);
    return cue;
  }

  void settle_at(const SheetPlan& sheet, const TearEvent& tear, TearCue& cue) {
    const Resonator* loudest = nullptr;
    for (const Resonator& resonator : tear.resonators) {
      const auto rank = [](const Resonator& r) { return std::pair(!r.constrained, r.area_m2); };
      if (!loudest || rank(resonator) > rank(*loudest)) loudest = &resonator;
    }
    const Resonator resonator = loudest ? *loudest : bare_resonator(tear.position_m, 0);
    cue.emitter = emitter_of(options_.mode, resonator);
    cue.emitter.position_m = tear.position_m;
    cue.gain = static_cast<float>(dsp::db_to_gain(kReferenceTear_dbfs));
    if (options_.mode == Mode::kPublished) return;
    cue.gain *= static_cast<float>(sheet.grammage_kg_per_m2 / kReferenceGrammage_kg_per_m2);
    cue.colour = colour(*sheet.material, resonator);
  }

  const float* colour(const Material& material, const Resonator& resonator) {
    const auto& section = material.pack().friction;
    const pack::GridPoint wanted = resonator.constrained
                                       ? pack::GridPoint{}
                                       : pack::GridPoint{resonator.ruling_length_m, resonator.free_border_length_m};
    const pack::Spectrum* spectrum = section ? pack::nearest_spectrum(*section, wanted) : nullptr;
    if (!spectrum) {
      if (plain_.empty()) plain_ = tear_colour({}, options_.rate_hz);
      return plain_.data();
    }
    auto& known = colours_[&material][spectrum];
    if (known.empty()) {
      const auto bins = static_cast<int>(section->fft_size / 2 + 1);
      known = tear_colour(pack::emission_spectrum(*section, *spectrum, bins, options_.rate_hz), options_.rate_hz);
    }
    return known.data();
  }

  static void finish(TearCue& cue, SampleTime start, SampleTime end, std::vector<Cue>& out) {
    cue.start = start;
    cue.end = end;
    cue.speed_m_per_s = 0;
    cue.ends = true;
    out.emplace_back(cue);
  }

  PlanOptions options_;
  std::vector<float> plain_;  ///< the colour where a pack has no spectrum, from the first time that it is wanted
  std::map<sheet::SheetId, Tips> tips_;
  std::map<std::pair<sheet::SheetId, std::uint64_t>, std::uint64_t> begun_;  ///< how often each tip began
  std::map<const Material*, std::map<const pack::Spectrum*, std::vector<float>>> colours_;
};

}  // namespace

std::unique_ptr<PlanModel> make_tearing_plan(const PlanOptions& options) {
  return std::make_unique<TearingPlan>(options);
}

}  // namespace rustle::synthesis
