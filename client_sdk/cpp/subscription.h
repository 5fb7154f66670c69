#pragma once

#include <deque>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include <tl/expected.hpp>

#include "client_sdk/cpp/transport.h"
#include "client_sdk/cpp/types.h"

namespace rustle::client::internal {

/// One topic of the out socket, also at a daemon that comes back. Not for applications. One thread at a time, is_heard()
/// any.
class Subscription {
 public:
  struct Options {
    int queue = 0;           ///< messages that wait here; 0: no limit
    bool reconnect = false;  ///< a daemon that has gone is waited for
  };

  /// Returns when the daemon has the subscription: what is published from then on is not missed.
  /// Errors: "timeout", "unreachable", "permission_denied".
  [[nodiscard]] static tl::expected<std::shared_ptr<Subscription>, Error> open(std::shared_ptr<Link> link,
                                                                               const std::string& topic,
                                                                               const Options& options);

  Subscription(std::shared_ptr<Link> link, std::unique_ptr<ConnectionMonitor> monitor, Socket socket, std::string endpoint,
               bool reconnect);

  /// The next message's body; empty when none came by then, or the daemon has gone and is not waited for.
  std::optional<std::string> next(Clock::time_point deadline);
  /// Error: "unreachable", where the daemon has gone and is not waited for.
  tl::expected<void, Error> check() const;
  /// Whether what the daemon publishes arrives here.
  bool is_heard();

 private:
  /// To where a daemon that came back publishes.
  void follow();

  const std::shared_ptr<Link> link_;
  const std::unique_ptr<ConnectionMonitor> monitor_;
  std::mutex mutex_;
  Socket socket_;
  std::string endpoint_;
  const bool reconnect_;
  std::deque<std::vector<std::string>> early_{};
};

}  // namespace rustle::client::internal
