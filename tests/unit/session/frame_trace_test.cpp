#include <sched.h>

#include <catch2/catch.hpp>

#include <atomic>
#include <chrono>
#include <cmath>
#include <filesystem>
#include <thread>
#include <utility>
#include <vector>

#include "client_sdk/sheets/demos.h"
#include "server/session/session.h"
#include "server/session/worker_thread.h"
#include "tests/support/animated_frames.h"

namespace frame_trace_test {

namespace {

using namespace rustle;
using session::Station;
using Duration = session::WallClock::Duration;
using std::chrono::milliseconds;

class HandClock final : public session::WallClock {
 public:
  Duration now() const override { return Duration(ns_.load()); }
  void advance(Duration by) { ns_ += by.count(); }

 private:
  std::atomic<std::int64_t> ns_{1};
};

sheet::MeshFrame frame_at(double time_s) {
  sheet::MeshFrame frame;
  frame.sheet = 3;
  frame.time_s = time_s;
  return frame;
}

TEST_CASE("A frame's marks are kept until as many newer frames have come as are kept; later marks are lost") {
  session::FrameTraces traces;
  const auto first = traces.begin(7, frame_at(0.5), Duration(10), Duration(30));
  CHECK(first == 1);
  CHECK(traces.pass(first, Station::kBegun, Duration(35)) == Duration(5));
  auto kept = traces.newest();
  REQUIRE(kept.size() == 1);
  CHECK(kept[0].frame == 1);
  CHECK(kept[0].sequence == 7);
  CHECK(kept[0].sheet == 3);
  CHECK(kept[0].time_s == 0.5);
  CHECK(kept[0].at(Station::kReceived) == Duration(10));
  CHECK(kept[0].at(Station::kAnalysed) == Duration(0));
  for (std::size_t k = 0; k < session::FrameTraces::kKept; ++k) traces.begin(0, frame_at(1), Duration(50), Duration(60));
  CHECK(traces.pass(first, Station::kAnalysed, Duration(70)).count() < 0);
  kept = traces.newest();
  CHECK(kept.size() == session::FrameTraces::kKept);
  CHECK(kept.front().frame == 2);
  CHECK(kept.front().at(Station::kAnalysed) == Duration(0));
  CHECK(traces.newest(3).front().frame == session::FrameTraces::kKept - 1);
}

TEST_CASE("A frame is sent when its own first sample is, in whatever order frames sound") {
  session::FrameTraces traces;
  session::DurationHistogram beyond;
  for (const std::int64_t first_sample : {1000, 3000, 2000}) {
    const auto frame = traces.begin(0, frame_at(0), milliseconds(1), milliseconds(1));
    traces.place(frame, first_sample, 0.020);
    traces.pass(frame, Station::kAnalysed, milliseconds(2));
  }
  const auto dropped = traces.begin(0, frame_at(0), milliseconds(1), milliseconds(1));
  traces.drop(dropped, "backlog");
  const auto sent = [&] {
    std::vector<bool> out;
    for (const auto& trace : traces.newest()) out.push_back(trace.at(Station::kSent).count() != 0);
    return out;
  };
  traces.sent(1000, milliseconds(30), &beyond);
  CHECK(sent() == std::vector<bool>{false, false, false, false});
  traces.sent(2001, milliseconds(31), &beyond);
  CHECK(sent() == std::vector<bool>{true, false, true, false});
  traces.sent(9999, milliseconds(51), &beyond);
  CHECK(sent() == std::vector<bool>{true, true, true, false});
  CHECK(beyond.counts().all() == 3);
  CHECK(beyond.counts().sum_s == Approx(0.010 + 0.010 + 0.030));
  CHECK(std::string(traces.newest().back().dropped) == "backlog");
}

TEST_CASE("A duration falls into the range whose end it does not pass") {
  session::DurationHistogram histogram;
  histogram.add(Duration(-5));
  histogram.add(std::chrono::microseconds(10));
  histogram.add(Duration(10'001));
  histogram.add(std::chrono::seconds(1));
  histogram.add(std::chrono::seconds(2));
  const auto counts = histogram.counts();
  CHECK(counts.in_range[0] == 2);
  CHECK(counts.in_range[1] == 1);
  CHECK(counts.in_range[counts.in_range.size() - 2] == 1);
  CHECK(counts.in_range.back() == 1);
  CHECK(counts.all() == 5);
}

/// A live session whose clock and threads are the test's.
struct Played {
  explicit Played(std::uint32_t block_size = 128) : sheet(sheets::make_demo("slide", 183)), frames(*sheet) {
    session::SessionOptions options;
    options.block_size = block_size;
    options.playout_delay_s = 0.040;
    session = std::make_unique<session::Session>(
        "traced", options, std::make_shared<pack::PackLibrary>(std::vector<std::filesystem::path>{RUSTLE_BUILT_PACKS}),
        clock);
    static_cast<void>(session->offer(engine::SheetDescription{1, "", engine::SheetKind::kPaper, "", "", {}, {}}, 0));
    analyse();
    session->render();
  }
  void analyse() {
    while (session->analyse()) {
    }
  }
  void drain() {
    for (session::AudioBlock block; session->take_audio(128, block);)
      session->sound_left(block.first_sample + static_cast<std::int64_t>(block.interleaved.size()) / block.channels);
  }

  HandClock clock;
  std::unique_ptr<sheets::AnimatedSheet> sheet;
  test_support::AnimatedFrames frames;
  std::unique_ptr<session::Session> session;
};

TEST_CASE("Every frame of a live session passes its stations in order, and is sent a playout delay after it came") {
  Played played;
  for (int ms = 0; ms < 1000; ++ms) {
    played.clock.advance(milliseconds(1));
    if (ms % 20 == 0) {
      auto frame = played.frames.at(0.5);
      frame.time_s = ms / 1000.0;
      const auto received = played.clock.now() - std::chrono::microseconds(300);
      REQUIRE(played.session->offer(std::move(frame), static_cast<std::uint64_t>(ms / 20 + 1), 100, 0, received) ==
              session::Offer::kTaken);
    }
    if (ms % 20 == 2) played.analyse();
    played.session->render();
    played.drain();
  }
  const auto traces = played.session->traces().newest();
  REQUIRE(traces.size() == 50);
  for (const auto& trace : traces) {
    INFO("frame " << trace.frame);
    if (trace.frame > 45) continue;  // still on its way
    for (std::size_t k = 0; k + 1 < session::kStations; ++k) CHECK(trace.passed[k] <= trace.passed[k + 1]);
    CHECK(trace.dropped == nullptr);
    CHECK(trace.at(Station::kDecoded) - trace.at(Station::kReceived) == std::chrono::microseconds(300));
    CHECK(trace.at(Station::kBegun) - trace.at(Station::kDecoded) == milliseconds(2));
    CHECK(trace.delay_s == 0.040);
    const auto heard = trace.at(Station::kSent) - trace.at(Station::kReceived);
    CHECK(heard >= milliseconds(39));
    CHECK(heard <= milliseconds(40 + 2 + 3 + 1));  // analysis, a block, a look
  }
  const auto figures = played.session->counters();
  CHECK(figures.frames_analysed == 50);
  CHECK(played.session->stage_times().decode.counts().all() == figures.frames_received);
  CHECK(played.session->stage_times().wait.counts().all() == figures.frames_analysed);
  CHECK(played.session->stage_times().analysis.counts().all() == figures.frames_analysed);
  CHECK(played.session->stage_times().hand_over.counts().all() == figures.frames_analysed);
}

TEST_CASE("A dropped frame's trace says why") {
  Played played;
  for (int k = 0; k < 5; ++k) {
    auto frame = played.frames.at(0.5);
    frame.time_s = k / 60.0;
    REQUIRE(played.session->offer(std::move(frame), 0) == session::Offer::kTaken);
  }
  auto again = played.frames.at(0.5);
  again.time_s = 4 / 60.0;
  REQUIRE(played.session->offer(std::move(again), 0) == session::Offer::kTaken);
  const auto traces = played.session->traces().newest();
  REQUIRE(traces.size() == 6);
  for (const std::size_t k : {0, 1}) CHECK(std::string(traces[k].dropped) == "backlog");
  for (const std::size_t k : {2, 3, 4}) CHECK(traces[k].dropped == nullptr);
  CHECK(std::string(traces[5].dropped) == "duplicate");
}

TEST_CASE("Analysis has stalled for as long as something waits and nothing is taken up") {
  Played played;
  CHECK(played.session->analysis_stalled() == Duration(0));
  played.clock.advance(std::chrono::seconds(9));
  CHECK(played.session->analysis_stalled() == Duration(0));
  REQUIRE(played.session->offer(played.frames.at(0.5), 0) == session::Offer::kTaken);
  played.clock.advance(std::chrono::seconds(2));
  CHECK(played.session->analysis_stalled() == std::chrono::seconds(2));
  played.analyse();
  CHECK(played.session->analysis_stalled() == Duration(0));
}

TEST_CASE("A block is late when it is not rendered a block after it was due") {
  const std::uint32_t block_size = GENERATE(64u, 128u, 480u, 1024u);
  Played played(block_size);
  const std::int64_t block = (static_cast<std::int64_t>(block_size) + 63) / 64 * 64;
  const double grace_s = std::max(static_cast<double>(block) / 48000, 0.002);
  const auto seconds = [](double s) { return std::chrono::duration_cast<Duration>(std::chrono::duration<double>(s)); };
  const auto render_at = [&](double audio_s) {
    played.clock.advance(seconds(audio_s) + Duration(1) - played.clock.now());
    return played.session->render();
  };
  const auto rendered_s = [&] { return static_cast<double>(played.session->samples_rendered()) / 48000; };
  REQUIRE(render_at(8.0 * static_cast<double>(block) / 48000 + 1e-4).produced);
  const auto in_time = render_at(rendered_s() + static_cast<double>(block) / 48000 + grace_s - 1e-5);
  CHECK(in_time.produced);
  CHECK(in_time.blocks_late == 0);
  const double from_s = rendered_s();
  // Of the blocks rendered now, those that were due longer ago than the grace are late.
  const double now_s = from_s + 10 * static_cast<double>(block) / 48000 + grace_s + 1e-5;
  const auto outcome = render_at(now_s);
  CHECK(outcome.blocks_late == 10);
  CHECK(outcome.late.count() == Approx(1e9 * (now_s - from_s - static_cast<double>(block) / 48000 - grace_s)).margin(2e4));
  CHECK(outcome.due.count() == Approx(1e9 * (from_s + static_cast<double>(block) / 48000)).margin(2e4));
  played.session->count_late(3, true);
  played.session->count_late(outcome.blocks_late, false);
  CHECK(played.session->counters().late_by_run_delay == 3);
  CHECK(played.session->counters().deadline_misses == 10);
}

TEST_CASE("Run delay grows while a thread competes for a processor, and notes tell since when") {
  const std::vector<int> processor{::sched_getcpu()};
  std::atomic<bool> stop{false};
  std::thread rival([&] {
    session::pin_this_thread(processor);
    while (!stop) {
    }
  });
  Duration before{}, since_note{}, since_later{};
  std::thread measured([&] {
    session::pin_this_thread(processor);
    session::RunDelay delay;
    before = delay.total();
    delay.note(milliseconds(1));
    while (delay.total() - before < milliseconds(20)) {
    }
    delay.note(milliseconds(2));
    since_note = delay.since(milliseconds(1));
    since_later = delay.since(milliseconds(2));
  });
  measured.join();
  stop = true;
  rival.join();
  CHECK(since_note >= milliseconds(20));
  CHECK(since_later < since_note);
}

}  // namespace

}  // namespace frame_trace_test
