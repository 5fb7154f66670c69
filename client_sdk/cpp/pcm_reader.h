#pragma once

#include <chrono>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include <tl/expected.hpp>

#include "client_sdk/cpp/connection.h"
#include "client_sdk/cpp/types.h"

namespace rustle::client {

namespace internal {
class Subscription;
}

enum class SampleFormat {
  kF32,
  kS16,
  kOpus,  ///< 64 kbit/s a channel in packets of 20 ms, at 8, 12, 16, 24 and 48 kHz; as it was, sample for sample in time
};

struct MixContent {};
/// One sheet, one kind of sound: its part of the mix before the limiter. Stems add up to the mix wherever that does not act.
struct StemContent {
  std::uint32_t sheet_id = 1;
  SoundKind kind = SoundKind::kCrumpling;
};
/// Dry sound per emitter with its position, for engines that spatialize themselves: mono, as heard at 1 m on the emitter's
/// axis. An emitter radiates as a dipole, |cos θ| / R in the distance R at the angle θ from its normal.
struct EmitterContent {};

struct ListenOptions {
  std::variant<MixContent, StemContent, EmitterContent> content{};
  SampleFormat format = SampleFormat::kF32;  ///< on the wire; blocks hold floats either way
  int blocks = 4;                            ///< 1 to 4 in one message: fewer come sooner; not of Opus
  /// Messages that wait here for next(); when they are this many, later ones wait at the daemon and then are lost to this
  /// listener (a gap). 0: no limit. Absent: no limit for a session of the simulation clock, else 4096.
  std::optional<int> queue_messages{};
};

struct EmitterState {
  std::uint64_t emitter_id = 0;  ///< may come again after its last block
  std::uint32_t sheet_id = 0;
  SoundKind kind = SoundKind::kCrumpling;
  Vector3 position{};  ///< at the block's first sample; metres, session's axes
  Vector3 normal{};
  bool last = false;  ///< nothing follows from it; such a block may hold no samples
};

struct PcmBlock {
  std::int64_t first_sample = 0;  ///< 0 is the session's time origin
  std::uint32_t rate_hz = 0;
  std::uint32_t channels = 0;
  std::uint32_t samples = 0;  ///< per channel
  /// Lost before this block, of its emitter where it has one: a gap. At a restart on the LIVE clock: about so many, by when
  /// blocks were read.
  std::uint64_t missing_samples = 0;
  bool restarted = false;            ///< the first of a daemon that was started anew: first_sample counts from 0 again
  double time_s = 0;                 ///< simulation time of the first sample
  std::vector<float> interleaved{};  ///< [samples, channels]
  std::optional<EmitterState> emitter{};
  bool end = false;  ///< the stream is complete: no samples here, `first_sample` is its length
};

/// Samples that were lost: silence in Sound::interleaved from sample `first` on, `samples` per channel.
struct Gap {
  std::uint64_t first = 0;
  std::uint64_t samples = 0;
};

struct Sound {
  std::vector<float> interleaved{};  ///< [samples, channels]
  std::uint32_t channels = 0;
  std::uint32_t rate_hz = 0;
  std::int64_t first_sample = 0;  ///< of the stream; 0 is the session's time origin
  std::vector<Gap> gaps{};
};

/// A session's sound, as it comes. One thread at a time, which does all its work; may be another one than the session's.
class PcmReader {
 public:
  /// Returns when the daemon has seen the subscription: nothing that is sent to the session afterwards is missed.
  /// The session need not exist yet.
  /// `reconnect`: a daemon that has gone is waited for, instead of being an error of check().
  /// Errors: "invalid" (options), "timeout", "unreachable".
  [[nodiscard]] static tl::expected<PcmReader, Error> listen(const Connection& connection, const std::string& session_id,
                                                             const ListenOptions& options = {}, bool reconnect = false);

  PcmReader(PcmReader&&) noexcept;
  PcmReader& operator=(PcmReader&&) noexcept;
  ~PcmReader();

  /// The next block; empty when none came in time, or sooner where check() has an error: everything that came before the
  /// daemon went has been read then.
  [[nodiscard]] std::optional<PcmBlock> next(std::chrono::milliseconds timeout);
  /// What is left until the stream's end, gaps silent and named. Errors: "timeout", "unreachable", "invalid" (emitters,
  /// which are many sounds).
  [[nodiscard]] tl::expected<Sound, Error> read_all(std::chrono::milliseconds timeout = std::chrono::minutes(1));
  /// At once. Error: "unreachable": the daemon has gone, and is not waited for.
  [[nodiscard]] tl::expected<void, Error> check() const;
  /// Whether what the daemon publishes arrives here now. Any thread.
  bool is_heard() const;

  std::uint64_t missing_samples() const;      ///< in all gaps so far; not of emitters that were lost whole
  std::uint64_t missing_messages() const;     ///< lost on the way to this listener
  std::uint64_t unreadable_messages() const;  ///< in a format this version does not know

 private:
  friend class Session;
  struct Impl;
  explicit PcmReader(std::unique_ptr<Impl> impl);
  /// `simulation`: sound follows simulation time, also from one daemon to the next.
  static tl::expected<PcmReader, Error> open(const Connection& connection, const std::string& session_id,
                                             const ListenOptions& options, bool reconnect, bool simulation);
  std::weak_ptr<internal::Subscription> subscription() const;
  std::unique_ptr<Impl> impl_;
};

}  // namespace rustle::client
