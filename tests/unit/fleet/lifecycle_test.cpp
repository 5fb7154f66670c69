#include <algorithm>
#include <catch2/catch.hpp>
#include <string>
#include <utility>
#include <vector>

#include "server/fleet/lifecycle.h"

namespace lifecycle_test {

namespace {

using namespace rustle::fleet;
using namespace std::chrono_literals;

constexpr Instant kStart{1h};

GameServer server_of(std::string state) {
  return {"rustle-x7", std::move(state), "203.0.113.4", {{"control", 7101}}};
}

/// A sidecar that does as it is told, and time that passes as the test likes.
struct World {
  Lifecycle lifecycle;
  DaemonState daemon{.serving = true, .sessions = 0, .capacity = 150, .well_at = kStart};
  Instant now = kStart;
  std::string state = "Scheduled";
  bool there = true;
  std::vector<std::string> asked;

  /// All that is due until `end` is asked and answered. Keeps the daemon well as long as `well`.
  void until(Instant end, bool well = true) {
    for (int rounds = 0; rounds < 10'000; ++rounds) {
      if (well) daemon.well_at = now;
      const auto step = lifecycle.next(daemon, now);
      if (!step.ask) {
        REQUIRE(step.again_at > now);
        // The daemon says that it is well twice a second.
        now = std::min(end, well ? std::min(step.again_at, now + 500ms) : step.again_at);
        if (now >= end) return;
        continue;
      }
      asked.emplace_back(name_of(*step.ask));
      if (!there) {
        lifecycle.unreachable(now);
      } else if (*step.ask == Ask::kGameServer) {
        lifecycle.read(server_of(state), now);
      } else {
        if (*step.ask == Ask::kReady) state = "Ready";
        if (*step.ask == Ask::kAllocate) state = "Allocated";
        lifecycle.done(*step.ask, daemon, now);
      }
    }
    FAIL("it asks without end");
  }
  std::vector<std::string> take() { return std::exchange(asked, {}); }
  std::size_t count(const std::string& what) const {
    return static_cast<std::size_t>(std::count(asked.begin(), asked.end(), what));
  }
};

using Asked = std::vector<std::string>;

}  // namespace

TEST_CASE("Nothing is said before the daemon serves") {
  World world;
  world.daemon.serving = false;
  world.until(kStart + 1min);
  CHECK(world.asked.empty());
}

TEST_CASE("A daemon that serves looks at its game server, counts, and is ready once") {
  World world;
  world.until(kStart + 1s);
  CHECK(world.take() == Asked{"health", "gameserver", "counter", "ready"});
  world.until(kStart + 1min);
  CHECK(world.count("ready") == 0);
  CHECK(world.count("allocate") == 0);
  CHECK(world.count("health") == 29);
  CHECK(world.count("counter") == 5);
}

TEST_CASE("Health is told every two seconds while the daemon is well, and not when it hangs") {
  World world;
  world.until(kStart + 20s);
  CHECK(world.count("health") == 10);
  world.take();
  world.until(kStart + 60s, false);
  CHECK(world.count("health") <= 2);  // it was well a moment ago
  world.take();
  world.until(kStart + 70s);
  CHECK(world.count("health") == 5);
}

TEST_CASE("The counter follows every change, and is told again now and then") {
  World world;
  world.until(kStart + 1s);
  world.take();
  for (const std::size_t sessions : {1, 2, 1}) {
    world.daemon.sessions = sessions;
    world.until(world.now + 100ms);
    CHECK(world.count("counter") == 1);
    world.take();
  }
  world.daemon.capacity = 10;
  world.until(world.now + 100ms);
  CHECK(world.take() == Asked{"counter"});
  world.until(world.now + 25s);
  CHECK(world.count("counter") == 2);
}

TEST_CASE("A change that comes while the counter is told is told too") {
  World world;
  world.until(kStart + 1s);
  world.daemon.sessions = 1;
  CHECK(world.lifecycle.next(world.daemon, world.now).ask == Ask::kCounter);
  const DaemonState told = world.daemon;
  world.daemon.sessions = 2;
  world.lifecycle.done(Ask::kCounter, told, world.now);
  CHECK(world.lifecycle.next(world.daemon, world.now).ask == Ask::kCounter);
}

TEST_CASE("It is allocated as long as it has sessions, and ready again when they have been gone for a while") {
  World world;
  world.until(kStart + 1s);
  world.daemon.sessions = 1;
  world.until(world.now + 1s);
  CHECK(world.state == "Allocated");
  world.daemon.sessions = 0;
  world.until(world.now + 9s);
  CHECK(world.state == "Allocated");
  world.until(world.now + 2s);
  CHECK(world.state == "Ready");
  world.take();
  world.until(world.now + 1min);
  CHECK(world.count("ready") == 0);
}

TEST_CASE("Allocated from outside, and nobody comes: it is ready again") {
  World world;
  world.until(kStart + 1s);
  world.state = "Allocated";
  world.until(kStart + 15s);
  CHECK(world.state == "Allocated");
  world.until(kStart + 25s);
  CHECK(world.state == "Ready");
}

TEST_CASE("A sidecar that is away is looked for with growing pauses") {
  World world;
  world.there = false;
  world.until(kStart + 60s);
  // 0.1, 0.2, 0.4, 0.8, 1.6, 3.2 s, then every 5 s
  CHECK(world.asked.size() == 17);
  CHECK_FALSE(world.lifecycle.reachable());
  world.there = true;
  world.take();
  world.until(world.now + 6s);
  CHECK(world.count("ready") == 1);
  CHECK(world.count("counter") == 1);
  CHECK(world.lifecycle.reachable());
}

TEST_CASE("A sidecar that comes back hears the true count, and of readiness only where it forgot") {
  const std::string state = GENERATE("Ready", "Allocated", "Scheduled");
  World world;
  world.until(kStart + 1s);
  world.daemon.sessions = 3;
  world.until(kStart + 2s);
  world.there = false;
  world.until(kStart + 10s);
  world.there = true;
  world.state = state;
  world.take();
  world.until(world.now + 6s);
  CHECK(world.count("counter") == 1);
  CHECK(world.count("ready") == (state == "Scheduled" ? 1 : 0));
  CHECK(world.count("allocate") == (state == "Allocated" ? 0 : 1));
}

TEST_CASE("What is refused is asked again later, and keeps nothing else waiting") {
  World world;
  world.until(kStart + 1s);
  world.daemon.sessions = 1;
  const auto step = world.lifecycle.next(world.daemon, world.now);
  REQUIRE(step.ask == Ask::kCounter);
  world.lifecycle.refused(Ask::kCounter, world.now);
  CHECK(world.lifecycle.next(world.daemon, world.now).ask == Ask::kAllocate);
  world.take();
  world.until(world.now + 1500ms);
  CHECK(world.count("counter") == 0);
  CHECK(world.count("health") == 1);
  world.until(world.now + 1s);
  CHECK(world.count("counter") == 1);
}

TEST_CASE("Where the game server cannot be read it is ready all the same") {
  World world;
  REQUIRE(world.lifecycle.next(world.daemon, world.now).ask == Ask::kHealth);
  world.lifecycle.done(Ask::kHealth, world.daemon, world.now);
  REQUIRE(world.lifecycle.next(world.daemon, world.now).ask == Ask::kGameServer);
  world.lifecycle.refused(Ask::kGameServer, world.now);
  world.until(world.now + 1s);
  CHECK(world.take() == Asked{"counter", "ready"});
}

TEST_CASE("Ports that are not there yet are looked for every second") {
  World world;
  world.until(kStart + 1s);
  world.take();
  world.now += 10s;
  REQUIRE(world.lifecycle.next(world.daemon, world.now).ask == Ask::kGameServer);
  world.lifecycle.read({"rustle-x7", "Ready", "", {}}, world.now);
  world.daemon.well_at = std::nullopt;
  world.lifecycle.done(Ask::kCounter, world.daemon, world.now);
  const auto step = world.lifecycle.next(world.daemon, world.now);
  CHECK_FALSE(step.ask);
  CHECK(step.again_at == world.now + 1s);
  CHECK(world.lifecycle.next(world.daemon, step.again_at).ask == Ask::kGameServer);
}

TEST_CASE("A daemon that ends says so once all has ended, whatever pause is on, and nothing after") {
  World world;
  world.until(kStart + 1s);
  world.daemon.sessions = 2;
  world.until(kStart + 2s);
  world.take();
  world.daemon.ending = true;
  world.daemon.sessions = 0;
  world.until(kStart + 40s);
  CHECK(world.count("ready") == 0);
  CHECK(world.count("shutdown") == 0);
  world.lifecycle.unreachable(world.now);
  world.daemon.ended = true;
  CHECK(world.lifecycle.next(world.daemon, world.now).ask == Ask::kShutdown);
  world.lifecycle.refused(Ask::kShutdown, world.now);
  CHECK_FALSE(world.lifecycle.shut_down());
  world.take();
  world.until(world.now + 1min);
  CHECK(world.take() == Asked{"shutdown"});
  CHECK(world.lifecycle.shut_down());
}

TEST_CASE("What Agones has given up stays as it is") {
  const std::string state = GENERATE("Shutdown", "Unhealthy", "Error");
  World world;
  world.until(kStart + 1s);
  world.state = state;
  world.daemon.sessions = 1;
  world.until(kStart + 2s);
  world.state = state;
  world.until(kStart + 12s);
  world.take();
  world.until(kStart + 1min);
  CHECK(world.count("allocate") == 0);
  CHECK(world.count("ready") == 0);
}

}  // namespace lifecycle_test
