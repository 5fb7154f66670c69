#pragma once

#include <algorithm>
#include <chrono>

#include "server/session/clock.h"

namespace rustle::session {

/// So much of something a second, as long as it lasts: what is not used adds up to half a second's worth, what is used
/// beyond is owed. Not thread-safe.
class Allowance {
 public:
  static constexpr double kAhead_s = 0.5;

  explicit Allowance(double per_s) : per_s_(per_s), left_(per_s * kAhead_s) {}

  void use(double amount) { left_ -= amount; }

  /// False: nothing is left until what is owed has come back.
  bool left(WallClock::Duration now) {
    const double since_s = std::chrono::duration<double>(now - at_).count();
    at_ = now;
    left_ = std::min(left_ + per_s_ * std::max(0.0, since_s), per_s_ * kAhead_s);
    return left_ > 0;
  }

 private:
  double per_s_, left_;
  WallClock::Duration at_{};
};

}  // namespace rustle::session
