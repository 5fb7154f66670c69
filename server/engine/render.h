#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <span>
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
///   cues ─► mixer ─► buses ─► gain ─┬─► stems
///                                   └─► sum ─► limiter ─► mix
///
/// Stems are taken before the limiter: where it does not act, their sum in the order of their buses is the mix, bit for bit.
/// Emitters (EmitterSounds) have the gains but neither directions nor limiter. Neither changes the mix.
/// Owns no thread, socket, file or clock; allocates when made and nowhere else.
class Render {
 public:
  explicit Render(const Options& options);

  /// A quantum of the right shape. [control]
  AudioQuantum make_quantum() const;

  /// What a quantum is given so that every emitter is rendered by itself too. [control]
  std::unique_ptr<synthesis::EmitterSounds> make_emitters() const;

  /// Takes a batch: its cues, then its horizon. [render worker]
  void accept(const CueBatch& batch) noexcept RUSTLE_NONBLOCKING;

  /// The next quantum, [position(), position() + kQuantum). [render worker]
  void next(AudioQuantum& out) noexcept RUSTLE_NONBLOCKING;

  /// Where a sheet's sounds of one kind go; absent: the sheet was not accepted. [render worker]
  std::optional<synthesis::Bus> bus_of(sheet::SheetId sheet, synthesis::SoundKind kind) const noexcept RUSTLE_NONBLOCKING;
  /// What a bus was in the last quantum, interleaved: its part of the mix before the limiter. [render worker]
  /// \pre next() was called, out has kQuantum x channels samples
  void stem(synthesis::Bus bus, std::span<float> out) const noexcept RUSTLE_NONBLOCKING;

  synthesis::SampleTime position() const noexcept { return position_; }
  /// Sound before this sample is settled.
  synthesis::SampleTime horizon() const noexcept { return horizon_; }
  /// The stream has ended; tails may go on.
  bool ending() const noexcept { return ending_; }
  /// Nothing sounds and nothing will without a further cue.
  bool silent() const noexcept RUSTLE_NONBLOCKING { return mixer_.silent(); }
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
