#pragma once

#include <array>
#include <cstddef>
#include <optional>

#include "server/synthesis/acoustic_scene.h"
#include "server/synthesis/ear_filters.h"
#include "server/synthesis/interpolation.h"
#include "server/synthesis/nonblocking.h"
#include "server/synthesis/sound_model.h"
#include "server/synthesis/sound_past.h"

namespace rustle::synthesis {

inline constexpr int kPathLag = kQuantum;       ///< samples by which sound follows its source: ears may hear ahead
inline constexpr double kLongestPath_s = 0.16;  ///< of one path beyond the direct one: 55 m; longer ones are held here

/// From sources that sound all the time and move to the channels: one tap per path and channel,
///   out(n) = Σ_p gain_p(n) y(n - kPathLag - delay_p(n))        by 4-point interpolation, or an ear's filter
/// gains and delays straight between the ends of a quantum (P10). Allocates when made and nowhere else. [render worker]
class SourcePaths {
 public:
  /// [control]
  explicit SourcePaths(const RenderOptions& options);

  /// What a source's past has to keep. [control]
  static SampleTime past_samples(std::uint32_t rate_hz) noexcept;

  /// Adds the quantum of a source that goes from one place to another within it.
  /// \pre the source's sound has been made up to the quantum's end
  void spread(const SoundPast& sound, Bus bus, const spatial::Emitter& from, const spatial::Emitter& to,
              const SceneSpan& scene, SampleTime quantum_start, const BusSamples& out) noexcept RUSTLE_NONBLOCKING;

  /// Once a quantum, after all sources: what the ears have heard.
  void finish(const BusSamples& out) noexcept RUSTLE_NONBLOCKING;
  /// Nothing rings any more.
  bool silent() const noexcept RUSTLE_NONBLOCKING { return !ears_ || ears_->silent(); }

 private:
  /// One path to one channel at one time.
  struct Tap {
    float gain = 0;
    Position delay = 0;
  };
  /// Every path of a source to every channel at one time, and where they come from, to ears.
  struct Taps {
    std::size_t count = 0;
    std::array<std::array<Tap, spatial::kMaxPaths>, spatial::kMaxChannels> at;
    std::array<spatial::Hrtf::Place, spatial::kMaxPaths> places;
  };

  void find_taps(SampleTime reach, const spatial::Emitter& emitter, const AcousticScene& scene, Taps& taps) const noexcept;

  std::size_t channels_;
  double rate_hz_;
  std::optional<EarFilters> ears_;  ///< where the layout is binaural
};

}  // namespace rustle::synthesis
