#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <variant>
#include <vector>

#include "server/synthesis/acoustic_scene.h"
#include "server/synthesis/cue.h"
#include "server/synthesis/interpolation.h"
#include "server/synthesis/nonblocking.h"
#include "server/synthesis/sound_model.h"
#include "server/synthesis/sound_past.h"
#include "server/synthesis/tear_gate.h"
#include "sound_db/dsp/random.h"

namespace rustle::synthesis {

/// The sound of one tear tip at 1 m on the axis, and its past as far as the longest path reaches. Everything is allocated by
/// construction. [render worker]
class TearSource {
 public:
  /// [control]
  TearSource(Mode mode, std::uint32_t rate_hz);

  bool active() const noexcept RUSTLE_NONBLOCKING { return active_; }
  std::uint64_t tip() const noexcept RUSTLE_NONBLOCKING { return tip_; }
  Bus bus() const noexcept RUSTLE_NONBLOCKING { return bus_; }
  /// Where it is heard from, at a time not before the quantum that was made last.
  spatial::Emitter emitter(SampleTime time) const noexcept RUSTLE_NONBLOCKING;

  /// Begins silent where the cue says. \pre not active
  void begin(const TearCue& cue, SampleTime quantum_start) noexcept RUSTLE_NONBLOCKING;
  void apply(const TearCue& cue, SampleTime quantum_start) noexcept RUSTLE_NONBLOCKING;
  void stop() noexcept RUSTLE_NONBLOCKING { active_ = false; }

  /// Makes the quantum's sound; the source is no longer active when it has ended and all of it has been heard.
  void make(SampleTime quantum_start) noexcept RUSTLE_NONBLOCKING;
  /// Whether it sounds in the quantum made last or is still on its way, or will without a further cue.
  bool sounding() const noexcept RUSTLE_NONBLOCKING { return active_ && sounding_; }
  /// What was made.
  const SoundPast& past() const noexcept RUSTLE_NONBLOCKING { return past_; }

 private:
  struct Control {
    double speed_m_per_s = 0, gain = 0;
    spatial::Emitter emitter;
  };
  Control at(SampleTime time) const noexcept;
  void excite(SampleTime quantum_start, std::span<float, kQuantum> out) noexcept;
  void colour(SampleTime quantum_start, std::span<float> sound) noexcept;
  double advance(double step_m) noexcept;

  Mode mode_;
  double rate_hz_;
  std::size_t taps_;
  bool active_ = false, sounding_ = false, ends_ = false;
  std::uint64_t tip_ = 0;
  Bus bus_ = 0;
  Ramp<Control> control_;
  dsp::Random noise_{0};
  TearGate gate_{0};
  PublishedTearGate published_gate_{0};
  std::vector<float> colour_from_;  ///< [taps_] that fades into colour_to_ along with the control
  const float* colour_to_ = nullptr;
  std::vector<float> excitation_;  ///< the last taps_ samples before a quantum, then that
  SoundPast past_;
  SampleTime heard_until_ = 0;  ///< nothing was made from there on
};

}  // namespace rustle::synthesis
