#pragma once

#include <cstdint>
#include <optional>

#include "server/session/clock.h"

namespace rustle::session {

/// How the daemon fared since the last look.
struct LoadSigns {
  double busy = 0;       ///< share of their time for which the busiest kind of workers worked for live sessions
  bool suffers = false;  ///< a session that keeps to its budget lost frames for want of time, or was rendered late
};

/// Which load level (engine/economy.h) is in force. Up, a level at a time, when workers are busy or a session suffers in two
/// looks in a row, and half a second later again if that did not help; down when all has been well for so long. Between
/// busy and at leisure nothing changes. From the highest level to full quality takes less than 10 s.
class LoadLadder {
 public:
  static constexpr WallClock::Duration kLook = std::chrono::milliseconds(250);
  static constexpr WallClock::Duration kWell = std::chrono::milliseconds(1750);
  static constexpr double kBusy = 0.9, kLeisure = 0.7;

  /// To be called every kLook. The level that is in force now, where it changes.
  std::optional<std::uint32_t> look(WallClock::Duration now, const LoadSigns& signs);
  std::uint32_t level() const { return level_; }

 private:
  std::uint32_t level_ = 0;
  int bad_looks_ = 0;
  std::optional<WallClock::Duration> well_since_;
};

}  // namespace rustle::session
