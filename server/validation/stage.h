#pragma once

#include <memory>
#include <span>
#include <vector>

#include "server/observation/observation.h"
#include "server/synthesis/mixer.h"
#include "server/synthesis/planner.h"
#include "sound_db/pack/sound_pack.h"

/// The synthesis alone: a planner and a mixer under one hand, for laws that hold whatever a sheet does. Events come alone,
/// without the finer ones of P13.
namespace rustle::validation {

inline constexpr pack::GridPoint kStagePoint{0.10, 0.20};
/// Up to where the plan hands over everything.
inline constexpr synthesis::SampleTime kEver = INT64_MAX;

/// A pack of one bent sheet and a flat one, recorded at 1 m on the axis without planes, so that it emits what it holds: its
/// friction `magnitudes` at 0.1 m/s (513 bins), its only flap and clac `unit`, made for events of the pack's own reference
/// amplitude. No random gain.
std::shared_ptr<const pack::SoundPack> make_stage_pack(std::vector<float> magnitudes, std::vector<float> unit);

/// A bent 10 x 10 cm sheet as a point.
observation::Resonator stage_resonator(const sheet::Vec3d& position_m = sheet::Vec3d::Zero(),
                                       const sheet::Vec3d& normal = sheet::Vec3d::UnitZ());

class Stage {
 public:
  Stage(std::shared_ptr<const pack::SoundPack> pack, synthesis::Mode mode, const spatial::Listener& listener,
        std::uint64_t seed = 7, int max_voices = 512);

  synthesis::Planner& planner() { return planner_; }
  std::vector<synthesis::Cue>& cues() { return cues_; }

  /// An observation of the sheet between two times.
  observation::Observation frame(double previous_s, double time_s) const;
  /// `sources` equal bent sheets sliding at 0.1 m/s from 0 to end_s.
  void slide(const std::vector<observation::Resonator>& sources, double end_s);
  /// One event at its unit's own level.
  void flap(const observation::Resonator& resonator, double time_s);

  /// Everything planned before `until` goes to the mixer.
  void hand_over(synthesis::SampleTime until = kEver);
  /// Renders on for whole quanta: the sum of all buses.
  std::vector<float> run(synthesis::SampleTime samples);

 private:
  std::shared_ptr<const pack::SoundPack> pack_;
  synthesis::Planner planner_;
  synthesis::Mixer mixer_;
  std::vector<synthesis::Cue> cues_;
  std::vector<float> quantum_;
  synthesis::SampleTime now_ = 0;
  std::uint64_t next_event_ = 1;
};

/// A listener at 1 m above the origin that looks down on it.
spatial::Listener above();

}  // namespace rustle::validation
