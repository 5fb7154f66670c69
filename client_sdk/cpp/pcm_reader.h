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

enum class SampleFormat { kF32, kS16 };

struct MixContent {};
/// One sheet, one kind of sound.
struct StemContent {
  std::uint32_t sheet_id = 1;
  SoundKind kind = SoundKind::kCrumpling;
};
/// Dry sound per emitter with its position, for engines that spatialize themselves.
struct EmitterContent {};

struct ListenOptions {
  std::variant<MixContent, StemContent, EmitterContent> content{};
  SampleFormat format = SampleFormat::kF32;  ///< on the wire; blocks hold floats either way
  int blocks = 4;                            ///< 1 to 4 in one message: fewer come sooner
  /// Messages that wait here for next(); when they are this many, later ones wait at the daemon and then are lost to this
  /// listener (a gap). 0: no limit. Absent: no limit for a session of the simulation clock, else 4096.
  std::optional<int> queue_messages{};
};

struct EmitterState {
  std::uint64_t emitter_id = 0;
  std::uint32_t sheet_id = 0;
  SoundKind kind = SoundKind::kCrumpling;
  Vector3 position{};  ///< metres, session's axes
  Vector3 normal{};
  bool last = false;  ///< nothing follows from it
};

struct PcmBlock {
  std::int64_t first_sample = 0;  ///< 0 is the session's time origin
  std::uint32_t rate_hz = 0;
  std::uint32_t channels = 0;
  std::uint32_t samples = 0;          ///< per channel
  std::uint64_t missing_samples = 0;  ///< lost before this block: a gap
  double time_s = 0;                  ///< simulation time of the first sample
  std::vector<float> interleaved{};   ///< [samples, channels]
  std::optional<EmitterState> emitter{};
  bool end = false;  ///< the stream is complete: no samples here, `first_sample` is its length
};

/// A session's sound, as it comes. One thread at a time; may be another one than the session's.
class PcmReader {
 public:
  /// Returns when the daemon has seen the subscription: nothing that is sent to the session afterwards is missed.
  /// The session need not exist yet.
  [[nodiscard]] static tl::expected<PcmReader, Error> listen(const Connection& connection, const std::string& session_id,
                                                             const ListenOptions& options = {});

  PcmReader(PcmReader&&) noexcept;
  PcmReader& operator=(PcmReader&&) noexcept;
  ~PcmReader();

  /// The next block; empty when none came in time.
  [[nodiscard]] std::optional<PcmBlock> next(std::chrono::milliseconds timeout);

  std::uint64_t missing_samples() const;      ///< in all gaps so far
  std::uint64_t unreadable_messages() const;  ///< in a format this version does not know

 private:
  struct Impl;
  explicit PcmReader(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace rustle::client
