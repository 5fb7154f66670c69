#include <catch2/catch.hpp>

#include <algorithm>
#include <array>
#include <atomic>
#include <numeric>
#include <thread>

#include "client_sdk/sheets/demos.h"
#include "server/session/clock_drift.h"
#include "server/session/offline.h"
#include "server/session/scheduler.h"
#include "server/session/settled_options.h"
#include "server/session/spsc_ring.h"
#include "tests/support/animated_frames.h"

namespace session_test {

namespace {

using namespace rustle;

/// A clock that a test turns by hand.
class HandClock final : public session::WallClock {
 public:
  Duration now() const override { return Duration(ns_.load()); }
  void advance(double seconds) { ns_ += static_cast<std::int64_t>(seconds * 1e9); }

 private:
  std::atomic<std::int64_t> ns_{1};
};

std::shared_ptr<pack::PackLibrary> packs() {
  static const auto library = std::make_shared<pack::PackLibrary>(std::vector<std::filesystem::path>{RUSTLE_BUILT_PACKS});
  return library;
}

engine::SheetDescription described() {
  return {1, "sheet", engine::SheetKind::kPaper, "", "", {}, {}};
}

constexpr auto kTaken = session::Offer::kTaken;

std::uint64_t dropped(const session::Counters& counters) {
  return std::accumulate(counters.frames_dropped.begin(), counters.frames_dropped.end(), std::uint64_t{0},
                         [](std::uint64_t sum, const auto& entry) { return sum + entry.second; });
}

std::vector<float> drain(session::Session& s) {
  std::vector<float> all;
  session::AudioBlock block;
  while (s.take_audio(128, block)) all.insert(all.end(), block.interleaved.begin(), block.interleaved.end());
  return all;
}

TEST_CASE("What goes into a ring comes out, in order, between two threads") {
  session::SpscRing<int> ring(7);
  session::SampleRing samples(101);
  constexpr int kCount = 20000;
  std::thread producer([&] {
    for (int k = 0; k < kCount;) {
      int value = k;
      k += ring.push(std::move(value)) ? 1 : 0;
    }
    for (int k = 0; k < kCount;) {
      const float run[3] = {static_cast<float>(k), static_cast<float>(k + 1), static_cast<float>(k + 2)};
      if (samples.room() < 3) continue;
      samples.push(run);
      k += 3;
    }
  });
  bool ordered = true;
  for (int k = 0, value = 0; k < kCount;) {
    if (!ring.pop(value)) continue;
    ordered &= value == k++;
  }
  float one = 0;
  for (int k = 0; k < kCount - 2;) {
    if (samples.available() == 0) continue;
    samples.pop(std::span(&one, 1));
    ordered &= one == static_cast<float>(k++);
  }
  producer.join();
  CHECK(ordered);
}

TEST_CASE("A live session is paced by its clock alone") {
  HandClock clock;
  session::SessionOptions options;
  session::Session live("live", options, packs(), clock);
  CHECK(live.counters().playout_delay_s == 0.040);
  live.render();
  CHECK(drain(live).empty());
  clock.advance(0.5);
  CHECK(live.render().produced);
  CHECK(live.samples_rendered() == 24000 / synthesis::kQuantum * synthesis::kQuantum);
  live.render();
  CHECK(live.samples_rendered() == 24000 / synthesis::kQuantum * synthesis::kQuantum);
  const auto outcome = live.render();
  REQUIRE(outcome.next_due);
  CHECK(*outcome.next_due > clock.now());
}

TEST_CASE("Of a live backlog the oldest frames are skipped and counted") {
  HandClock clock;
  session::Session live("live", {}, packs(), clock);
  const auto sheet = sheets::make_demo("shake", 183);
  const test_support::AnimatedFrames frames(*sheet);
  REQUIRE(live.offer(described(), 1) == kTaken);
  for (int k = 0; k < 10; ++k) REQUIRE(live.offer(frames.at(k / 60.0), static_cast<std::uint64_t>(k) + 2) == kTaken);
  while (live.analyse()) {
  }
  const auto counters = live.counters();
  CHECK(counters.frames_received == 10);
  CHECK(counters.frames_analysed == 3);
  CHECK(counters.frames_dropped.at("backlog") == 7);
  CHECK(counters.newest_time_s == Approx(9 / 60.0));
}

TEST_CASE("Contacts end when a live sender goes quiet") {
  HandClock clock;
  session::Session live("live", {}, packs(), clock);
  const auto sheet = sheets::make_demo("slide", 446);
  const test_support::AnimatedFrames frames(*sheet);
  REQUIRE(live.offer(described(), 1) == kTaken);
  scene::Obstacle table;
  table.id = 1;
  table.shape = scene::PlaneShape{};
  REQUIRE(live.offer(scene::SceneUpdate{0, {table}, {}, {}, {}}, 2) == kTaken);
  for (int k = 0; k < 60; ++k) {
    REQUIRE(live.offer(frames.at(0.3 + k / 60.0), static_cast<std::uint64_t>(k) + 3) == kTaken);
    while (live.analyse()) {
    }
    clock.advance(1 / 60.0);
    live.render();
  }
  const auto sliding = drain(live);
  CHECK(*std::max_element(sliding.begin(), sliding.end()) > 1e-4f);
  for (int k = 0; k < 60; ++k) {
    clock.advance(1 / 60.0);
    if (live.render().wants_analysis) {
      while (live.wants_analysis()) live.analyse();
    }
  }
  const auto after = drain(live);
  REQUIRE(after.size() > 40000);
  CHECK(std::all_of(after.end() - 20000, after.end(), [](float x) { return x == 0; }));

  for (int k = 0; k < 30; ++k) {
    REQUIRE(live.offer(frames.at(1.4 + k / 60.0), static_cast<std::uint64_t>(k) + 63) == kTaken);
    while (live.analyse()) {
    }
    clock.advance(1 / 60.0);
    live.render();
  }
  const auto again = drain(live);
  CHECK(*std::max_element(again.begin(), again.end()) > 1e-4f);
}

TEST_CASE("A simulation session in threads gives the samples of the offline render") {
  const auto sheet = sheets::make_demo("snap", 183);
  const test_support::AnimatedFrames frames(*sheet);
  std::vector<engine::StreamItem> items{described()};
  for (int k = 0; k < 90; ++k) items.emplace_back(frames.at(k / 60.0));
  items.emplace_back(engine::End{});

  session::SessionOptions options;
  options.clock = session::Clock::kSimulation;
  options = session::settled(options);
  std::vector<float> offline;
  std::size_t next = 0;
  session::OfflineEnds ends;
  ends.next = [&]() -> std::optional<engine::StreamItem> { return items[next++]; };
  ends.audio = [&](const engine::AudioQuantum& quantum) {
    offline.insert(offline.end(), quantum.mix.begin(), quantum.mix.end());
    return true;
  };
  const auto summary = session::render_offline(session::engine_options(options), packs(), 1, ends);
  CHECK(summary.frames == 90);
  REQUIRE(*std::max_element(offline.begin(), offline.end()) > 1e-4f);

  session::SteadyClock clock;
  session::Scheduler scheduler({2, 1, {}, {}}, clock, [] {});
  auto live = std::make_shared<session::Session>("s", options, packs(), clock);
  scheduler.add(live);
  std::uint64_t sequence = 0;
  for (const auto& item : items) {
    REQUIRE(live->offer(item, ++sequence) == kTaken);
    scheduler.wake_analysis(live);
  }
  std::vector<float> threaded;
  session::AudioBlock block;
  while (!live->finished()) {
    if (live->take_audio(100, block)) {
      threaded.insert(threaded.end(), block.interleaved.begin(), block.interleaved.end());
    } else {
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
  }
  CHECK(threaded == offline);
  const auto counters = live->counters();
  CHECK(counters.frames_received == counters.frames_analysed + dropped(counters));
  CHECK(live->offer(frames.at(9), ++sequence) == session::Offer::kEnded);
  CHECK(live->counters().frames_dropped.at("ended") == 1);
}

TEST_CASE("An inbox holds so many bytes and no more, whatever the clock") {
  HandClock clock;
  const auto sheet = sheets::make_demo("shake", 183);
  const test_support::AnimatedFrames frames(*sheet);
  constexpr std::size_t kThird = session::Inbox::kBytes / 3;
  SECTION("a simulation's frames beyond it are refused and counted") {
    session::SessionOptions options;
    options.clock = session::Clock::kSimulation;
    session::Session simulated("s", options, packs(), clock);
    REQUIRE(simulated.offer(described(), 1, 100) == kTaken);
    for (std::uint64_t k = 2; k < 4; ++k) REQUIRE(simulated.offer(frames.at(k / 60.0), k, kThird) == kTaken);
    CHECK(simulated.offer(frames.at(4 / 60.0), 4, kThird + 100) == session::Offer::kFull);
    CHECK(simulated.counters().frames_dropped.at("inbox") == 1);
    while (simulated.analyse()) {
    }
    CHECK(simulated.offer(frames.at(5 / 60.0), 5, kThird) == kTaken);
    CHECK(simulated.offer(engine::End{}, 6, 3 * kThird) == kTaken);
    while (simulated.analyse()) {
    }
    const auto counters = simulated.counters();
    CHECK(counters.frames_received == counters.frames_analysed + dropped(counters));
  }
  SECTION("a live session's oldest frames make room") {
    session::Session live("live", {}, packs(), clock);
    REQUIRE(live.offer(described(), 1, 100) == kTaken);
    REQUIRE(live.offer(frames.at(0.1), 2, kThird) == kTaken);
    REQUIRE(live.offer(frames.at(0.2), 3, 2 * kThird) == kTaken);
    CHECK(live.counters().frames_dropped.at("backlog") == 1);
    // Nothing can be skipped for what is no frame.
    CHECK(live.offer(scene::SceneUpdate{}, 4, kThird + 100) == session::Offer::kFull);
  }
  SECTION("a message larger than all of it goes alone") {
    session::Session live("live", {}, packs(), clock);
    CHECK(live.offer(described(), 1, 4 * kThird) == kTaken);
    CHECK(live.offer(scene::SceneUpdate{}, 2, 1) == session::Offer::kFull);
  }
}

TEST_CASE("What is due, what sounds and what was lost is told") {
  HandClock clock;
  session::SessionOptions options;
  options.clock = session::Clock::kSimulation;
  const auto sheet = sheets::make_demo("snap", 183);
  const test_support::AnimatedFrames frames(*sheet);
  session::Session simulated("s", options, packs(), clock);
  REQUIRE(simulated.offer(described(), 1) == kTaken);
  // More reflecting planes than are heard at a time.
  scene::SceneUpdate planes;
  for (std::uint32_t id = 1; id <= spatial::kMaxPlanes + 1; ++id) {
    scene::Obstacle wall;
    wall.id = id;
    wall.shape = scene::PlaneShape{};
    wall.reflecting = true;
    wall.pose.position_m = {0, 0, -static_cast<double>(id)};
    planes.obstacles.push_back(wall);
  }
  REQUIRE(simulated.offer(planes, 2) == kTaken);
  for (int k = 0; k < 90; ++k) REQUIRE(simulated.offer(frames.at(k / 60.0), static_cast<std::uint64_t>(k) + 3) == kTaken);
  while (simulated.analyse()) {
  }
  simulated.render();
  session::Counters counters = simulated.counters();
  CHECK(counters.samples_due == Approx((89 / 60.0 - 0.05) * 48000).margin(2 * synthesis::kQuantum));
  CHECK(counters.render.voices_most > 0);
  CHECK(counters.plan.planes_left_out > 0);
  CHECK(counters.plan.sounds_missing == 0);
  CHECK(counters.render.cues_dropped == 0);
  simulated.end();
  while (simulated.analyse()) {
  }
  for (int pass = 0; pass < 100 && !simulated.finished(); ++pass) {
    simulated.render();
    drain(simulated);
  }
  REQUIRE(simulated.finished());
  counters = simulated.counters();
  CHECK(counters.render.voices == 0);
  CHECK(counters.samples_due == static_cast<std::uint64_t>(simulated.samples_rendered()));

  session::Session live("live", {}, packs(), clock);
  clock.advance(0.25);
  CHECK(live.counters().samples_due == 12000);
}

TEST_CASE("The newest value is read, never a torn or an older one") {
  session::LatestValue<std::array<std::uint64_t, 8>> latest;
  std::atomic<bool> stop{false};
  std::thread writer([&] {
    std::array<std::uint64_t, 8> value{};
    while (!stop) {
      for (auto& part : value) ++part;
      latest.publish(value);
    }
  });
  std::uint64_t newest = 0;
  bool whole = true, in_order = true;
  while (newest < 20000) {
    const auto value = latest.latest();
    whole &= std::all_of(value.begin(), value.end(), [&](std::uint64_t part) { return part == value[0]; });
    in_order &= value[0] >= newest;
    newest = value[0];
  }
  stop = true;
  writer.join();
  CHECK(whole);
  CHECK(in_order);
}

TEST_CASE("A sender's drift shows through the jitter of its messages") {
  for (const double ppm : {0.0, 200.0, -80.0}) {
    session::ClockDrift drift;
    std::uint64_t noise = 1;
    double sent_s = 1e6;
    for (int k = 0; k < 60 * 60; ++k) {
      const double t = k / 60.0;
      noise = noise * 6364136223846793005ULL + 1442695040888963407ULL;
      const double jitter_s = 0.004 * static_cast<double>(noise >> 40) / (1 << 24);
      sent_s = 1e6 + t * (1 + 1e-6 * ppm);
      if (t < 10) CHECK(drift.ppm() == 0);
      drift.add(sent_s, 7 + t + 0.001 + jitter_s);
    }
    CHECK(drift.ppm() == Approx(ppm).margin(15));
    drift.add(sent_s - 500, 68);
    CHECK(drift.ppm() == 0);
  }
}

}  // namespace

}  // namespace session_test
