#pragma once

#include <chrono>

namespace rustle::session {

/// Time as sessions see it; injected, so that hours can be tested in seconds.
class WallClock {
 public:
  using Duration = std::chrono::nanoseconds;
  virtual ~WallClock() = default;
  /// Monotonic, any origin. Thread-safe.
  virtual Duration now() const = 0;
};

class SteadyClock final : public WallClock {
 public:
  Duration now() const override { return std::chrono::steady_clock::now().time_since_epoch(); }
};

}  // namespace rustle::session
