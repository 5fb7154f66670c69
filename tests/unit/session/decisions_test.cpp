#include <catch2/catch.hpp>

#include <algorithm>
#include <atomic>
#include <map>
#include <set>

#include "client_sdk/sheets/demos.h"
#include "server/session/offline.h"
#include "server/session/session.h"
#include "server/session/settled_options.h"
#include "tests/support/animated_frames.h"

namespace decisions_test {

namespace {

using namespace rustle;

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

/// Packs on a disk of the test's own: as often as `version` grows, `reload` finds printer paper that is 6 dB louder.
struct Shelf {
  int version = 0;
  std::shared_ptr<pack::PackLibrary> packs = std::make_shared<pack::PackLibrary>(
      std::vector<std::filesystem::path>{RUSTLE_BUILT_PACKS},
      [this](const std::filesystem::path& folder, const pack::LoadOptions& options) -> pack::PackLibrary::Result {
        auto loaded = pack::load(folder, options);
        if (!loaded || (*loaded)->material != "printer-paper") return loaded;
        auto louder = std::make_shared<pack::SoundPack>(**loaded);
        const auto gain = static_cast<float>(1 << version);
        for (auto& unit : louder->crumpling->units)
          for (float& x : unit.samples) x *= gain;
        for (auto& spectrum : louder->friction->spectra)
          for (float& x : spectrum.magnitudes) x *= gain;
        return std::shared_ptr<const pack::SoundPack>(louder);
      });

  void change() {
    ++version;
    REQUIRE(packs->reload("", 48000));
  }
};

/// A whole number from 0 to below `bound`, the same in every run.
class Chance {
 public:
  explicit Chance(std::uint64_t seed) : state_(seed) {}
  std::uint64_t below(std::uint64_t bound) {
    state_ = state_ * 6364136223846793005ULL + 1442695040888963407ULL;
    return (state_ >> 33) % bound;
  }

 private:
  std::uint64_t state_;
};

/// A recorded session: what was offered, what was decided, and what sounded.
class Recorded {
 public:
  explicit Recorded(session::Clock clock_kind, std::uint32_t block_size = 0) {
    options_.clock = clock_kind;
    options_.record = true;
    options_.block_size = block_size;
    options_ = session::settled(options_);
    session_.emplace("s", options_, shelf_.packs, clock_);
  }

  void offer(const engine::StreamItem& item) {
    ++arrivals_;
    if (session_->offer(item, arrivals_ + 100, 1000, arrivals_) == session::Offer::kTaken) items_.emplace(arrivals_, item);
  }
  /// As the daemon does for what is asked by control.
  void ask(const engine::StreamItem& item) {
    if (std::holds_alternative<engine::PackReload>(item)) shelf_.change();
    REQUIRE(session_->offer(item, 0) == session::Offer::kTaken);
  }
  session::Session& session() { return *session_; }
  HandClock& clock() { return clock_; }
  std::uint64_t arrivals() const { return arrivals_; }

  void collect() {
    session::AudioBlock block;
    while (session_->take_audio(options_.block_size, block))
      sound_.insert(sound_.end(), block.interleaved.begin(), block.interleaved.end());
    for (auto& decision : session_->decisions().take()) decisions_.push_back(std::move(decision));
  }
  const std::vector<float>& sound() const { return sound_; }
  const std::vector<session::Decision>& decisions() const { return decisions_; }

  template <typename What>
  std::size_t steps() const {
    return static_cast<std::size_t>(std::count_if(decisions_.begin(), decisions_.end(), [](const auto& decision) {
      const auto* step = std::get_if<session::Step>(&decision);
      return step != nullptr && std::holds_alternative<What>(step->what);
    }));
  }

  /// The sound made anew from items and decisions.
  std::vector<float> again(int workers) const {
    std::vector<float> sound;
    std::size_t next = 0;
    Shelf shelf;
    session::OfflineEnds ends;
    ends.next_directed = [&]() -> std::optional<session::DirectedItem> {
      session::DirectedItem directed;
      for (; next < decisions_.size(); ++next) {
        if (const auto* mapping = std::get_if<engine::TimeMapping>(&decisions_[next])) directed.mapping = *mapping;
        if (const auto* rendered = std::get_if<session::RenderedTo>(&decisions_[next])) {
          ++next;
          return session::DirectedItem{*rendered, {}, {}, rendered->sample};
        }
        const auto* step = std::get_if<session::Step>(&decisions_[next]);
        if (step == nullptr) continue;
        directed.earliest = step->earliest;
        directed.accepted_at = step->accepted_at;
        directed.start_again = step->start_again;
        directed.what = session::FellQuiet{};
        if (const auto* given = std::get_if<session::Given>(&step->what)) directed.what = items_.at(given->arrival);
        if (std::holds_alternative<session::Ended>(step->what)) directed.what = engine::StreamItem(engine::End{});
        if (const auto* asked = std::get_if<session::Asked>(&step->what)) {
          directed.what = std::visit([](const auto& change) { return engine::StreamItem(change); }, *asked);
          if (std::holds_alternative<engine::PackReload>(*asked)) shelf.change();
        }
        ++next;
        return directed;
      }
      return std::nullopt;
    };
    ends.audio = [&](const engine::AudioQuantum& quantum) {
      sound.insert(sound.end(), quantum.mix.begin(), quantum.mix.end());
      return true;
    };
    session::render_offline(session::engine_options(options_), shelf.packs, workers, ends);
    return sound;
  }

 private:
  HandClock clock_;
  Shelf shelf_;
  session::SessionOptions options_;
  std::optional<session::Session> session_;
  std::map<std::uint64_t, engine::StreamItem> items_;
  std::uint64_t arrivals_ = 0;
  std::vector<float> sound_;
  std::vector<session::Decision> decisions_;
};

engine::SheetDescription described() {
  return {1, "sheet", engine::SheetKind::kPaper, "", "", {}, {}};
}

scene::SceneUpdate table() {
  scene::Obstacle obstacle;
  obstacle.id = 1;
  obstacle.shape = scene::PlaneShape{};
  return {0, {obstacle}, {}, {}, {}};
}

/// Four seconds of a sender whose frames come late, in bursts, not at all, and with a pause, on a machine that lets analysis
/// and rendering wait at random.
void play_unsteadily(Recorded& recorded, const std::string& motion, std::uint64_t seed,
                     std::multimap<int, engine::StreamItem> asked = {}) {
  const auto sheet = sheets::make_demo(motion, 446);
  const test_support::AnimatedFrames frames(*sheet);
  Chance chance(seed);
  recorded.offer(described());
  recorded.offer(table());
  std::multimap<int, double> arriving;  // millisecond of arrival, time of the frame
  for (int k = 0; k < 240; ++k) {
    const double t = k / 60.0;
    if (chance.below(100) == 0 || (t > 1.2 && t < 1.7)) continue;
    int at = static_cast<int>(t * 1000 + static_cast<double>(chance.below(30)));
    if (t > 2 && t < 2.2) at = 2200;  // all at once
    arriving.emplace(at, t);
  }
  double newest = -1;
  for (int millisecond = 0; millisecond < 4400; ++millisecond) {
    recorded.clock().advance(0.001);
    for (auto [frame, end] = arriving.equal_range(millisecond); frame != end; ++frame) {
      if (frame->second > newest) recorded.offer(frames.at(frame->second));
      newest = std::max(newest, frame->second);
    }
    for (auto [change, end] = asked.equal_range(millisecond); change != end; ++change) recorded.ask(change->second);
    const bool busy = millisecond > 3000 && millisecond < 3150;
    if (!busy && chance.below(4) == 0) recorded.session().analyse();
    if (chance.below(5) == 0 && recorded.session().render().wants_analysis && !busy) recorded.session().analyse();
    recorded.collect();
  }
}

void finish(Recorded& recorded) {
  for (int pass = 0; pass < 200 && !recorded.session().finished(); ++pass) {
    while (recorded.session().wants_analysis()) recorded.session().analyse();
    recorded.clock().advance(0.02);
    recorded.session().render();
    recorded.collect();
  }
  REQUIRE(recorded.session().finished());
  while (recorded.session().wants_analysis()) recorded.session().analyse();
  recorded.collect();
}

}  // namespace

TEST_CASE("A live session's items and decisions give its sound again, sample for sample") {
  const auto [motion, seed] = GENERATE(std::pair("slide", 1), std::pair("shake", 2), std::pair("snap", 3));
  Recorded recorded(session::Clock::kLive);
  play_unsteadily(recorded, motion, static_cast<std::uint64_t>(seed));
  recorded.session().end();
  finish(recorded);
  REQUIRE(*std::max_element(recorded.sound().begin(), recorded.sound().end()) > 1e-4f);
  const auto counters = recorded.session().counters();
  CHECK(counters.frames_dropped.at("backlog") > 3);
  CHECK(recorded.steps<session::FellQuiet>() > 0);
  CHECK(recorded.steps<session::Ended>() == 1);
  CHECK(recorded.steps<session::Given>() == counters.frames_analysed + 2);
  CHECK(recorded.again(1) == recorded.sound());
  CHECK(recorded.again(2) == recorded.sound());
}

TEST_CASE("Simulation time that begins anew under way is decided, and sounds the same again") {
  Recorded recorded(session::Clock::kLive);
  const auto sheet = sheets::make_demo("slide", 446);
  const test_support::AnimatedFrames frames(*sheet);
  recorded.offer(described());
  recorded.offer(table());
  for (int millisecond = 0; millisecond < 3000; ++millisecond) {
    recorded.clock().advance(0.001);
    if (millisecond % 20 == 0) {
      sheet::MeshFrame frame = frames.at(0.3 + millisecond % 1000 / 1000.0);
      frame.time_s = millisecond % 1500 / 1000.0 + (millisecond < 1500 ? 7 : 0);
      recorded.offer(frame);
    }
    while (recorded.session().wants_analysis()) recorded.session().analyse();
    if (millisecond % 3 == 0) recorded.session().render();
    recorded.collect();
  }
  recorded.session().end();
  finish(recorded);
  CHECK(recorded.session().counters().time_jumps == 1);
  CHECK(std::count_if(recorded.decisions().begin(), recorded.decisions().end(), [](const auto& decision) {
          const auto* step = std::get_if<session::Step>(&decision);
          return step != nullptr && step->start_again;
        }) == 1);
  const std::size_t half = recorded.sound().size() / 2;
  REQUIRE(*std::max_element(recorded.sound().begin() + static_cast<std::ptrdiff_t>(half), recorded.sound().end()) > 1e-4f);
  CHECK(recorded.again(1) == recorded.sound());
}

/// What a sound designer asks for at these milliseconds.
std::multimap<int, engine::StreamItem> changes() {
  using synthesis::SoundKind;
  return {{300, engine::GainChange{{{-12, 1, SoundKind::kFriction, ""}}}},
          {700, engine::PackChange{1, "banknote", ""}},
          {705, engine::GainChange{{{-12, 1, SoundKind::kFriction, ""}, {-3, {}, {}, "banknote"}}}},
          {1500, engine::PackChange{1, "printer-paper", ""}},
          {1700, engine::LoadLevel{2}},
          {2000, engine::LoadLevel{4}},
          {2190, engine::PackReload{}},
          {2400, engine::LoadLevel{}},
          {2600, engine::ListenerMove{{0.6, -0.3, 0.5}}},
          {2900, engine::PackReload{}},
          {3050, engine::GainChange{}}};
}

TEST_CASE("Gains and packs that change are decided at a step, and sound the same again") {
  const auto [motion, seed, block_size] =
      GENERATE(std::tuple("slide", 6, 128U), std::tuple("shake", 7, 512U), std::tuple("snap", 8, 64U));
  Recorded recorded(session::Clock::kLive, block_size);
  play_unsteadily(recorded, motion, static_cast<std::uint64_t>(seed), changes());
  recorded.session().end();
  finish(recorded);
  CHECK(recorded.steps<session::Asked>() == changes().size());
  CHECK(recorded.session().counters().items_refused == 0);
  const auto again = recorded.again(1);
  REQUIRE(again.size() == recorded.sound().size());
  CHECK(again == recorded.sound());
  CHECK(recorded.again(2) == recorded.sound());
}

TEST_CASE("Where among a simulation's items a gain or a pack changes settles every sample, whatever the block size") {
  const auto play = [](std::uint32_t block_size, int analyse_ahead) {
    auto recorded = std::make_unique<Recorded>(session::Clock::kSimulation, block_size);
    const auto sheet = sheets::make_demo("slide", 183);
    const test_support::AnimatedFrames frames(*sheet);
    recorded->offer(described());
    recorded->offer(table());
    auto asked = changes();
    for (int k = 0; k < 200; ++k) {
      for (auto change = asked.begin(); change != asked.end() && change->first <= k * 1000 / 60;) {
        recorded->ask(change->second);
        while (recorded->session().wants_analysis()) recorded->session().analyse();  // packs are read when it comes
        change = asked.erase(change);
      }
      recorded->offer(frames.at(k / 60.0));
      if (k % analyse_ahead == 0) {
        while (recorded->session().wants_analysis()) recorded->session().analyse();
        recorded->session().render();
      }
      recorded->collect();
    }
    recorded->offer(engine::End{});
    finish(*recorded);
    return recorded;
  };
  const auto small = play(64, 1), large = play(1024, 7);
  REQUIRE(*std::max_element(small->sound().begin(), small->sound().end()) > 1e-4f);
  CHECK(small->steps<session::Asked>() == changes().size());
  CHECK(large->sound() == small->sound());
  CHECK(small->again(1) == small->sound());
  CHECK(small->again(2) == small->sound());
}

TEST_CASE("A live session frees a pack that was replaced, away from the render worker") {
  HandClock clock;
  Shelf shelf;
  auto held = shelf.packs->load("printer-paper", "wooden-table", 48000).value();
  const std::weak_ptr<const pack::SoundPack> old = held;
  session::Session live("live", {}, shelf.packs, clock);
  REQUIRE(live.offer(described(), 1, 10, 1) == session::Offer::kTaken);
  REQUIRE(live.offer(table(), 2, 10, 2) == session::Offer::kTaken);
  const auto sheet = sheets::make_demo("slide", 183);
  const test_support::AnimatedFrames frames(*sheet);
  session::AudioBlock block;
  double gone_at_s = 0;
  for (int k = 0; k < 720; ++k) {
    if (k == 1) held.reset();
    if (k == 60) {
      shelf.change();
      REQUIRE(live.offer(engine::PackReload{}, 0) == session::Offer::kTaken);
    }
    sheet::MeshFrame frame = frames.at(k % 120 / 60.0);
    frame.time_s = k / 60.0;
    frame.reset_history = k % 120 == 0;
    REQUIRE(live.offer(std::move(frame), static_cast<std::uint64_t>(k) + 3) == session::Offer::kTaken);
    while (live.wants_analysis()) live.analyse();
    clock.advance(1 / 60.0);
    const bool there = !old.expired();
    live.render();
    CHECK(old.expired() == !there);
    while (live.take_audio(128, block)) {
    }
    if (k <= 60) REQUIRE(there);
    if (!there && gone_at_s == 0) gone_at_s = k / 60.0;
  }
  CHECK(gone_at_s > 2);
  CHECK(gone_at_s < 10);
}

TEST_CASE("Every message is either given to the engine or dropped, and told once") {
  Recorded recorded(session::Clock::kLive);
  play_unsteadily(recorded, "shake", 4);
  recorded.session().end();
  finish(recorded);
  std::multiset<std::uint64_t> told;
  for (const auto& decision : recorded.decisions()) {
    if (const auto* dropped = std::get_if<session::Dropped>(&decision)) {
      CHECK(dropped->cause == "backlog");
      CHECK(dropped->sequence == dropped->arrival + 100);
      told.insert(dropped->arrival);
    }
    const auto* step = std::get_if<session::Step>(&decision);
    if (const auto* given = step == nullptr ? nullptr : std::get_if<session::Given>(&step->what))
      told.insert(given->arrival);
  }
  CHECK(told.size() == recorded.arrivals());
  for (std::uint64_t arrival = 1; arrival <= recorded.arrivals(); ++arrival) CHECK(told.count(arrival) == 1);
}

TEST_CASE("What a recording that is stopped says to be settled is what sounded") {
  Recorded recorded(session::Clock::kLive);
  play_unsteadily(recorded, "slide", 5);
  const std::size_t heard = recorded.sound().size();
  recorded.session().decisions().want_rendered();
  REQUIRE(recorded.session().wants_analysis());
  recorded.session().analyse();
  recorded.collect();
  REQUIRE(std::holds_alternative<session::RenderedTo>(recorded.decisions().back()));
  const auto again = recorded.again(1);
  CHECK(again.size() >= heard);
  REQUIRE(again.size() <= recorded.sound().size() + 2 * 2 * synthesis::kQuantum);
  const auto common = static_cast<std::ptrdiff_t>(std::min(again.size(), recorded.sound().size()));
  CHECK(std::equal(again.begin(), again.begin() + common, recorded.sound().begin()));
  // Told once, and only when asked.
  recorded.session().analyse();
  CHECK(recorded.session().decisions().take().empty());
}

TEST_CASE("The decisions of a simulation session change nothing about it") {
  Recorded recorded(session::Clock::kSimulation);
  const auto sheet = sheets::make_demo("snap", 183);
  const test_support::AnimatedFrames frames(*sheet);
  recorded.offer(described());
  for (int k = 0; k < 90; ++k) {
    recorded.offer(frames.at(k / 60.0));
    while (recorded.session().wants_analysis()) recorded.session().analyse();
    recorded.session().render();
    recorded.collect();
  }
  recorded.offer(engine::End{});
  finish(recorded);
  REQUIRE(*std::max_element(recorded.sound().begin(), recorded.sound().end()) > 1e-4f);
  CHECK(recorded.again(1) == recorded.sound());
}

TEST_CASE("Nothing is kept of a session that is not recorded") {
  HandClock clock;
  session::Session live("live", {}, packs(), clock);
  REQUIRE(live.offer(described(), 1, 10, 1) == session::Offer::kTaken);
  while (live.analyse()) {
  }
  clock.advance(0.1);
  CHECK_FALSE(live.render().wants_analysis);
  live.analyse();
  CHECK(live.decisions().take().empty());
}

}  // namespace decisions_test
