#include <catch2/catch.hpp>
#include <vector>

#include "server/engine/economy.h"
#include "server/session/allowance.h"
#include "server/session/load_ladder.h"

namespace load_ladder_test {

namespace {

using namespace rustle;
using session::LoadLadder;
using session::LoadSigns;
using std::chrono::milliseconds;

/// A ladder that is looked at as often as it wants to be.
struct Watched {
  LoadLadder ladder;
  session::WallClock::Duration now{};
  std::vector<std::uint32_t> levels;

  void go(double seconds, const LoadSigns& signs) {
    for (const auto end =
             now + std::chrono::duration_cast<session::WallClock::Duration>(std::chrono::duration<double>(seconds));
         now < end;) {
      now += LoadLadder::kLook;
      if (const auto level = ladder.look(now, signs)) levels.push_back(*level);
    }
  }
};

TEST_CASE("Overload climbs level by level to the last, leisure comes down to full quality within 10 s") {
  const LoadSigns bad = GENERATE(LoadSigns{0.95, false}, LoadSigns{0.3, true});
  Watched watched;
  watched.go(5, bad);
  CHECK(watched.levels == std::vector<std::uint32_t>{1, 2, 3, 4});
  CHECK(watched.ladder.level() == engine::kMostLoadLevel);
  watched.levels.clear();
  watched.go(9.5, {0.3, false});
  CHECK(watched.levels == std::vector<std::uint32_t>{3, 2, 1, 0});
}

TEST_CASE("A single stall changes nothing, and between busy and leisure a level stays") {
  Watched watched;
  for (int k = 0; k < 20; ++k) {
    watched.go(0.25, {0.2, true});
    watched.go(0.25, {0.2, false});
  }
  CHECK(watched.levels.empty());
  watched.go(0.5, {0.95, false});
  REQUIRE(watched.ladder.level() == 1);
  watched.go(60, {0.8, false});
  CHECK(watched.ladder.level() == 1);
  watched.go(1.5, {0.5, false});
  watched.go(0.25, {0.8, false});  // not well for long enough
  watched.go(1.5, {0.5, false});
  CHECK(watched.ladder.level() == 1);
}

TEST_CASE("A daemon at leisure stays at full quality") {
  Watched watched;
  watched.go(60, {0.85, false});
  watched.go(60, {0.1, false});
  CHECK(watched.levels.empty());
}

TEST_CASE("Every level does without what those before it do") {
  for (std::uint32_t level = 1; level <= engine::kMostLoadLevel; ++level) {
    const auto before = engine::economy_at(level - 1), here = engine::economy_at(level);
    CHECK(here.joined_slots >= before.joined_slots);
    CHECK(here.most_voices <= before.most_voices);
    CHECK(here.effort.most_events <= before.effort.most_events);
    CHECK(here.effort.partition_serves_s >= before.effort.partition_serves_s);
    CHECK(here.effort.most_events > 0);
    CHECK(here.most_voices > 0);
    CHECK_FALSE(engine::meaning_of(level).empty());
  }
}

TEST_CASE("An allowance gives its rate over time, half a second's worth at once, and what is owed comes back first") {
  session::Allowance allowance(10);
  session::WallClock::Duration now = milliseconds(5);
  double used = 0;
  for (; now < std::chrono::seconds(20); now += milliseconds(5)) {
    if (!allowance.left(now)) continue;
    allowance.use(0.3);
    used += 0.3;
  }
  CHECK(used == Approx(10 * 20 + 5).margin(0.5));
  allowance.use(10);
  CHECK_FALSE(allowance.left(now + milliseconds(900)));
  CHECK(allowance.left(now + milliseconds(1100)));
  // A long rest gives no more than half a second's worth.
  CHECK(allowance.left(now + std::chrono::hours(1)));
  allowance.use(5.1);
  CHECK_FALSE(allowance.left(now + std::chrono::hours(1)));
}

}  // namespace

}  // namespace load_ladder_test
