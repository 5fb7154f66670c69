#pragma once

#include <cstdint>
#include <type_traits>
#include <variant>

#include "server/sheet/vector.h"
#include "server/spatial/dipole.h"

/// Instructions from the synthesis plan (analysis side) to the synthesis render (audio side). Plain data of fixed size:
/// they cross a single-producer single-consumer queue. What they point to outlives them (the planner retains it).
namespace rustle::synthesis {

/// Samples since the session's time origin, at the session's rate.
using SampleTime = std::int64_t;

/// Rendering goes in quanta on the absolute sample grid, so that no block size can change a sample.
inline constexpr int kQuantum = 64;

enum class SoundKind : std::uint8_t { kCrumpling, kFriction, kTearing };
inline constexpr int kSoundKinds = 3;

/// A sum of sounds that can be listened to by itself: one per sheet and kind.
using Bus = std::uint16_t;
constexpr Bus bus_of(int sheet_index, SoundKind kind) noexcept {
  return static_cast<Bus>(sheet_index * kSoundKinds + static_cast<int>(kind));
}
constexpr int sheet_of(Bus bus) noexcept {
  return bus / kSoundKinds;
}
constexpr SoundKind kind_of(Bus bus) noexcept {
  return static_cast<SoundKind>(bus % kSoundKinds);
}

/// Starts one unit of an event (P9). Several cues of one event are its resonators.
struct CrumpleCue {
  SampleTime start = 0;  ///< the voice may sound from here on: an ear nearer than the head's centre hears before the onset
  SampleTime onset = 0;  ///< the unit's first sample, as heard on the direct path at the listener's centre
  std::uint64_t event = 0;  ///< of the event, or of the first one it continues
  Bus bus = 0;
  std::uint16_t resonator = 0;
  const float* unit = nullptr;  ///< unit_samples of the pack's memory
  std::uint32_t unit_samples = 0;
  float gain = 0;  ///< at 1 m on the axis
  spatial::Emitter emitter;
};

/// An event that grew: its voices go to `factor` times their gain within 2 ms.
struct CrumpleRaiseCue {
  SampleTime start = 0;
  std::uint64_t event = 0;
  Bus bus = 0;
  float factor = 1;
};

/// A control point of one friction source: from its present values linearly to these, over [start, end].
struct FrictionCue {
  SampleTime start = 0;
  SampleTime end = 0;
  std::uint64_t source = 0;  ///< key of (episode, resonator) and seed of its noise
  Bus bus = 0;
  float gain = 0;                   ///< at 1 m on the axis; 0 ends the source
  float speed_ratio = 0;            ///< speed / reference speed: how fast the slow random gain moves
  const float* emission = nullptr;  ///< friction_fft_size / 2 + 1 magnitudes at 1 m on the axis and reference speed
  float gain_sigma = 0;             ///< of the logarithm of the slow random gain
  float gain_cutoff_hz = 0;         ///< of the same, at the reference speed
  spatial::Emitter emitter;
};

/// A control point of one tear tip: from its present values linearly to these, over [start, end].
struct TearCue {
  SampleTime start = 0;
  SampleTime end = 0;
  std::uint64_t tip = 0;  ///< seed of its noise and of its breaks; nothing else has it at the same time
  Bus bus = 0;
  float gain = 0;                 ///< RMS at 1 m on the axis and kReferenceTearSpeed_m_per_s
  float speed_m_per_s = 0;        ///< 0: silent
  bool ends = false;              ///< the tip is no more once it is reached
  const float* colour = nullptr;  ///< tear_colour_taps of a filter; null: none
  spatial::Emitter emitter;
};

inline constexpr std::int8_t kEveryChannel = -1;

/// A stretch of a cloth patch's sound (C6): samples that it plays from `first` on, beside others. The patch goes linearly to
/// the emitter's place until `until`; a new one begins there.
struct ClothPieceCue {
  SampleTime start = 0;  ///< the patch makes its sound kPathLag before it is heard
  SampleTime first = 0;  ///< as heard on the direct path at the listener's centre
  SampleTime until = 0;
  std::uint64_t patch = 0;
  Bus bus = 0;
  std::int8_t channel = kEveryChannel;  ///< or the one that the sound goes to as it is (C7)
  const float* samples = nullptr;
  std::uint32_t count = 0;
  float gain = 0;  ///< at 1 m; of one channel, as heard
  spatial::Emitter emitter;
};

/// A sheet goes a rigid way over [start, end]; the emitters of the bus's voices go along: by turn_rad about from_m while
/// that point goes to to_m. Cues of one bus add up, also where their spans overlap.
struct EmitterMotionCue {
  SampleTime start = 0;
  SampleTime end = 0;
  Bus bus = 0;
  spatial::Vec3 from_m;
  spatial::Vec3 to_m;
  spatial::Vec3 turn_rad;  ///< axis times angle
};

/// The listener goes to this pose over [start, end]; the first one is taken at once.
struct ListenerCue {
  SampleTime start = 0;
  SampleTime end = 0;
  spatial::Listener listener;
};

/// The plane in one of spatial::kMaxPlanes slots goes to this pose and reflection over [start, end].
struct PlaneCue {
  SampleTime start = 0;
  SampleTime end = 0;
  std::uint16_t slot = 0;
  bool fresh = false;  ///< a new plane: its pose is taken at once, its reflection comes up from 0
  spatial::Plane plane;
};

/// A bus goes to this gain over [start, end], by a curve that is flat at both ends. One that comes while it is on its way to
/// another begins when that is reached, the newest of several alone; one that comes too late takes as long.
struct GainCue {
  SampleTime start = 0;
  SampleTime end = 0;
  Bus bus = 0;
  float gain = 1;
};

/// At most so many units sound at a time from `start` on, of those that the mixer has room for; the quietest of what is
/// beyond fade.
struct VoiceLimitCue {
  SampleTime start = 0;
  int most = 0;
};

using Cue = std::variant<CrumpleCue, CrumpleRaiseCue, FrictionCue, ListenerCue, PlaneCue, GainCue, EmitterMotionCue,
                         VoiceLimitCue, TearCue, ClothPieceCue>;
static_assert(std::is_trivially_copyable_v<Cue>);

/// When the mixer acts on a cue: in the quantum that holds this sample, or in the next to come if that one is past.
inline SampleTime start_of(const Cue& cue) noexcept {
  return std::visit([](const auto& c) noexcept { return c.start; }, cue);
}

}  // namespace rustle::synthesis
