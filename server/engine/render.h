#pragma once

#include <cstdint>
#include <vector>

#include "server/engine/audio_quantum.h"
#include "server/engine/cue_batch.h"
#include "server/engine/options.h"
#include "server/synthesis/limiter.h"
#include "server/synthesis/mixer.h"

namespace rustle::engine {

/// What has sounded, and what was lost or altered on the way out.
struct RenderCounters : synthesis::RenderCounters {
  std::uint64_t voices_most = 0;         ///< that sounded at one time
  std::uint64_t samples_limited = 0;     ///< turned down by the limiter
  std::uint64_t samples_not_finite = 0;  ///< replaced by silence
};

/// The second half of the engine: batches of cues in, quanta of sound out.
///
///   cues ─► mixer ─► buses ─┬─► stems
///                           └─► sum ─► gain ─► limiter ─► mix
///
/// Owns no thread, socket, file or clock; allocates when made and nowhere else.
class Render {
 public:
  explicit Render(const Options& options);

  /// A quantum of the right shape. [control]
  AudioQuantum make_quantum() const;

  /// Takes a batch: its cues, then its horizon. [render worker]
  void accept(const CueBatch& batch) noexcept RUSTLE_NONBLOCKING;

  /// The next quantum, [position(), position() + kQuantum). [render worker]
  void next(AudioQuantum& out) noexcept RUSTLE_NONBLOCKING;

  synthesis::SampleTime position() const noexcept { return position_; }
  /// Sound before this sample is settled.
  synthesis::SampleTime horizon() const noexcept { return horizon_; }
  /// The stream has ended; tails may go on.
  bool ending() const noexcept { return ending_; }
  /// The stream has ended and its tails have died away.
  bool complete() const noexcept;

  /// [render worker]
  RenderCounters counters() const noexcept RUSTLE_NONBLOCKING;

 private:
  static constexpr double kLongestTail_s = 10;

  const Options options_;
  const int channels_;
  const float gain_;
  synthesis::Mixer mixer_;
  synthesis::Limiter limiter_;
  std::vector<sheet::SheetId> sheets_;  ///< by index among the buses
  std::vector<float> buses_;            ///< [bus][channel][kQuantum]
  std::vector<float> sum_;              ///< [channel][kQuantum]
  std::uint64_t voices_most_ = 0;
  synthesis::SampleTime position_ = 0;
  synthesis::SampleTime horizon_ = 0;
  synthesis::SampleTime end_ = 0;
  bool ending_ = false;
};

}  // namespace rustle::engine
