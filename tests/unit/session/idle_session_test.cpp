#include <catch2/catch.hpp>

#include <atomic>
#include <chrono>
#include <filesystem>
#include <memory>

#include "client_sdk/sheets/demos.h"
#include "server/session/session.h"
#include "tests/support/animated_frames.h"

namespace idle_session_test {

namespace {

using namespace rustle;
using Duration = session::WallClock::Duration;
using std::chrono::milliseconds;

class HandClock final : public session::WallClock {
 public:
  Duration now() const override { return Duration(ns_.load()); }
  void turn_to(Duration time) { ns_ = time.count(); }

 private:
  std::atomic<std::int64_t> ns_{7'000'000'001};
};

/// A live session that is rendered when it says it is due, and by nobody else.
struct Rendered {
  Rendered() : sheet(sheets::make_demo("slide", 183)), frames(*sheet) {
    session::SessionOptions options;
    options.block_size = 128;
    session = std::make_unique<session::Session>(
        "idle", options, std::make_shared<pack::PackLibrary>(std::vector<std::filesystem::path>{RUSTLE_BUILT_PACKS}), clock);
  }
  /// How often it was rendered until then.
  int run_until(Duration time) {
    int count = 0;
    while (due <= time) {
      clock.turn_to(std::max(clock.now(), due));
      const auto outcome = session->render();
      CHECK(outcome.blocks_late == 0);
      due = outcome.next_due.value();
      ++count;
      for (session::AudioBlock block; session->take_audio(128, block);)
        samples += static_cast<std::int64_t>(block.interleaved.size()) / block.channels;
    }
    clock.turn_to(time);
    return count;
  }
  void analyse() {
    while (session->analyse()) {
    }
  }

  HandClock clock;
  const Duration start = clock.now();
  std::unique_ptr<sheets::AnimatedSheet> sheet;
  test_support::AnimatedFrames frames;
  std::unique_ptr<session::Session> session;
  Duration due = start;
  std::int64_t samples = 0;
};

TEST_CASE("A live session without frames is rendered fifty times a second after a while, and loses no sample by it") {
  Rendered idle;
  const int at_first = idle.run_until(idle.start + milliseconds(1000));
  CHECK(at_first > 370);
  CHECK_FALSE(idle.session->renders_on_call());
  idle.run_until(idle.start + milliseconds(1100));
  CHECK(idle.session->renders_on_call());
  const int then = idle.run_until(idle.start + milliseconds(11'100));
  CHECK(then <= 501);
  CHECK(then >= 499);
  const std::int64_t due =
      static_cast<std::int64_t>(std::chrono::duration<double>(idle.clock.now() - idle.start).count() * 48000);
  CHECK(due - idle.samples >= 0);
  CHECK(due - idle.samples < 960 + 128 + 64);
}

TEST_CASE("Rendered in steps of several blocks a session loses no sample, at moments that sessions share") {
  constexpr std::int64_t kStep = 4 * 128;
  Rendered one, other;
  other.clock.turn_to(other.start + std::chrono::microseconds(3'333));
  one.session->render_in_steps_of(4);
  other.session->render_in_steps_of(4);
  CHECK(one.run_until(one.start + milliseconds(500)) <= 48);
  other.run_until(one.start + milliseconds(500));
  CHECK(one.due == other.due);
  for (int step = 0; step < 20; ++step) {
    const std::int64_t before = one.samples;
    CHECK(one.run_until(one.due) == 1);
    CHECK(one.samples - before == kStep);
  }
  // Late for once: what comes is what was due at the moment, so that the next step is whole again.
  const std::int64_t before = one.samples;
  one.clock.turn_to(one.due + milliseconds(4));
  CHECK(one.run_until(one.clock.now()) == 1);
  CHECK(one.samples - before == kStep);
  CHECK(one.run_until(one.due) == 1);
  CHECK(one.samples - before == 2 * kStep);
  const double due = std::chrono::duration<double>(one.clock.now() - one.start).count() * 48000;
  CHECK(due - static_cast<double>(one.samples) < kStep);
  one.session->render_in_steps_of(1);
  one.run_until(one.due);
  CHECK(one.run_until(one.clock.now() + milliseconds(100)) >= 36);
}

TEST_CASE("Idle sessions are due at the same moments, whenever they began") {
  Rendered one, other;
  other.clock.turn_to(other.start + std::chrono::microseconds(3'333));
  one.run_until(one.start + milliseconds(2000));
  other.run_until(one.start + milliseconds(2000));
  CHECK(one.due == other.due);
}

TEST_CASE("What analysis hands over ends a session's idleness at once") {
  Rendered idle;
  idle.run_until(idle.start + milliseconds(3000));
  REQUIRE(idle.session->renders_on_call());
  REQUIRE(idle.session->offer(engine::SheetDescription{1, "", engine::SheetKind::kPaper, "", "", {}, {}}, 0) ==
          session::Offer::kTaken);
  auto frame = idle.frames.at(0.5);
  frame.time_s = 0;
  REQUIRE(idle.session->offer(std::move(frame), 0) == session::Offer::kTaken);
  idle.analyse();
  idle.due = idle.clock.now();  // as the scheduler calls it
  idle.run_until(idle.clock.now());
  CHECK_FALSE(idle.session->renders_on_call());
  CHECK(idle.due - idle.clock.now() < milliseconds(3));
}

}  // namespace

}  // namespace idle_session_test
