#include <catch2/catch.hpp>
#include <chrono>
#include <optional>
#include <vector>

#include "client_sdk/sheets/demos.h"
#include "server/session/watch.h"
#include "sound_db/pack/library.h"
#include "tests/support/animated_frames.h"

namespace watch_test {
namespace {

using namespace rustle;
using session::Watch;

/// A sheet that slides on a table, and what watches it.
struct Scene {
  Scene() : sheet(sheets::make_demo("slide", 183)), frames(*sheet) {
    take(engine::SheetDescription{1, "sheet", engine::SheetKind::kPaper, "", "", {}, {}});
    scene::Obstacle table;
    table.id = 1;
    table.shape = scene::PlaneShape{};
    take(scene::SceneUpdate{0, {table}, {}, {}, {}});
  }
  std::optional<observation::Observation> take(const engine::StreamItem& item) {
    engine::CueBatch batch;
    auto taken = ingest.accept(item, batch);
    REQUIRE(taken);
    return std::move(*taken);
  }
  void show(Watch& watch, double time_s, double now_s) {
    auto frame = frames.at(time_s);
    const auto observed = take(frame);
    watch.saw(ingest, std::move(frame), *observed,
              std::chrono::duration_cast<session::WallClock::Duration>(std::chrono::duration<double>(now_s)));
  }

  std::unique_ptr<sheets::AnimatedSheet> sheet;
  test_support::AnimatedFrames frames;
  engine::Ingest ingest{engine::Options{},
                        std::make_shared<pack::PackLibrary>(std::vector<std::filesystem::path>{RUSTLE_BUILT_PACKS})};
};

template <class What>
std::vector<What> all_of(Watch& watch) {
  std::vector<What> out;
  for (session::Seen seen; watch.next(seen);)
    if (auto* one = std::get_if<What>(&seen)) out.push_back(std::move(*one));
  return out;
}

}  // namespace

TEST_CASE("who begins to watch sees what is there, and then what changes", "[session][watch]") {
  Scene scene;
  scene.take(scene.frames.at(0));
  Watch watch;
  watch.look(scene.ingest);
  session::Seen seen;
  REQUIRE(watch.next(seen));
  const auto around = std::get<engine::Surroundings>(seen);
  CHECK(around.sheets.size() == 1);
  CHECK(around.scene->obstacles().size() == 1);
  REQUIRE(around.listener);
  REQUIRE(watch.next(seen));
  CHECK((std::get<session::SeenFrame>(seen).frame.positions_m == scene.frames.at(0).positions_m));
  CHECK_FALSE(watch.next(seen));

  watch.look(scene.ingest);
  CHECK_FALSE(watch.next(seen));  // nothing is new
  scene.take(engine::ListenerMove{{1, 2, 3}});
  watch.look(scene.ingest);
  const auto moved = all_of<engine::Surroundings>(watch);
  REQUIRE(moved.size() == 1);
  CHECK((moved.front().listener->position_m == sheet::Vec3d(1, 2, 3)));
  CHECK_FALSE(moved.front().listener->forward);
  CHECK(moved.front().scene == around.scene);  // not copied again
}

TEST_CASE("at most thirty frames a second are taken, and every event is told", "[session][watch]") {
  const int rate = GENERATE(20, 30, 60, 240);
  Scene scene;
  Watch watch;
  std::size_t frames = 0, contacts = 0;
  for (int k = 0; k < 2 * rate; ++k) {
    scene.show(watch, static_cast<double>(k) / rate, static_cast<double>(k) / rate + (k % 3) * 0.002);
    for (session::Seen seen; watch.next(seen);) {
      frames += std::holds_alternative<session::SeenFrame>(seen) ? 1 : 0;
      if (const auto* events = std::get_if<session::SeenEvents>(&seen)) contacts += events->contacts.size();
    }
  }
  CAPTURE(rate);
  CHECK(frames <= 62);  // of two seconds, begun early and ended late
  CHECK(frames >= (rate == 20 ? 40U : 56U));
  CHECK(watch.frames_taken() == frames);
  CHECK(contacts > frames / 2);
}

TEST_CASE("of who does not look, what is too much is left out and counted", "[session][watch]") {
  Scene scene;
  Watch watch;
  for (int k = 0; k < 400; ++k) scene.show(watch, k / 30.0, k / 30.0);
  CHECK(watch.left_out() > 100);
  const auto frames = all_of<session::SeenFrame>(watch);
  CHECK(!frames.empty());
  CHECK(frames.size() < watch.frames_taken());
}

}  // namespace watch_test
