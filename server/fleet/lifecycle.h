#pragma once

#include <array>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>

#include "server/fleet/game_server.h"

namespace rustle::fleet {

using Clock = std::chrono::steady_clock;
using Instant = Clock::time_point;

/// What the daemon says of itself.
struct DaemonState {
  bool serving = false;  ///< its sockets are bound
  std::size_t sessions = 0;
  std::size_t capacity = 0;        ///< sessions that there may be
  std::optional<Instant> well_at;  ///< when it was well last; absent: not yet
  bool ending = false;             ///< it takes no more sessions
  bool ended = false;              ///< and all of them have ended
};

/// What the sidecar may be asked for.
enum class Ask : std::uint8_t { kGameServer, kCounter, kReady, kAllocate, kHealth, kShutdown };
inline constexpr std::size_t kAsks = 6;
/// "gameserver", "counter", "ready", "allocate", "health", "shutdown".
const char* name_of(Ask ask);

/// Decides what the sidecar is to be asked next, and when. Knows no socket and no clock.
///
///   /gameserver ─► counter ─► /ready ─┬─► /allocate with the first session ─► /ready when the last has been gone for 10 s
///                                     ├─► /health every 2 s, as long as the daemon was well within the last 3 s
///                                     ├─► counter at every change, and every 10 s
///                                     └─► /shutdown once the daemon has ended
///
/// The counter is set to what is true, never counted up or down: what was lost on the way is mended by the next. What an
/// allocation added for a session that is still to come holds until then.
/// A sidecar that is away is looked for after 0.1 s, then after twice as long each time, up to 5 s. One that comes back may
/// be another: it is told all anew, except that the daemon is ready where it still knows that.
class Lifecycle {
 public:
  static constexpr std::chrono::milliseconds kHealthEvery{2000};
  static constexpr std::chrono::milliseconds kWellFor{3000};
  static constexpr std::chrono::milliseconds kTellAgain{10'000};   ///< the counter; and the state is read again
  static constexpr std::chrono::milliseconds kEmptyFor{10'000};    ///< allocated and without a session
  static constexpr std::chrono::milliseconds kPortsAwaited{1000};  ///< until /gameserver is read again for them
  static constexpr std::chrono::milliseconds kAfterRefusal{2000};  ///< until the same is asked again
  static constexpr std::chrono::milliseconds kFirstPause{100};
  static constexpr std::chrono::milliseconds kLongestPause{5000};

  /// What to ask now; absent: nothing before `again_at`, unless the daemon's state changes.
  struct Step {
    std::optional<Ask> ask;
    Instant again_at;
  };
  Step next(const DaemonState& daemon, Instant now);

  /// It was done; `told` is the state that the question was made of.
  void done(Ask ask, const DaemonState& told, Instant now);
  /// The answer to kGameServer.
  void read(GameServer server, Instant now);
  /// The sidecar is there, and says no.
  void refused(Ask ask, Instant now);
  /// Nobody answers, or not in time.
  void unreachable(Instant now);

  bool reachable() const { return reachable_; }
  /// As read last.
  const GameServer& server() const { return server_; }
  bool shut_down() const { return shut_down_; }

 private:
  struct Counted {
    std::size_t sessions, capacity;
    bool operator==(const Counted&) const = default;
  };

  /// When this is due; absent: it is not wanted.
  std::optional<Instant> due(Ask ask, const DaemonState& daemon, Instant now) const;
  std::optional<Ask> wanted_state(const DaemonState& daemon, Instant now) const;

  bool reachable_ = false;
  std::chrono::milliseconds pause_{};
  Instant retry_at_{};
  std::array<Instant, kAsks> not_before_{};  ///< of what was refused
  GameServer server_;
  bool looked_ = false;  ///< for the game server, since the sidecar came
  Instant look_at_{}, health_at_{}, count_at_{};
  std::optional<Counted> counted_;
  bool ready_told_ = false, shut_down_ = false;
  std::optional<Instant> empty_since_;
};

}  // namespace rustle::fleet
