#pragma once

#include <array>
#include <span>

#include "server/spatial/dipole.h"
#include "server/synthesis/cue.h"
#include "server/synthesis/nonblocking.h"

namespace rustle::synthesis {

/// A straight change of a value over a span of samples.
template <class T>
struct Ramp {
  SampleTime start = 0, end = 0;
  T from{}, to{};

  /// 0 up to start, 1 from end on.
  double progress(SampleTime time) const noexcept {
    if (time >= end) return 1;
    return time <= start ? 0 : static_cast<double>(time - start) / static_cast<double>(end - start);
  }
  bool moves_within(SampleTime begin, SampleTime finish) const noexcept { return start < finish && end > begin; }
};

/// Listener and planes at one time.
struct AcousticScene {
  spatial::Listener listener;
  std::array<spatial::Receiver, spatial::kMaxChannels> receivers;
  std::array<spatial::Plane, spatial::kMaxPlanes> planes;
  int plane_count = 0;  ///< slots in use, gone planes with reflection 0 included

  std::span<const spatial::Plane> used_planes() const noexcept {
    return std::span(planes).first(static_cast<std::size_t>(plane_count));
  }
};

/// The scene at the two ends of a quantum.
struct SceneSpan {
  AcousticScene before, after;
  bool moves = false;  ///< `after` differs from the previous quantum's
};

/// Listener and planes through time, from their cues. [render worker]
class SceneTrack {
 public:
  explicit SceneTrack(spatial::Layout layout) noexcept;

  /// \pre quantum_start is the start of the quantum about to be rendered
  void apply(const ListenerCue& cue, SampleTime quantum_start) noexcept RUSTLE_NONBLOCKING;
  void apply(const PlaneCue& cue, SampleTime quantum_start) noexcept RUSTLE_NONBLOCKING;
  /// Moves on to the quantum from quantum_start.
  void advance(SampleTime quantum_start) noexcept RUSTLE_NONBLOCKING;
  const SceneSpan& scene() const noexcept RUSTLE_NONBLOCKING { return span_; }

 private:
  void evaluate(SampleTime time, AcousticScene& out) const noexcept;
  spatial::Listener listener_at(SampleTime time) const noexcept;
  spatial::Plane plane_at(int slot, SampleTime time) const noexcept;

  spatial::Layout layout_;
  Ramp<spatial::Listener> listener_;
  std::array<Ramp<spatial::Plane>, spatial::kMaxPlanes> planes_;
  int plane_count_ = 0;
  bool placed_ = false;  ///< a listener has been heard of
  bool changed_ = true;  ///< a cue came since the last quantum
  SceneSpan span_;
};

}  // namespace rustle::synthesis
