#pragma once

#include <array>
#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <functional>
#include <mutex>
#include <optional>
#include <string>
#include <thread>

#include "server/fleet/lifecycle.h"
#include "server/monitor/figures.h"
#include "server/monitor/http_address.h"

namespace rustle::fleet {

/// The sidecar that Agones puts beside the daemon, spoken to by its REST interface on a thread of its own: the daemon never
/// waits for it, whether it answers, hangs, or is not there.
///
///   network thread ── tell(), beat() ─► state ─► sidecar thread ── HTTP ─► sidecar
///                  ◄── news() ─────────────────┘
class Sidecar {
 public:
  static constexpr std::chrono::milliseconds kAnswerWithin{1000};
  static constexpr std::chrono::milliseconds kShutdownWithin{1000};
  static constexpr std::chrono::milliseconds kNewsTakenWithin{1000};
  static constexpr std::chrono::milliseconds kLookEvery{500};  ///< whether the daemon is well

  explicit Sidecar(monitor::HttpAddress address);
  /// Without a word to the sidecar.
  ~Sidecar();
  Sidecar(const Sidecar&) = delete;
  Sidecar& operator=(const Sidecar&) = delete;

  // ---- [network thread]; none of these waits for the sidecar

  /// How many sessions there are and may be, and whether the daemon ends. The sidecar hears nothing before the first call.
  /// To be called often.
  void tell(std::size_t sessions, std::size_t capacity, bool ending);
  /// Asks now and then whether the daemon is well; the sidecar hears of its health as long as it is. To be called often.
  void beat(Instant now, const std::function<bool()>& well);
  /// What Agones says of the daemon, where that is new since the last call. To be called often.
  std::optional<GameServer> news();

  /// The daemon has ended. Tells the sidecar, kShutdownWithin at most. [network thread]
  void end();

  [[nodiscard]] monitor::FleetFigures figures() const;

 private:
  void run();
  /// Asks, and has `lifecycle` know the answer.
  void ask(Lifecycle& lifecycle, Ask what, const DaemonState& state);
  void note(Ask what, const char* outcome, const Lifecycle& lifecycle);

  const monitor::HttpAddress address_;
  mutable std::mutex mutex_;
  std::condition_variable changed_;
  DaemonState state_;
  GameServer server_;
  bool has_news_ = false, leave_ = false, shut_down_ = false;
  monitor::FleetFigures figures_;
  std::optional<Instant> looked_at_;  ///< network thread's
  bool told_away_ = false;            ///< sidecar thread's, as what follows
  std::array<bool, kAsks> told_refusal_{};
  std::thread thread_;
};

}  // namespace rustle::fleet
