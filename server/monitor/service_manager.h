#pragma once

#include <chrono>
#include <functional>
#include <optional>
#include <string>
#include <string_view>

namespace rustle::monitor {

/// The service manager that started the daemon, such as systemd, where there is one; it is told in the way of sd_notify(3):
/// that the daemon serves, signs of life while it is well, and that it ends. Without one nothing happens. [network thread]
class ServiceManager {
 public:
  using Clock = std::chrono::steady_clock;

  /// `socket`: a path, or with a leading @ an abstract name; empty: there is none. `watchdog`: it restarts the daemon when
  /// no sign of life comes for so long.
  ServiceManager(std::string socket, std::optional<std::chrono::microseconds> watchdog);
  /// As NOTIFY_SOCKET, WATCHDOG_USEC and WATCHDOG_PID say.
  static ServiceManager from_environment();

  void serves(std::string_view status) const;
  void ends() const;
  /// Twice in the watchdog's time asks whether the daemon is well, and if so says that it lives. To be called often.
  void beat(Clock::time_point now, const std::function<bool()>& well);

 private:
  void tell(std::string_view lines) const;

  std::string socket_;
  std::optional<std::chrono::microseconds> watchdog_;
  std::optional<Clock::time_point> asked_;
};

}  // namespace rustle::monitor
