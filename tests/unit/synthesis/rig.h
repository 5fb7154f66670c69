#pragma once

#include <cmath>
#include <cstdint>
#include <memory>
#include <numbers>
#include <vector>

#include "server/synthesis/mixer.h"
#include "server/synthesis/planner.h"
#include "sound_db/dsp/level.h"
#include "sound_db/pack/sound_pack.h"

/// A synthetic pack, events by hand, and a planner and mixer in one, for the tests of this folder.
namespace rustle::synthesis::rig {

inline constexpr pack::GridPoint kBent{0.10, 0.20};

struct PackOptions {
  std::uint32_t rate_hz = 48000;
  double speed_exponent = 1.0;
  double gain_sigma = 0;
  double friction_db = -32;
  std::vector<float> unit{0.1F};  ///< of the bent grid point
  std::vector<float> clac{0.1F};
  int variants = 1;
  bool fine_events = false;
};

/// White friction of friction_db RMS, bent and flat; units as given. Recorded at 1 m on the axis without planes, so emission
/// is as heard.
inline std::shared_ptr<const pack::SoundPack> make_pack(const PackOptions& options) {
  auto made = std::make_shared<pack::SoundPack>();
  made->name = made->material = "test-paper";
  made->rate_hz = made->stored_rate_hz = options.rate_hz;
  const auto unit = [](const pack::GridPoint& point, const std::vector<float>& samples, float gain) {
    pack::Unit u;
    u.point = point;
    u.radius_m = point.disc_radius_m();
    u.samples = samples;
    for (float& x : u.samples) x *= gain;
    return u;
  };
  pack::CrumplingSection crumpling;
  for (int v = 0; v < options.variants; ++v)
    crumpling.units.push_back(unit(kBent, options.unit, 1.0F / static_cast<float>(v + 1)));
  crumpling.units.push_back(unit({}, options.clac, 1));
  made->crumpling = crumpling;
  pack::FrictionSection friction;
  friction.rate_hz = options.rate_hz;
  friction.fft_size = static_cast<std::uint32_t>(friction_fft_size(options.rate_hz));
  friction.speed_exponent = options.speed_exponent;
  friction.gain_sigma = options.gain_sigma;
  for (const pack::GridPoint& point : {kBent, pack::GridPoint{}}) {
    pack::Spectrum white;
    white.point = point;
    white.radius_m = point.disc_radius_m();
    white.magnitudes.assign(friction.fft_size / 2 + 1, static_cast<float>(dsp::db_to_gain(options.friction_db)));
    friction.spectra.push_back(white);
  }
  made->friction = friction;
  return made;
}

inline observation::Resonator bent_resonator(const sheet::Vec3d& position_m = {0, 0, 0},
                                             const sheet::Vec3d& normal = {0, 0, 1}) {
  observation::Resonator r;
  r.constrained = false;
  r.ruling_length_m = 0.1;
  r.free_border_length_m = 0.2;
  r.area_m2 = 0.01;
  r.disc_radius_m = std::sqrt(0.01 / std::numbers::pi);
  r.position_m = position_m;
  r.normal = normal;
  return r;
}

inline observation::CrumplingEvent flap(std::uint64_t id, double time_s, double amplitude_m,
                                        std::vector<observation::Resonator> resonators = {bent_resonator()}) {
  observation::CrumplingEvent event;
  event.id = id;
  event.time_s = event.confirmed_s = time_s;
  event.amplitude_m = amplitude_m;
  event.resonators = std::move(resonators);
  return event;
}

inline observation::FrictionContact slide(std::uint64_t id, double speed_m_per_s,
                                          std::vector<observation::Resonator> resonators = {bent_resonator()}) {
  observation::FrictionContact contact;
  contact.id = id;
  contact.speed_m_per_s = speed_m_per_s;
  contact.area_m2 = 0.01;
  contact.resonators = std::move(resonators);
  return contact;
}

/// A listener at 1 m above the origin, looking down on it.
inline spatial::Listener above() {
  return {{0, 0, 1}, {0, 0, -1}, {0, 1, 0}};
}

struct Rig {
  PlanOptions plan_options;
  RenderOptions render_options;
  Planner planner;
  Mixer mixer;
  std::vector<Cue> cues;
  SampleTime now = 0;
  std::vector<float> quantum;

  explicit Rig(const PackOptions& pack_options = {}, Mode mode = Mode::kCorrected,
               spatial::Layout layout = spatial::Layout::kMono, int max_voices = 512,
               const spatial::Listener& first = above())
      : plan_options{7, mode, pack_options.rate_hz, 0, pack_options.fine_events},
        render_options{mode, pack_options.rate_hz, layout, 2, max_voices, 128},
        planner(plan_options),
        mixer(render_options),
        quantum(mixer.quantum_size()) {
    planner.add_sheet({1, 0, make_pack(pack_options), {}}, 0, cues);
    planner.listener(first, 0, 0, cues);
  }

  /// Everything planned so far goes to the mixer.
  void hand_over(SampleTime until = INT64_MAX) {
    planner.release(until, cues);
    for (const Cue& cue : cues) mixer.apply(cue);
    cues.clear();
  }

  observation::Observation frame(double previous_s, double time_s) const {
    observation::Observation o;
    o.sheet = 1;
    o.previous_time_s = previous_s;
    o.time_s = time_s;
    return o;
  }

  /// Contacts that stay as they are from 0 to end_s, a frame every half second or less.
  void hold(const std::vector<observation::FrictionContact>& contacts, double end_s) {
    double before = 0;
    for (double t = 0; before < end_s || t == 0; t = std::min(end_s, t + 0.2)) {
      auto o = frame(before, t);
      o.friction = contacts;
      planner.plan(o, 0, cues);
      if (before == t && t > 0) break;
      before = t;
    }
  }

  /// Renders on for a number of samples (rounded up to quanta): the sum of all buses of one channel per vector.
  std::vector<std::vector<float>> run(SampleTime samples) {
    const auto channels = static_cast<std::size_t>(mixer.channels());
    std::vector<std::vector<float>> out(channels);
    for (const SampleTime end = now + samples; now < end; now += kQuantum) {
      mixer.render(now, quantum);
      for (std::size_t c = 0; c < channels; ++c) {
        const std::size_t at = out[c].size();
        out[c].resize(at + kQuantum);
        for (std::size_t bus = 0; bus < static_cast<std::size_t>(mixer.buses()); ++bus) {
          if (!mixer.sounding(static_cast<Bus>(bus))) continue;
          for (std::size_t n = 0; n < kQuantum; ++n) out[c][at + n] += quantum[(bus * channels + c) * kQuantum + n];
        }
      }
    }
    return out;
  }
};

inline double rms_db(const std::vector<float>& x, std::size_t from = 0) {
  return dsp::rms_dbfs(std::span(x).subspan(std::min(from, x.size())));
}

}  // namespace rustle::synthesis::rig
