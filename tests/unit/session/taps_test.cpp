#include <catch2/catch.hpp>

#include <algorithm>
#include <cmath>
#include <map>
#include <thread>

#include "client_sdk/sheets/demos.h"
#include "server/session/session.h"
#include "server/session/taps.h"
#include "tests/support/animated_frames.h"
#include "tests/support/counted_allocations.h"

namespace taps_test {

namespace {

using namespace rustle;
using synthesis::kQuantum;
using synthesis::SoundKind;

class StillClock final : public session::WallClock {
 public:
  Duration now() const override { return Duration(1); }
};

std::shared_ptr<pack::PackLibrary> packs() {
  static const auto library = std::make_shared<pack::PackLibrary>(std::vector<std::filesystem::path>{RUSTLE_BUILT_PACKS});
  return library;
}

/// Two sheets on the simulation clock: one is shaken, the other slides over a table.
class TwoSheets {
 public:
  explicit TwoSheets(std::uint32_t block_size = 128)
      : session("s", options(block_size), packs(), clock_), block_(block_size) {}

  void offer() {
    static_cast<void>(
        session.offer(engine::SheetDescription{3, "a", engine::SheetKind::kPaper, "", "", {}, {}}, ++sequence_));
    static_cast<void>(
        session.offer(engine::SheetDescription{8, "b", engine::SheetKind::kPaper, "", "", {}, {}}, ++sequence_));
    scene::Obstacle table;
    table.id = 1;
    table.shape = scene::PlaneShape{};
    static_cast<void>(session.offer(scene::SceneUpdate{0, {table}, {}, {}, {}}, ++sequence_));
    for (int k = 0; k < 60; ++k) {
      for (auto frame : {shaken_.at(0.3 + k / 60.0), sliding_.at(0.3 + k / 60.0)}) {
        frame.time_s = k / 60.0;
        static_cast<void>(session.offer(std::move(frame), ++sequence_));
      }
    }
    session.end();
    while (session.analyse()) {
    }
  }

  /// The rest of the mix, `each` called whenever some of it was taken.
  template <typename Each>
  std::vector<float> play(const Each& each) {
    std::vector<float> mix;
    session::AudioBlock block;
    for (int pass = 0; pass < 1000 && !session.finished(); ++pass) {
      session.render();
      while (session.take_audio(block_, block)) mix.insert(mix.end(), block.interleaved.begin(), block.interleaved.end());
      each();
    }
    return mix;
  }

 private:
  static session::SessionOptions options(std::uint32_t block_size) {
    session::SessionOptions made;
    made.clock = session::Clock::kSimulation;
    made.block_size = block_size;
    return made;
  }
  StillClock clock_;
  const std::unique_ptr<sheets::AnimatedSheet> shaking_ = sheets::make_demo("shake", 183),
                                               moving_ = sheets::make_demo("slide", 183);
  const test_support::AnimatedFrames shaken_{*shaking_, 3}, sliding_{*moving_, 8};
  std::uint64_t sequence_ = 0;

 public:
  session::Session session;

 private:
  std::size_t block_;
};

void drain(session::StemTap& stem, std::vector<float>& into) {
  const std::size_t from = into.size();
  into.resize(from + stem.audio.available());
  stem.audio.pop(std::span(into).subspan(from));
}

float peak(const std::vector<float>& samples) {
  float most = 0;
  for (const float x : samples) most = std::max(most, std::abs(x));
  return most;
}

constexpr sheet::SheetId kSheets[] = {3, 8};
constexpr SoundKind kKinds[] = {SoundKind::kCrumpling, SoundKind::kFriction, SoundKind::kTearing};

}  // namespace

TEST_CASE("Stems add up to the mix, bit for bit, for any block size, and the mix does not know of them") {
  TwoSheets alone;
  alone.offer();
  const auto wanted = alone.play([] {});
  REQUIRE(peak(wanted) > 1e-3f);
  REQUIRE(alone.session.counters().render.samples_limited == 0);
  for (const std::uint32_t block_size : {128u, 100u, 4096u}) {
    TwoSheets scene(block_size);
    std::vector<std::pair<std::shared_ptr<session::StemTap>, std::vector<float>>> stems;
    for (const auto sheet : kSheets)
      for (const auto kind : kKinds) stems.emplace_back(scene.session.open_stem(sheet, kind), std::vector<float>());
    scene.offer();
    const auto mix = scene.play([&] {
      for (auto& [tap, samples] : stems) drain(*tap, samples);
    });
    CHECK(mix == wanted);
    std::vector<float> sum(mix.size());
    for (const auto& [tap, samples] : stems) {
      CHECK(tap->first_sample == 0);
      REQUIRE(samples.size() == mix.size());
      for (std::size_t i = 0; i < sum.size(); ++i) sum[i] += samples[i];
    }
    CHECK(sum == mix);
    CHECK(peak(stems[0].second) > 1e-4f);
    CHECK(peak(stems[4].second) > 1e-4f);
    CHECK(peak(stems[2].second) == 0);
  }
}

TEST_CASE("A stem that nobody empties holds the sound up, and nothing of it is lost") {
  TwoSheets scene;
  const auto stem = scene.session.open_stem(8, SoundKind::kFriction);
  scene.offer();
  std::vector<float> mix, heard;
  session::AudioBlock block;
  for (int pass = 0; pass < 10; ++pass) {
    scene.session.render();
    while (scene.session.take_audio(128, block)) mix.insert(mix.end(), block.interleaved.begin(), block.interleaved.end());
  }
  CHECK_FALSE(scene.session.finished());
  CHECK(stem->audio.room() < 2 * kQuantum);
  const auto rest = scene.play([&] { drain(*stem, heard); });
  CHECK(heard.size() == mix.size() + rest.size());
}

TEST_CASE("A stem begins where it was opened; what is closed makes room for another") {
  TwoSheets scene;
  scene.offer();
  std::vector<float> all, late;
  const auto whole = scene.session.open_stem(3, SoundKind::kCrumpling);
  std::shared_ptr<session::StemTap> opened;
  int passes = 0;
  const auto mix = scene.play([&] {
    drain(*whole, all);
    if (++passes == 1) opened = scene.session.open_stem(3, SoundKind::kCrumpling);
    drain(*opened, late);
    for (std::size_t k = 1 + passes; k < session::kMostStems; ++k) {
      const auto brief = scene.session.open_stem(1, SoundKind::kTearing);
      if (brief) scene.session.close_stem(*brief);
    }
  });
  REQUIRE(passes > 1);
  REQUIRE(opened->first_sample);
  CHECK(*opened->first_sample > 0);
  REQUIRE(late.size() + 2 * static_cast<std::size_t>(*opened->first_sample) == mix.size());
  CHECK(std::equal(late.rbegin(), late.rend(), all.rbegin()));
}

TEST_CASE("So many stems at a time and no more, until some were given back") {
  TwoSheets scene;
  std::vector<std::shared_ptr<session::StemTap>> open;
  for (std::size_t k = 0; k < session::kMostStems; ++k)
    open.push_back(scene.session.open_stem(static_cast<sheet::SheetId>(k), SoundKind::kFriction));
  CHECK(std::ranges::all_of(open, [](const auto& stem) { return stem != nullptr; }));
  CHECK(scene.session.open_stem(99, SoundKind::kFriction) == nullptr);
  scene.session.close_stem(*open[5]);
  scene.session.close_stem(*open[63]);
  CHECK(scene.session.open_stem(99, SoundKind::kFriction) == nullptr);
  scene.session.render();
  CHECK(scene.session.open_stem(98, SoundKind::kFriction) != nullptr);
  CHECK(scene.session.open_stem(99, SoundKind::kFriction) != nullptr);
  CHECK(scene.session.open_stem(100, SoundKind::kFriction) == nullptr);
}

TEST_CASE("Opening, feeding and closing allocate and free nothing on the render worker") {
  TwoSheets scene;
  scene.offer();
  const auto kept = scene.session.open_stem(3, SoundKind::kCrumpling);
  auto brief = scene.session.open_stem(8, SoundKind::kFriction);
  const int opening = test_support::allocations_of([&] { scene.session.render(); });
  scene.session.close_stem(*brief);
  const std::weak_ptr<session::StemTap> watched = brief;
  brief.reset();
  const int closing = test_support::allocations_of([&] { scene.session.render(); });
  CHECK(opening == 0);
  CHECK(closing == 0);
  CHECK_FALSE(watched.expired());  // freed by the side that opened it
  session::AudioBlock block;
  scene.session.take_audio(128, block);
  CHECK(watched.expired());
}

TEST_CASE("Emitters of a session are heard whole, and closing them leaves nothing behind") {
  TwoSheets alone;
  alone.offer();
  const auto wanted = alone.play([] {});
  TwoSheets scene;
  auto tap = scene.session.open_emitters();
  REQUIRE(tap);
  scene.offer();
  struct Heard {
    std::int64_t next_sample = 0;
    bool ended = false;
  };
  std::map<std::uint64_t, Heard> heard;
  std::map<sheet::SheetId, int> quanta;
  float loudest = 0;
  const auto mix = scene.play([&] {
    for (session::EmitterQuantum quantum; tap->quanta.pop(quantum);) {
      auto [known, fresh] = heard.try_emplace(quantum.sound.id, Heard{quantum.first_sample, false});
      if (!known->second.ended) CHECK(quantum.first_sample == known->second.next_sample);
      known->second = {quantum.first_sample + kQuantum, quantum.sound.last};
      ++quanta[quantum.sheet];
      for (const float x : quantum.sound.samples) loudest = std::max(loudest, std::abs(x));
    }
  });
  CHECK(mix == wanted);
  CHECK(heard.size() > 3);
  CHECK(quanta[3] > 10);
  CHECK(quanta[8] > 10);
  CHECK(quanta.size() == 2);
  CHECK(loudest > 1e-3f);
  CHECK(scene.session.counters().emitter_samples_left_out == 0);
}

TEST_CASE("Emitters that are taken late are the same as those that are taken at once") {
  std::vector<std::pair<std::int64_t, std::uint64_t>> taken[2];
  for (const bool late : {false, true}) {
    TwoSheets scene;
    const auto tap = scene.session.open_emitters();
    scene.offer();
    int passes = 0;
    scene.play([&] {
      if (late && ++passes < 20) return;
      for (session::EmitterQuantum quantum; tap->quanta.pop(quantum);)
        taken[late ? 1 : 0].emplace_back(quantum.first_sample, quantum.sound.id);
    });
    for (session::EmitterQuantum quantum; tap->quanta.pop(quantum);)
      taken[late ? 1 : 0].emplace_back(quantum.first_sample, quantum.sound.id);
  }
  CHECK(taken[0].size() > 1000);
  CHECK(taken[0] == taken[1]);
}

TEST_CASE("Rendering emitters allocates nothing, opening and closing included") {
  TwoSheets scene;
  scene.offer();
  auto tap = scene.session.open_emitters();
  CHECK(test_support::allocations_of([&] { scene.session.render(); }) == 0);
  scene.session.close_emitters(*tap);
  tap.reset();
  CHECK(test_support::allocations_of([&] { scene.session.render(); }) == 0);
  CHECK(scene.session.open_emitters() != nullptr);
}

TEST_CASE("Taps are opened, fed and closed by two threads at once") {
  struct Tap {
    std::atomic<int> fed{0};
  };
  session::Taps<Tap> taps(4);
  std::atomic<bool> stop{false};
  std::thread render([&] {
    while (!stop) {
      taps.attend();
      for (const auto& tap : taps.open()) ++tap->fed;
    }
  });
  int served = 0;
  while (served < 2000) {
    auto tap = std::make_shared<Tap>();
    if (!taps.open(tap)) continue;
    while (tap->fed == 0) {
    }
    taps.close(*tap);
    ++served;
  }
  stop = true;
  render.join();
  CHECK(served == 2000);
}

}  // namespace taps_test
