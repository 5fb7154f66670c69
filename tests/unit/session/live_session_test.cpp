#include <catch2/catch.hpp>

#include <algorithm>
#include <atomic>
#include <map>
#include <numeric>

#include "client_sdk/sheets/demos.h"
#include "server/session/session.h"
#include "tests/support/animated_frames.h"

namespace live_session_test {

namespace {

using namespace rustle;

class HandClock final : public session::WallClock {
 public:
  Duration now() const override { return Duration(ns_.load()); }
  void advance(std::int64_t ns) { ns_ += ns; }

 private:
  std::atomic<std::int64_t> ns_{1};
};

std::shared_ptr<pack::PackLibrary> packs() {
  static const auto library = std::make_shared<pack::PackLibrary>(std::vector<std::filesystem::path>{RUSTLE_BUILT_PACKS});
  return library;
}

class Chance {
 public:
  double next() {
    state_ = state_ * 6364136223846793005ULL + 1442695040888963407ULL;
    return static_cast<double>(state_ >> 11) / 9007199254740992.0;
  }

 private:
  std::uint64_t state_ = 1;
};

/// A live session on a clock turned by hand: what is to arrive arrives at its time, analysis and rendering follow at once.
class Played {
 public:
  explicit Played(const session::SessionOptions& options = {}, const std::string& motion = "slide")
      : sheet_(sheets::make_demo(motion, 183)), frames_(*sheet_), session("live", options, packs(), clock) {
    offer(engine::SheetDescription{1, "sheet", engine::SheetKind::kPaper, "", "", {}, {}});
    scene::Obstacle table;
    table.id = 1;
    table.shape = scene::PlaneShape{};
    offer(scene::SceneUpdate{0, {table}, {}, {}, {}});
  }

  /// A frame of the demo's moment `motion_s` that says `time_s`, to arrive at `arrives_s` on the audio clock.
  void frame(double arrives_s, double time_s, std::uint64_t sequence = 0) {
    arriving_.emplace(arrives_s, std::pair(time_s, sequence));
  }
  void offer(engine::StreamItem item, std::uint64_t sequence = 0) {
    REQUIRE(session.offer(std::move(item), sequence, 100) == session::Offer::kTaken);
    analyse();
  }

  /// Turns the clock by milliseconds up to `until_s`.
  void run(double until_s) {
    for (; static_cast<double>(now_ms_) < until_s * 1000; ++now_ms_) {
      while (!arriving_.empty() && arriving_.begin()->first * 1000 <= static_cast<double>(now_ms_)) {
        const auto [time_s, sequence] = arriving_.begin()->second;
        arriving_.erase(arriving_.begin());
        sheet::MeshFrame frame = frames_.at(0.3 + std::fmod(time_s, 1.0));
        frame.time_s = time_s;
        offer(std::move(frame), sequence);
      }
      if (session.render().wants_analysis) analyse();
      for (session::AudioBlock block; session.take_audio(128, block);) {
        CHECK(block.first_sample == static_cast<std::int64_t>(sound.size()) / block.channels);
        sound.insert(sound.end(), block.interleaved.begin(), block.interleaved.end());
      }
      clock.advance(1'000'000);
    }
  }

  /// The sums that hold at any time.
  session::Counters counters() {
    const auto figures = session.counters();
    const auto dropped = std::accumulate(figures.frames_dropped.begin(), figures.frames_dropped.end(), std::uint64_t{0},
                                         [](std::uint64_t sum, const auto& entry) { return sum + entry.second; });
    CHECK(figures.frames_received == figures.frames_analysed + dropped);
    CHECK(figures.samples_due - sound.size() / 2 < 128 + 64 + 48);  // sent in whole blocks, looked at every millisecond
    return figures;
  }

 private:
  void analyse() {
    while (session.wants_analysis())
      while (session.analyse()) {
      }
  }

  std::unique_ptr<sheets::AnimatedSheet> sheet_;
  test_support::AnimatedFrames frames_;
  std::multimap<double, std::pair<double, std::uint64_t>> arriving_;
  int now_ms_ = 0;

 public:
  HandClock clock;
  session::Session session;
  std::vector<float> sound;
};

TEST_CASE("Drift is followed by a whole session: nothing late, no gap, the times of its sound right") {
  const double ppm = GENERATE(200.0, -200.0);
  Played played;
  const auto arrives_s = [&](double t) { return 0.5 + t / (1 + 1e-6 * ppm); };
  for (int k = 0; k < 180 * 60; ++k) played.frame(arrives_s(k / 60.0), k / 60.0, static_cast<std::uint64_t>(k) + 1);
  played.run(180);
  const auto figures = played.counters();
  CHECK(figures.frames_late == 0);
  CHECK(figures.input_gaps.gaps == 0);
  CHECK(figures.time_jumps == 0);
  CHECK(figures.clock_drift_ppm == Approx(ppm).margin(15));  // arrivals are looked at every millisecond
  const double rendered_s = static_cast<double>(played.session.samples_rendered()) / 48000;
  const double time_s = played.session.time_of(played.session.samples_rendered());
  CHECK(rendered_s - figures.playout_delay_s == Approx(arrives_s(time_s)).margin(0.001 + 0.001));
}

TEST_CASE("Jitter of 20 ± 10 ms with one frame in a hundred lost leaves no gap in a session's sound") {
  const double frames_per_s = GENERATE(30.0, 60.0);
  Played played;
  Chance chance;
  std::uint64_t sequence = 0, sent = 0;
  for (int k = 0; k < 60 * frames_per_s; ++k) {
    ++sequence;
    const double arrives_s = 0.5 + k / frames_per_s + 0.01 + 0.02 * chance.next();
    if (chance.next() < 0.01) continue;
    played.frame(arrives_s, k / frames_per_s, sequence);
    ++sent;
  }
  played.run(60.55);
  const auto figures = played.counters();
  CHECK(figures.input_gaps.gaps == 0);
  CHECK(figures.input_gaps.samples == 0);
  CHECK(figures.playout_delay_s <= 0.08);
  CHECK(figures.frames_received == sent);
  CHECK(figures.sequence_gaps == sequence - sent);
  CHECK(figures.frames_analysed == sent);  // what overtook another waited for it
  CHECK(figures.time_jumps == 0);
}

TEST_CASE("A stall of 500 ms is one gap, then the session is in step") {
  const bool all_come = GENERATE(false, true);
  Played played;
  for (int k = 0; k < 600; ++k) {
    const double t = k / 60.0;
    const bool held_up = t > 5 && t < 5.5;
    if (held_up && !all_come) continue;
    played.frame(0.5 + (held_up ? 5.5 : t), t, static_cast<std::uint64_t>(k) + 1);
  }
  played.run(10.4);
  const auto figures = played.counters();
  CHECK(figures.input_gaps.gaps == 1);
  // From the newest frame's time on, which the delay puts off.
  CHECK(figures.input_gaps.samples == Approx((0.5 - figures.playout_delay_s) * 48000).margin(0.01 * 48000));
  CHECK(figures.sequence_gaps == (all_come ? 0 : 29));
  CHECK(figures.time_jumps == 0);
  const std::int64_t rendered = played.session.samples_rendered();
  CHECK(played.session.time_of(rendered) ==
        Approx(static_cast<double>(rendered) / 48000 - 0.5 - figures.playout_delay_s).margin(0.003));
}

TEST_CASE("A sender that falls quiet is one gap, and its contacts end") {
  Played played;
  for (int k = 0; k < 60; ++k) played.frame(0.5 + k / 60.0, k / 60.0);
  played.run(1.5);
  CHECK(*std::max_element(played.sound.end() - 20000, played.sound.end()) > 1e-4f);
  played.run(3);
  CHECK(std::all_of(played.sound.end() - 48000, played.sound.end(), [](float x) { return x == 0; }));
  CHECK(played.counters().input_gaps.gaps == 1);
  for (int k = 150; k < 240; ++k) played.frame(0.5 + k / 60.0, k / 60.0);
  played.run(4.4);
  CHECK(*std::max_element(played.sound.end() - 20000, played.sound.end()) > 1e-4f);
  CHECK(played.counters().input_gaps.gaps == 1);
}

TEST_CASE("Repeated, overtaken and lost frames are counted by cause") {
  Played played;
  for (int k = 0; k < 300; ++k) {
    const double t = k / 60.0;
    const auto sequence = static_cast<std::uint64_t>(k) + 1;
    if (k % 50 == 10) continue;  // lost: 6
    const double late_s = k % 50 == 20   ? 0.020
                          : k % 50 == 30 ? 0.06
                                         : 0;  // overtaken by one: 6; by several, beyond waiting: 6
    played.frame(0.5 + t + late_s, t, sequence);
    if (k % 50 == 40) played.frame(0.503 + t, t, sequence);         // the message repeated: 6
    if (k % 50 == 45) played.frame(0.503 + t, t, 1000 + sequence);  // the same moment sent again: 6
  }
  played.run(5.8);
  const auto figures = played.counters();
  CHECK(figures.frames_dropped.at("reordered") == 6);
  CHECK(figures.frames_dropped.at("duplicate") == 12);
  CHECK(figures.frames_dropped.size() == 2);
  CHECK(figures.frames_analysed == 300 - 6 - 6);
}

TEST_CASE("A frame that comes after it was due still tells what moved") {
  session::SessionOptions options;
  options.playout_delay_s = 0.02;
  Played played(options);
  for (int k = 0; k < 120; ++k)
    played.frame(0.5 + k / 60.0 + (k % 20 == 10 ? 0.03 : 0), k / 60.0 + (k % 20 == 10 ? -0.001 : 0));
  played.run(2.6);
  const auto figures = played.counters();
  CHECK(figures.playout_delay_s == 0.02);
  CHECK(figures.frames_late + figures.frames_dropped.at("reordered") == 6);
  CHECK(figures.time_jumps == 0);
}

TEST_CASE("Simulation time that pauses, steps or begins anew is followed and counted") {
  Played played;
  double at = 0.5;
  std::uint64_t sequence = 0;
  const auto send = [&](double from_s, double to_s) {
    for (double t = from_s; t < to_s - 1e-9; t += 1 / 60.0, at += 1 / 60.0) played.frame(at, t, ++sequence);
  };
  const auto in_step = [&] {
    played.run(at);
    const double newest_s = played.session.counters().newest_time_s;
    const double heard_s = played.session.time_of(played.session.samples_rendered());
    CHECK(newest_s - heard_s == Approx(played.session.counters().playout_delay_s).margin(0.025));
  };
  send(0, 1);
  in_step();
  CHECK(played.counters().time_jumps == 0);
  at += 0.7;  // a pause
  send(1, 2);
  in_step();
  CHECK(played.counters().time_jumps == 1);
  CHECK(played.counters().input_gaps.gaps == 1);
  send(50, 51);  // a step ahead
  in_step();
  CHECK(played.counters().time_jumps == 2);
  scene::SceneUpdate still{50.9, {}, {}, {}, {}};
  played.offer(still, ++sequence);
  send(0, 1);  // anew
  in_step();
  CHECK(played.counters().time_jumps == 3);
  CHECK(*std::max_element(played.sound.end() - 20000, played.sound.end()) > 1e-4f);
  const auto figures = played.counters();
  CHECK(figures.frames_analysed == figures.frames_received);
  CHECK(figures.frames_dropped.empty());
}

TEST_CASE("A simulator at half speed is heard in step") {
  Played played;
  for (int k = 0; k < 600; ++k) played.frame(0.5 + k / 30.0, k / 60.0, static_cast<std::uint64_t>(k) + 1);
  played.run(1.5);
  const auto gaps = played.counters().input_gaps.gaps;
  played.run(20.55);
  const auto figures = played.counters();
  CHECK(figures.clock_drift_ppm == Approx(-500000).margin(1000));
  CHECK(figures.input_gaps.gaps == gaps);  // none once its speed is known
  CHECK(figures.frames_analysed == 600);
  const std::int64_t rendered = played.session.samples_rendered();
  CHECK(played.session.time_of(rendered) ==
        Approx((static_cast<double>(rendered) / 48000 - 0.5 - figures.playout_delay_s) / 2).margin(0.005));
}

TEST_CASE("Scene and listener that come before the first frame are in force when it sounds") {
  session::SessionOptions options;
  options.channels = session::ChannelLayout::kMono;
  const auto level = [&](double said_s) {
    Played played(options);
    played.run(0.2);
    scene::Listener far;
    far.time_s = said_s;
    far.position_m = {0, -30, 15};
    played.offer(far);
    for (int k = 0; k < 90; ++k) played.frame(0.5 + k / 60.0, 5000 + k / 60.0);
    played.run(2);
    double sum = 0;
    for (const float x : played.sound) sum += x * x;
    return sum;
  };
  const double expected = level(0);
  CHECK(expected > 0);
  CHECK(level(5000) == Approx(expected).epsilon(0.05));
}

}  // namespace

}  // namespace live_session_test
