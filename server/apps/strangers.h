#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "server/session/clock.h"
#include "server/wire/stream_envelope.h"

namespace rustle::apps {

/// A publisher that has not announced itself: what it said of its sheets and scene so far, in case it never does.
struct Stranger {
  session::WallClock::Duration since{};
  std::optional<session::WallClock::Duration> told;  ///< when it was last told that nobody knows it
  std::vector<wire::StreamEnvelope> said;
  std::size_t bytes = 0;
  std::uint64_t left_out = 0;  ///< descriptions beyond the limits
  std::uint64_t frames = 0;    ///< that came before it was known; none is kept
};

/// The publishers a daemon has heard of but does not know yet. Anyone can be one, so they are held to limits, each and all
/// together, by messages and by bytes as received. One thread at a time.
class Strangers {
 public:
  struct Limits {
    std::size_t publishers = 256;
    std::size_t messages = 64;                            ///< of one
    std::size_t bytes = std::size_t{32} << 20;            ///< of one
    std::size_t bytes_together = std::size_t{128} << 20;  ///< of all
  };

  explicit Strangers(const Limits& limits) : limits_(limits) {}

  const Limits& limits() const { return limits_; }
  bool empty() const { return strangers_.empty(); }

  /// The stranger of this name. Null: a new one beyond the limit.
  Stranger* meet(const std::string& id, session::WallClock::Duration now);
  /// Keeps the message, or counts it as left out. \pre the stranger is one of these
  void keep(Stranger& stranger, wire::StreamEnvelope envelope);
  /// Takes the stranger out. \pre it was met
  Stranger take(const std::string& id);
  /// Forgets those that were met before `time`; returns how many messages of theirs are lost with them.
  std::uint64_t forget_before(session::WallClock::Duration time);

 private:
  const Limits limits_;
  std::map<std::string, Stranger> strangers_;
  std::size_t bytes_together_ = 0;
};

}  // namespace rustle::apps
