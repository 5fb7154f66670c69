#pragma once

#include <array>
#include <vector>

#include "server/spatial/dipole.h"
#include "server/synthesis/acoustic_scene.h"
#include "server/synthesis/cue.h"
#include "server/synthesis/nonblocking.h"

namespace rustle::synthesis {

/// How the emitters of each bus move within a quantum, from EmitterMotionCues. A way from c to c' with the turn θ, covered
/// from the share s₀ to s₁ in this quantum, takes a point p and a normal n to
///   p' = c(s₁) + R((s₁ - s₀) θ) (p - c(s₀)),   n' = R n,   c(s) = c + s (c' - c)
/// Everything is allocated by construction. [render worker]
class EmitterMotions {
 public:
  /// [control]
  explicit EmitterMotions(int buses);

  /// A bus follows up to kWays ways at a time; a further one takes the place of the oldest, whose rest it adds to its own
  /// translation.
  /// \pre the cue is finite and its bus is there
  void apply(const EmitterMotionCue& cue, SampleTime quantum_start) noexcept RUSTLE_NONBLOCKING;

  /// Moves on to the quantum from quantum_start.
  void advance(SampleTime quantum_start) noexcept RUSTLE_NONBLOCKING;

  bool any() const noexcept RUSTLE_NONBLOCKING { return stepping_; }
  bool moves(Bus bus) const noexcept RUSTLE_NONBLOCKING { return step_counts_[bus] != 0; }

  /// The emitter at the end of the quantum, from the one at its start. Its covariance stays as it is.
  spatial::Emitter moved(Bus bus, const spatial::Emitter& emitter) const noexcept RUSTLE_NONBLOCKING;

 private:
  static constexpr std::size_t kWays = 4;
  struct Way {
    Ramp<spatial::Vec3> centre_m;
    spatial::Vec3 turn_rad;
    bool used = false;
  };
  struct Step {
    spatial::Vec3 from_m, to_m;
    std::array<spatial::Vec3, 3> rows;  ///< of the rotation
  };

  std::vector<std::array<Way, kWays>> ways_;    ///< by bus, used ones first, oldest first
  std::vector<std::array<Step, kWays>> steps_;  ///< by bus, of this quantum
  std::vector<std::uint8_t> step_counts_;       ///< by bus
  int used_ = 0;                                ///< ways in all
  std::size_t buses_ = 0;                       ///< those before this one have moved or may
  bool stepping_ = false;                       ///< some bus has a step
};

}  // namespace rustle::synthesis
