#include "server/monitor/service_manager.h"

#include <charconv>
#include <cstdlib>
#include <cstring>
#include <utility>

#include <fmt/format.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

namespace rustle::monitor {
namespace {

std::string variable(const char* name) {
  const char* value = std::getenv(name);
  return value != nullptr ? value : "";
}

std::optional<std::int64_t> number(const std::string& text) {
  std::int64_t value = 0;
  const auto [end, failed] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (failed != std::errc() || end != text.data() + text.size() || text.empty()) return std::nullopt;
  return value;
}

}  // namespace

ServiceManager::ServiceManager(std::string socket, std::optional<std::chrono::microseconds> watchdog)
    : socket_(std::move(socket)), watchdog_(watchdog) {}

ServiceManager ServiceManager::from_environment() {
  const auto interval = number(variable("WATCHDOG_USEC"));
  const auto meant = number(variable("WATCHDOG_PID"));
  const bool watched = interval && *interval > 0 && (!meant || *meant == ::getpid());
  return {variable("NOTIFY_SOCKET"), watched ? std::optional(std::chrono::microseconds(*interval)) : std::nullopt};
}

void ServiceManager::serves(std::string_view status) const {
  tell(fmt::format("READY=1\nSTATUS={}", status));
}

void ServiceManager::ends() const {
  tell("STOPPING=1");
}

void ServiceManager::beat(Clock::time_point now, const std::function<bool()>& well) {
  if (socket_.empty() || !watchdog_ || (asked_ && now - *asked_ < *watchdog_ / 2)) return;
  asked_ = now;
  if (well()) tell("WATCHDOG=1");
}

void ServiceManager::tell(std::string_view lines) const {
  sockaddr_un address{};
  if (socket_.empty() || socket_.size() >= sizeof(address.sun_path)) return;
  address.sun_family = AF_UNIX;
  std::memcpy(address.sun_path, socket_.data(), socket_.size());
  if (socket_[0] == '@') address.sun_path[0] = '\0';
  const int sender = ::socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  if (sender < 0) return;
  const auto size = static_cast<socklen_t>(offsetof(sockaddr_un, sun_path) + socket_.size());
  // A manager that does not listen is no reason to be silent towards sessions.
  static_cast<void>(::sendto(sender, lines.data(), lines.size(), MSG_NOSIGNAL | MSG_DONTWAIT,
                             static_cast<const sockaddr*>(static_cast<const void*>(&address)), size));
  ::close(sender);
}

}  // namespace rustle::monitor
