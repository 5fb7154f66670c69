#include "server/validation/stage.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "server/validation/check.h"

namespace rustle::validation {
namespace {

synthesis::PlanOptions plan_options(synthesis::Mode mode, std::uint64_t seed) {
  synthesis::PlanOptions options;
  options.seed = seed;
  options.mode = mode;
  options.rate_hz = kRate_hz;
  options.fine_events = false;
  return options;
}

synthesis::RenderOptions render_options(synthesis::Mode mode, int max_voices) {
  synthesis::RenderOptions options;
  options.mode = mode;
  options.rate_hz = kRate_hz;
  options.layout = spatial::Layout::kMono;
  options.max_sheets = 1;
  options.max_voices = max_voices;
  return options;
}

}  // namespace

std::shared_ptr<const pack::SoundPack> make_stage_pack(std::vector<float> magnitudes, std::vector<float> unit) {
  auto made = std::make_shared<pack::SoundPack>();
  made->name = made->material = "stage";
  made->rate_hz = made->stored_rate_hz = kRate_hz;
  made->crumpling.emplace();
  made->friction.emplace();
  made->friction->rate_hz = kRate_hz;
  made->friction->fft_size = static_cast<std::uint32_t>(2 * (magnitudes.size() - 1));
  made->friction->gain_sigma = 0;
  for (const pack::GridPoint& point : {pack::GridPoint{}, kStagePoint}) {
    pack::Unit one;
    one.point = point;
    one.samples = unit;
    one.radius_m = point.disc_radius_m();
    made->crumpling->units.push_back(std::move(one));
    pack::Spectrum spectrum;
    spectrum.point = point;
    spectrum.magnitudes = magnitudes;
    spectrum.radius_m = point.disc_radius_m();
    made->friction->spectra.push_back(std::move(spectrum));
  }
  return made;
}

observation::Resonator stage_resonator(const sheet::Vec3d& position_m, const sheet::Vec3d& normal) {
  observation::Resonator r;
  r.constrained = false;
  r.ruling_length_m = kStagePoint.ruling_length_m;
  r.free_border_length_m = kStagePoint.free_border_length_m;
  r.area_m2 = 0.01;
  r.disc_radius_m = std::sqrt(r.area_m2 / std::numbers::pi);
  r.position_m = position_m;
  r.normal = normal;
  return r;
}

spatial::Listener above() {
  return {{0, 0, 1}, {0, 0, -1}, {0, 1, 0}};
}

Stage::Stage(std::shared_ptr<const pack::SoundPack> pack, synthesis::Mode mode, const spatial::Listener& listener,
             std::uint64_t seed, int max_voices)
    : pack_(std::move(pack)),
      planner_(plan_options(mode, seed)),
      mixer_(render_options(mode, max_voices)),
      quantum_(mixer_.quantum_size()) {
  synthesis::SheetSetup setup;
  setup.id = 1;
  setup.pack = pack_;
  planner_.add_sheet(setup, 0, cues_);
  planner_.listener(listener, 0, 0, cues_);
}

observation::Observation Stage::frame(double previous_s, double time_s) const {
  observation::Observation observed;
  observed.sheet = 1;
  observed.previous_time_s = previous_s;
  observed.time_s = time_s;
  return observed;
}

void Stage::slide(const std::vector<observation::Resonator>& sources, double end_s) {
  constexpr double kStep_s = 0.2;
  double before_s = 0;
  for (int k = 0; before_s < end_s; ++k) {
    auto observed = frame(before_s, std::min(end_s, kStep_s * k));
    for (std::size_t s = 0; s < sources.size(); ++s) {
      observation::FrictionContact contact;
      contact.id = s + 1;
      contact.speed_m_per_s = 0.1;
      contact.area_m2 = sources[s].area_m2;
      contact.resonators = {sources[s]};
      observed.friction.push_back(std::move(contact));
    }
    planner_.plan(observed, 0, cues_);
    before_s = observed.time_s;
  }
}

void Stage::flap(const observation::Resonator& resonator, double time_s) {
  auto observed = frame(time_s, time_s + 0.01);
  observation::CrumplingEvent event;
  event.id = next_event_++;
  event.time_s = event.confirmed_s = time_s;
  event.amplitude_m = pack_->crumpling->reference_amplitude_m(kStagePoint);
  event.resonators = {resonator};
  observed.crumpling = {event};
  planner_.plan(observed, 0, cues_);
}

void Stage::hand_over(synthesis::SampleTime until) {
  planner_.release(until, cues_);
  for (const auto& cue : cues_) mixer_.apply(cue);
  cues_.clear();
}

std::vector<float> Stage::run(synthesis::SampleTime samples) {
  std::vector<float> out;
  out.reserve(static_cast<std::size_t>(samples) + synthesis::kQuantum);
  for (const auto end = now_ + samples; now_ < end; now_ += synthesis::kQuantum) {
    mixer_.render(now_, quantum_);
    const std::size_t at = out.size();
    out.resize(at + synthesis::kQuantum, 0.0F);
    for (int bus = 0; bus < mixer_.buses(); ++bus) {
      if (!mixer_.sounding(static_cast<synthesis::Bus>(bus))) continue;
      const float* samples_of_bus = quantum_.data() + static_cast<std::size_t>(bus) * synthesis::kQuantum;
      for (std::size_t n = 0; n < synthesis::kQuantum; ++n) out[at + n] += samples_of_bus[n];
    }
  }
  return out;
}

}  // namespace rustle::validation
