#include <catch2/catch.hpp>
#include <cstdlib>
#include <cstring>
#include <string>
#include <vector>

#include <fmt/format.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include "server/monitor/service_manager.h"

namespace service_manager_test {

namespace {

using namespace std::chrono_literals;
using rustle::monitor::ServiceManager;

/// What a service manager hears.
class Manager {
 public:
  explicit Manager(bool abstract)
      : name_(fmt::format("{}rustle-notify-{}", abstract ? "@" : "/tmp/", ::getpid())),
        socket_(::socket(AF_UNIX, SOCK_DGRAM | SOCK_NONBLOCK, 0)) {
    sockaddr_un address{};
    address.sun_family = AF_UNIX;
    std::memcpy(address.sun_path, name_.data(), name_.size());
    if (abstract) address.sun_path[0] = '\0';
    const auto size = static_cast<socklen_t>(offsetof(sockaddr_un, sun_path) + name_.size());
    REQUIRE(::bind(socket_, reinterpret_cast<const sockaddr*>(&address), size) == 0);
  }
  ~Manager() {
    ::close(socket_);
    ::unlink(name_.c_str());
  }
  const std::string& name() const { return name_; }
  std::vector<std::string> heard() const {
    std::vector<std::string> all;
    char text[512];
    for (ssize_t size = 0; (size = ::recv(socket_, text, sizeof(text), 0)) > 0;)
      all.emplace_back(text, static_cast<std::size_t>(size));
    return all;
  }

 private:
  std::string name_;
  int socket_;
};

TEST_CASE("A service manager is told that the daemon serves, lives and ends") {
  const Manager manager(GENERATE(true, false));
  ServiceManager told(manager.name(), 30s);
  told.serves("2 packs");
  CHECK(manager.heard() == std::vector<std::string>{"READY=1\nSTATUS=2 packs"});
  const auto start = ServiceManager::Clock::time_point(1h);
  bool well = true;
  for (int second = 0; second < 60; ++second) told.beat(start + second * 1s, [&] { return well; });
  CHECK(manager.heard() == std::vector<std::string>(4, "WATCHDOG=1"));
  well = false;
  for (int second = 60; second < 120; ++second) told.beat(start + second * 1s, [&] { return well; });
  CHECK(manager.heard().empty());
  told.ends();
  CHECK(manager.heard() == std::vector<std::string>{"STOPPING=1"});
}

TEST_CASE("Without a service manager, or with one that is gone, nothing happens") {
  for (const std::string& name : std::vector<std::string>{"", "/tmp/rustle-nobody-listens", "@", std::string(500, 'x')}) {
    ServiceManager told(name, 1s);
    told.serves("");
    told.beat(ServiceManager::Clock::now(), [] { return true; });
    told.ends();
  }
}

TEST_CASE("The environment says who the manager is, and whether this process is meant") {
  const Manager manager(true);
  ::setenv("NOTIFY_SOCKET", manager.name().c_str(), 1);
  ::setenv("WATCHDOG_USEC", "1000000", 1);
  const auto beats = [&](const std::string& process) {
    ::setenv("WATCHDOG_PID", process.c_str(), 1);
    ServiceManager::from_environment().beat(ServiceManager::Clock::now(), [] { return true; });
    return manager.heard().size();
  };
  CHECK(beats(std::to_string(::getpid())) == 1);
  CHECK(beats("1") == 0);
  ::setenv("WATCHDOG_USEC", "soon", 1);
  CHECK(beats(std::to_string(::getpid())) == 0);
  for (const char* name : {"NOTIFY_SOCKET", "WATCHDOG_USEC", "WATCHDOG_PID"}) ::unsetenv(name);
  ServiceManager::from_environment().serves("");
  CHECK(manager.heard().empty());
}

}  // namespace

}  // namespace service_manager_test
