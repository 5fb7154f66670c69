#include "server/session/scheduler.h"

#include <catch2/catch.hpp>

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <map>
#include <string>
#include <thread>

#include "client_sdk/sheets/demos.h"
#include "server/session/offline.h"
#include "server/session/settled_options.h"
#include "tests/support/animated_frames.h"

namespace scheduler_test {

namespace {

using namespace rustle;
using namespace std::chrono_literals;
using session::DueQueue;
using session::TurnQueue;
using Time = std::chrono::nanoseconds;

std::shared_ptr<pack::PackLibrary> packs() {
  static const auto library = std::make_shared<pack::PackLibrary>(std::vector<std::filesystem::path>{RUSTLE_BUILT_PACKS});
  return library;
}

struct Wanting {
  std::string name;
  session::TurnAccount turns;
};

TEST_CASE("Turns share the time, whatever a turn takes") {
  Wanting heavy{"heavy", {}}, light{"light", {}}, middling{"middling", {}};
  std::map<Wanting*, Time> cost{{&heavy, 50ms}, {&light, 100us}, {&middling, 2ms}};
  TurnQueue<Wanting*> queue;
  for (auto& [one, time] : cost) queue.want(one);
  Time now{};
  while (now < 10s) {
    const auto next = queue.take();
    REQUIRE(next);
    now += cost[*next];
    queue.done(*next, cost[*next]);
    queue.want(*next);
  }
  for (const auto& [one, time] : cost) CHECK(one->turns.spent / 1ms == Approx(10000.0 / 3).margin(51));
}

TEST_CASE("Among equals who has waited longest is next") {
  std::array<Wanting, 5> all{};
  TurnQueue<Wanting*> queue;
  for (auto& one : all) queue.want(&one);
  for (int round = 0; round < 3; ++round) {
    for (auto& one : all) {
      CHECK(queue.take() == &one);
      queue.done(&one, 1ms);
      queue.want(&one);
    }
  }
}

/// A heavy session whose backlog never ends beside light ones with a frame every 16 ms, on one clock that workers turn by
/// what their turns cost. The longest that a light one has had to wait.
Time longest_wait(int workers, bool short_thread) {
  Wanting heavy{"heavy", {}};
  std::array<Wanting, 20> light{};
  TurnQueue<Wanting*> queue;
  std::map<Wanting*, Time> asked;
  std::multimap<Time, Wanting*> working;  // by when the turn ends
  Time now{};
  Time most{};
  queue.want(&heavy);
  int busy = 0, short_busy = 0;
  std::map<Wanting*, bool> by_short;
  for (now = 0ms; now < 4s; now += 100us) {
    while (!working.empty() && working.begin()->first <= now) {
      Wanting* one = working.begin()->second;
      working.erase(working.begin());
      (by_short[one] ? short_busy : busy) -= 1;
      queue.done(one, one == &heavy ? Time(40ms) : Time(200us));
      if (one == &heavy) queue.want(one);
    }
    for (std::size_t k = 0; k < light.size(); ++k) {
      if ((now - k * 700us) % 16ms == 0ms && !asked.contains(&light[k])) {
        asked[&light[k]] = now;
        queue.want(&light[k]);
      }
    }
    const auto start = [&](bool short_only) {
      const auto next = queue.take(short_only);
      if (!next) return false;
      (short_only ? short_busy : busy) += 1;
      by_short[*next] = short_only;
      working.emplace(now + (*next == &heavy ? Time(40ms) : Time(200us)), *next);
      if (*next != &heavy) {
        most = std::max(most, now - asked[*next]);
        asked.erase(*next);
      }
      return true;
    };
    while (busy < workers && start(false)) {
    }
    while (short_thread && short_busy < 1 && start(true)) {
    }
  }
  for (auto& one : light) CHECK(one.turns.spent > 4s / 16ms * 200us * 0.8);
  CHECK(heavy.turns.spent > 1s);
  return most;
}

TEST_CASE("A light session never waits for more than the heavy one's turn under way, and for none with a short thread") {
  const Time light_ones = 20 * 300us;
  CHECK(longest_wait(1, false) <= 40ms + light_ones);
  CHECK(longest_wait(1, false) > 30ms);
  CHECK(longest_wait(1, true) <= light_ones);
  CHECK(longest_wait(2, true) <= light_ones);
}

TEST_CASE("Who comes back from doing nothing does not take all the time") {
  Wanting idle{"idle", {}}, busy{"busy", {}};
  TurnQueue<Wanting*> queue;
  queue.want(&busy);
  for (int k = 0; k < 1000; ++k) {
    queue.take();
    queue.done(&busy, 10ms);
    queue.want(&busy);
  }
  queue.want(&idle);
  int turns = 0;
  for (int k = 0; k < 20; ++k) {
    Wanting* next = *queue.take();
    turns += next == &idle ? 1 : 0;
    queue.done(next, 10ms);
    queue.want(next);
  }
  CHECK(turns >= 10);
  CHECK(turns <= 12);
}

TEST_CASE("The earliest deadline is next, and nothing that falls due is lost") {
  DueQueue<int> queue;
  for (int k = 0; k < 4; ++k) queue.add(k);
  std::map<int, Time> due;
  for (int k = 0; k < 4; ++k) {  // all are due at first
    const auto ticket = queue.take(0ms);
    REQUIRE(ticket);
    const int member = queue.member(*ticket);
    due[member] = (10 - member) * 1ms;
    queue.give_back(*ticket, due[member]);
  }
  CHECK(queue.next_due() == Time(7ms));
  CHECK_FALSE(queue.take(6ms));
  auto third = queue.take(20ms);
  REQUIRE(third);
  CHECK(queue.member(*third) == 3);
  queue.call(3);  // while it is worked on
  queue.call(1);
  auto next = queue.take(0ms);
  REQUIRE(next);
  CHECK(queue.member(*next) == 1);
  queue.give_back(*next, std::nullopt);
  queue.give_back(*third, 1s);
  next = queue.take(0ms);
  REQUIRE(next);
  CHECK(queue.member(*next) == 3);
  queue.remove(3);
  queue.give_back(*next, 0ms);
  CHECK(queue.next_due() == Time(8ms));  // 2's; 1 waits for a call
  queue.remove(2);
  queue.call(2);
  next = queue.take(100ms);
  REQUIRE(next);
  CHECK(queue.member(*next) == 0);
  queue.give_back(*next, std::nullopt);
  CHECK_FALSE(queue.next_due());
}

TEST_CASE("Any use of a due queue agrees with looking through all of it") {
  std::uint64_t noise = 3;
  const auto below = [&](int bound) {
    noise = noise * 6364136223846793005ULL + 1442695040888963407ULL;
    return static_cast<int>((noise >> 33) % static_cast<std::uint64_t>(bound));
  };
  DueQueue<int> queue;
  std::map<int, std::optional<Time>> expected;
  for (int step = 0; step < 20000; ++step) {
    const int member = below(30);
    if (!expected.contains(member)) {
      queue.add(member);
      expected[member] = Time::min();
    } else if (below(20) == 0) {
      queue.remove(member);
      expected.erase(member);
    } else if (below(4) == 0) {
      queue.call(member);
      expected[member] = Time::min();
    } else if (const auto ticket = queue.take(below(1000) * 1us)) {
      const auto earliest = std::min_element(expected.begin(), expected.end(), [](const auto& a, const auto& b) {
        return a.second.value_or(Time::max()) < b.second.value_or(Time::max());
      });
      REQUIRE(expected[queue.member(*ticket)] == earliest->second);
      const auto due = below(5) == 0 ? std::nullopt : std::optional<Time>(below(1000) * 1us);
      expected[queue.member(*ticket)] = due;
      queue.give_back(*ticket, due);
    }
  }
}

TEST_CASE("Lists of processors") {
  CHECK(session::parse_cpus("0") == std::vector<int>{0});
  CHECK(session::parse_cpus("2-4,0,3") == std::vector<int>{0, 2, 3, 4});
  for (const char* wrong : {"", "a", "1-", "-1", "3-2", "1,,2", "99999", "1 2"}) {
    CAPTURE(wrong);
    CHECK_FALSE(session::parse_cpus(wrong));
  }
  CHECK(session::usable_cpus() >= 1);
}

TEST_CASE("Sessions on several analysis and render workers keep their order, and their samples are the offline render's") {
  constexpr int kSessions = 6;
  const std::array<const char*, 3> motions{"snap", "shake", "slide"};
  std::vector<std::vector<engine::StreamItem>> items(kSessions);
  std::vector<std::vector<float>> offline(kSessions);
  std::vector<session::SessionOptions> options(kSessions);
  for (int k = 0; k < kSessions; ++k) {
    const auto n = static_cast<std::size_t>(k);
    const auto sheet = sheets::make_demo(motions[n % 3], k == 0 ? 1333 : 183);
    const test_support::AnimatedFrames frames(*sheet);
    items[n].emplace_back(engine::SheetDescription{1, "sheet", engine::SheetKind::kPaper, "", "", {}, {}});
    for (int frame = 0; frame < 30; ++frame) items[n].emplace_back(frames.at(0.3 + frame / 60.0));
    items[n].emplace_back(engine::End{});
    options[n].clock = session::Clock::kSimulation;
    options[n].seed = n;
    options[n] = session::settled(options[n]);
    std::size_t next = 0;
    session::OfflineEnds ends;
    ends.next = [&]() -> std::optional<engine::StreamItem> { return items[n][next++]; };
    ends.audio = [&](const engine::AudioQuantum& quantum) {
      offline[n].insert(offline[n].end(), quantum.mix.begin(), quantum.mix.end());
      return true;
    };
    session::render_offline(session::engine_options(options[n]), packs(), 1, ends);
  }

  const session::SteadyClock clock;
  std::atomic<std::uint64_t> said{0};
  session::Scheduler scheduler({4, 3, {}, {}}, clock, [&] { ++said; });
  std::vector<std::shared_ptr<session::Session>> held;
  for (int k = 0; k < kSessions; ++k) {
    const auto n = static_cast<std::size_t>(k);
    held.push_back(std::make_shared<session::Session>(fmt::format("s{}", k), options[n], packs(), clock));
    scheduler.add(held.back());
  }
  std::vector<std::vector<float>> threaded(kSessions);
  std::vector<std::uint64_t> analysed(kSessions);
  bool in_order = true;
  std::size_t offered = 0;
  const std::size_t most = items[0].size();
  const auto deadline = std::chrono::steady_clock::now() + 120s;
  for (bool all = false; !all && std::chrono::steady_clock::now() < deadline;) {
    if (offered < most) {
      for (std::size_t n = 0; n < kSessions; ++n) {
        REQUIRE(held[n]->offer(items[n][offered], offered + 1) == session::Offer::kTaken);
        scheduler.wake_analysis(held[n]);
      }
      ++offered;
    }
    all = true;
    for (std::size_t n = 0; n < kSessions; ++n) {
      session::AudioBlock block;
      while (held[n]->take_audio(100, block))
        threaded[n].insert(threaded[n].end(), block.interleaved.begin(), block.interleaved.end());
      for (const auto& outcome : held[n]->take_outcomes()) {
        if (const auto* done = std::get_if<session::Analysed>(&outcome))
          in_order &= done->sequence == std::exchange(analysed[n], done->sequence) + 1;
      }
      all &= held[n]->finished();
    }
    std::this_thread::sleep_for(100us);
  }
  for (std::size_t n = 0; n < kSessions; ++n) {
    CAPTURE(n);
    CHECK(held[n]->finished());
    CHECK(threaded[n] == offline[n]);
    CHECK(analysed[n] == most);
  }
  CHECK(in_order);
  CHECK(said > 0);
  // They take what time there is, which is no load.
  CHECK(scheduler.busy().analysis == session::WallClock::Duration::zero());
  CHECK(scheduler.busy().render == session::WallClock::Duration::zero());

  // Nobody but the test holds a session that was removed, once the next comes and goes.
  for (auto& one : held) scheduler.remove(one);
  auto last = std::make_shared<session::Session>("last", options[1], packs(), clock);
  const auto released = [&] {
    scheduler.add(last);
    scheduler.remove(last);
    return std::all_of(held.begin(), held.end(), [](const auto& one) { return one.use_count() == 1; });
  };
  for (int tries = 0; tries < 2000 && !released(); ++tries) std::this_thread::sleep_for(1ms);
  CHECK(released());
}

}  // namespace

}  // namespace scheduler_test
