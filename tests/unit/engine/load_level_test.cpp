#include <algorithm>
#include <catch2/catch.hpp>
#include <cmath>

#include "client_sdk/sheets/motions.h"
#include "server/engine/ingest.h"
#include "server/engine/render.h"
#include "tests/support/animated_frames.h"

namespace load_level_test {

/// What a session does without at each load level.
namespace {

using namespace rustle;
using synthesis::kQuantum;

constexpr double kFrames_per_s = 60;
constexpr int kFrames = 240;

std::shared_ptr<pack::PackLibrary> packs() {
  static const auto library = std::make_shared<pack::PackLibrary>(std::vector<std::filesystem::path>{RUSTLE_BUILT_PACKS});
  return library;
}

struct Heard {
  std::vector<float> mix;
  std::size_t crumplings = 0, joined = 0, most_in_frame = 0;
  double squares_m2 = 0;  ///< Σ amplitude²
  std::uint64_t merged = 0;
  std::uint64_t stolen = 0;  ///< voices
};

/// A sheet that is shaken all the time, at `level` from the beginning and at `later` from the middle on.
Heard play(std::uint32_t level, std::uint32_t later) {
  sheets::ShakeOptions shake;
  shake.wave.start_s = 0;
  shake.wave.end_s = shake.duration_s = kFrames / kFrames_per_s;
  const sheets::RectangleSize size;
  const auto sheet =
      sheets::make_shake(sheets::make_rectangle(sheets::MeshKind::kDelaunay, size.width_m, size.height_m, 1333, 1), shake);
  const test_support::AnimatedFrames frames(*sheet);
  engine::Options options;
  options.gain_db = -30;
  engine::Ingest ingest(options, packs());
  engine::Render render(options);
  auto quantum = render.make_quantum();
  Heard heard;
  const auto give = [&](const engine::StreamItem& item) {
    engine::CueBatch batch;
    const auto seen = ingest.accept(item, batch);
    REQUIRE(seen);
    if (*seen) {
      heard.crumplings += (*seen)->crumpling.size();
      heard.joined += (*seen)->events_joined;
      heard.most_in_frame = std::max(heard.most_in_frame, (*seen)->crumpling.size());
      for (const auto& event : (*seen)->crumpling) heard.squares_m2 += event.amplitude_m * event.amplitude_m;
    }
    render.accept(batch);
    while (render.position() + kQuantum <= render.horizon() || (render.ending() && !render.complete())) {
      render.next(quantum);
      heard.mix.insert(heard.mix.end(), quantum.mix.begin(), quantum.mix.end());
    }
  };
  give(engine::SheetDescription{1, "sheet", engine::SheetKind::kPaper, "", "", {}, {}});
  give(engine::LoadLevel{level});
  for (int k = 0; k < kFrames; ++k) {
    if (k == kFrames / 2) give(engine::LoadLevel{later});
    give(frames.at(k / kFrames_per_s));
  }
  give(engine::End{});
  heard.merged = ingest.counters().voices_merged;
  heard.stolen = render.counters().voices_stolen;
  return heard;
}

double level_db(const std::vector<float>& mix, double from_s, double to_s) {
  double sum = 0;
  const auto from = static_cast<std::size_t>(from_s * 96000), to = static_cast<std::size_t>(to_s * 96000);
  for (std::size_t i = from; i < to; ++i) sum += static_cast<double>(mix[i]) * static_cast<double>(mix[i]);
  return 10 * std::log10(sum / static_cast<double>(to - from) + 1e-30);
}

TEST_CASE("Each load level spares what it says, and the sheet is heard as loud") {
  const auto full = play(0, 0);
  REQUIRE(full.stolen == 0);
  REQUIRE(full.most_in_frame >= 2);
  const double full_db = level_db(full.mix, 0.5, 4);

  const auto merged = play(1, 1);
  CHECK(merged.crumplings == full.crumplings);
  CHECK(static_cast<double>(merged.merged) > 1.5 * static_cast<double>(full.merged));
  CHECK(level_db(merged.mix, 0.5, 4) == Approx(full_db).margin(1.5));

  const auto fewer_voices = play(2, 2);
  CHECK(fewer_voices.stolen > 0);
  CHECK(level_db(fewer_voices.mix, 0.5, 4) == Approx(full_db).margin(2));

  for (const std::uint32_t level : {3U, 4U}) {
    const auto fewer_events = play(level, level);
    CHECK(fewer_events.most_in_frame == 1);
    CHECK(fewer_events.stolen > fewer_voices.stolen);
    CHECK(fewer_events.crumplings + fewer_events.joined == full.crumplings);
    CHECK(fewer_events.squares_m2 == Approx(full.squares_m2).epsilon(1e-6));
    CHECK(level_db(fewer_events.mix, 0.5, 4) == Approx(full_db).margin(3));
  }
}

TEST_CASE("Full quality comes back with level 0, and nothing is lost on the way up or down") {
  const auto full = play(0, 0), relieved = play(4, 0), overloaded = play(0, 4);
  CHECK(relieved.most_in_frame == full.most_in_frame);
  CHECK(relieved.mix.size() > 0);
  CHECK(std::all_of(relieved.mix.begin(), relieved.mix.end(), [](float x) { return std::isfinite(x); }));
  CHECK(relieved.crumplings + relieved.joined == full.crumplings);
  CHECK(overloaded.crumplings + overloaded.joined == full.crumplings);
  // What was promised before the level changed is as it was.
  const auto same = static_cast<std::ptrdiff_t>((kFrames / 2 / kFrames_per_s - 0.1) * 96000);
  CHECK(std::equal(full.mix.begin(), full.mix.begin() + same, overloaded.mix.begin()));
  // A second after it is back, full quality sounds as if nothing had been.
  CHECK(level_db(relieved.mix, 3, 4) == Approx(level_db(full.mix, 3, 4)).margin(1.5));
}

}  // namespace

}  // namespace load_level_test
