#include <algorithm>
#include <catch2/catch.hpp>
#include <cmath>
#include <limits>

#include "client_sdk/sheets/demos.h"
#include "server/engine/ingest.h"
#include "server/engine/render.h"
#include "tests/support/animated_frames.h"

namespace control_test {

/// Gains and packs that are changed between the items of a stream.
namespace {

using namespace rustle;
using engine::CueBatch;
using engine::StreamItem;
using synthesis::Gain;
using synthesis::kQuantum;
using synthesis::SoundKind;

std::shared_ptr<pack::PackLibrary> packs() {
  static const auto library = std::make_shared<pack::PackLibrary>(std::vector<std::filesystem::path>{RUSTLE_BUILT_PACKS});
  return library;
}

/// Two sheets that slide over a table, with `control` given after the first second.
std::vector<StreamItem> two_sheets(const std::vector<StreamItem>& control) {
  const auto sheet = sheets::make_demo("slide", 183);
  const test_support::AnimatedFrames first(*sheet, 1), second(*sheet, 2);
  std::vector<StreamItem> items;
  for (const sheet::SheetId id : {1U, 2U})
    items.emplace_back(engine::SheetDescription{id, "sheet", engine::SheetKind::kPaper, "", "", {}, {}});
  scene::Obstacle table;
  table.id = 1;
  table.shape = scene::PlaneShape{};
  items.emplace_back(scene::SceneUpdate{0, {table}, {}, {}, {}});
  for (int k = 0; k < 120; ++k) {
    if (k == 60) items.insert(items.end(), control.begin(), control.end());
    items.emplace_back(first.at(k / 60.0));
    auto apart = second.at(k / 60.0);
    for (auto& position : apart.positions_m) position.y() += 1;
    items.emplace_back(std::move(apart));
  }
  items.emplace_back(engine::End{});
  return items;
}

struct Heard {
  std::vector<float> mix;
  std::vector<std::vector<float>> stems;  ///< by bus
};

/// `eager`: rendered after every item as far as it goes; else everything is analysed before.
Heard play(const std::vector<StreamItem>& items, bool eager = true, engine::Options options = {}) {
  options.stems = true;
  options.gain_db = -30;  // far below the limiter
  engine::Ingest ingest(options, packs());
  engine::Render render(options);
  auto quantum = render.make_quantum();
  Heard heard;
  heard.stems.resize(quantum.stems.size());
  const auto render_batch = [&](const CueBatch& batch) {
    render.accept(batch);
    while (render.position() + kQuantum <= render.horizon() || (render.ending() && !render.complete())) {
      render.next(quantum);
      heard.mix.insert(heard.mix.end(), quantum.mix.begin(), quantum.mix.end());
      for (std::size_t bus = 0; bus < quantum.stems.size(); ++bus)
        heard.stems[bus].insert(heard.stems[bus].end(), quantum.stems[bus].begin(), quantum.stems[bus].end());
    }
  };
  std::vector<CueBatch> batches;
  for (const auto& item : items) {
    CueBatch batch;
    REQUIRE(ingest.accept(item, batch));
    if (eager) {
      render_batch(batch);
    } else {
      batches.push_back(std::move(batch));
    }
  }
  for (const auto& batch : batches) render_batch(batch);
  return heard;
}

/// The level of a stretch of stereo sound.
double level_db(const std::vector<float>& interleaved, double from_s, double to_s) {
  double sum = 0;
  const auto from = static_cast<std::size_t>(from_s * 96000), to = static_cast<std::size_t>(to_s * 96000);
  for (std::size_t i = from; i < to; ++i) sum += static_cast<double>(interleaved[i]) * interleaved[i];
  return 10 * std::log10(sum / static_cast<double>(to - from) + 1e-30);
}

/// The same up to the order in which floats were added.
bool alike(const std::vector<float>& a, const std::vector<float>& b) {
  float loudest = 0, furthest = 0;
  for (std::size_t i = 0; i < std::min(a.size(), b.size()); ++i) {
    loudest = std::max(loudest, std::abs(a[i]));
    furthest = std::max(furthest, std::abs(a[i] - b[i]));
  }
  return a.size() == b.size() && furthest < 1e-5F * loudest;
}

TEST_CASE("Gains change the sounds they concern from the newest promise on, and no others") {
  const engine::GainChange change{{{-6, {}, {}, ""},
                                   {-5, 2, {}, ""},
                                   {3, {}, SoundKind::kFriction, ""},
                                   {-1, {}, {}, "printer-paper"},
                                   {-20, {}, {}, "banknote"}}};
  const auto plain = play(two_sheets({})), turned = play(two_sheets({change}));
  REQUIRE(plain.mix.size() == turned.mix.size());
  const auto friction_1 = synthesis::bus_of(0, SoundKind::kFriction),
             friction_2 = synthesis::bus_of(1, SoundKind::kFriction);
  REQUIRE(level_db(plain.stems[friction_1], 1.1, 1.9) > -110);
  const auto difference_db = [&](synthesis::Bus bus, double from_s, double to_s) {
    return level_db(turned.stems[bus], from_s, to_s) - level_db(plain.stems[bus], from_s, to_s);
  };
  CHECK(difference_db(friction_1, 1.0, 1.9) == Approx(-4).margin(0.01));
  CHECK(difference_db(friction_2, 1.0, 1.9) == Approx(-9).margin(0.01));
  // Sound was promised up to the newest frame less the look-ahead; nothing before it changes.
  const auto same = static_cast<std::ptrdiff_t>((59 / 60.0 - 0.05 - 0.002) * 96000);
  CHECK(std::equal(plain.mix.begin(), plain.mix.begin() + same, turned.mix.begin()));
  const auto eager_or_not = play(two_sheets({change}), false);
  CHECK((eager_or_not.mix == turned.mix));
}

TEST_CASE("A render's own gains hold always, on top of those that the stream changes") {
  engine::Options options;
  options.gains = {{-6, {}, SoundKind::kFriction, ""}};
  const auto bus = synthesis::bus_of(0, SoundKind::kFriction);
  const auto plain = play(two_sheets({})), turned = play(two_sheets({engine::GainChange{{{-3, 1, {}, ""}}}}), true, options);
  CHECK(level_db(turned.stems[bus], 0.2, 0.9) - level_db(plain.stems[bus], 0.2, 0.9) == Approx(-6).margin(0.01));
  CHECK(level_db(turned.stems[bus], 1, 1.9) - level_db(plain.stems[bus], 1, 1.9) == Approx(-9).margin(0.01));
}

TEST_CASE("A sheet's pack changes from the newest promise on; that of others does not") {
  const engine::PackChange change{2, "banknote", ""};
  const auto plain = play(two_sheets({})), changed = play(two_sheets({change}));
  const auto first = synthesis::bus_of(0, SoundKind::kFriction), second = synthesis::bus_of(1, SoundKind::kFriction);
  CHECK(alike(changed.stems[first], plain.stems[first]));
  CHECK_FALSE(alike(changed.stems[second], plain.stems[second]));
  const auto same = static_cast<std::ptrdiff_t>((59 / 60.0 - 0.05 - 0.002) * 96000);
  CHECK(std::equal(plain.stems[second].begin(), plain.stems[second].begin() + same, changed.stems[second].begin()));
  CHECK((play(two_sheets({change}), false).mix == changed.mix));
  // From then on it sounds as one that was of that material from the beginning, in level and colour if not in phase.
  auto always = two_sheets({});
  std::get<engine::SheetDescription>(always[1]).material = "banknote";
  const auto banknote = play(always);
  CHECK(level_db(changed.stems[second], 1.1, 1.9) == Approx(level_db(banknote.stems[second], 1.1, 1.9)).margin(0.7));
  // A gain for the material comes and goes with it.
  const engine::GainChange quiet{{{-20, {}, {}, "banknote"}}};
  const auto quieter = play(two_sheets({quiet, change}));
  CHECK(level_db(quieter.stems[second], 1.1, 1.9) - level_db(changed.stems[second], 1.1, 1.9) == Approx(-20).margin(0.01));
  CHECK(alike(quieter.stems[first], plain.stems[first]));
}

TEST_CASE("Packs that were read anew and are as before change nothing") {
  const auto plain = play(two_sheets({}));
  CHECK((play(two_sheets({engine::PackReload{}})).mix == plain.mix));
}

TEST_CASE("A change that cannot be made is refused with a remedy, and what was in force stays") {
  const auto refuse = [](const engine::PackChange& change) {
    engine::Ingest ingest({}, packs());
    CueBatch batch;
    REQUIRE(ingest.accept(engine::SheetDescription{1, "sheet", engine::SheetKind::kPaper, "", "", {}, {}}, batch));
    const auto taken = ingest.accept(change, batch);
    REQUIRE_FALSE(taken);
    CHECK_FALSE(taken.error().remedy.empty());
    CHECK(batch.cues.empty());
    return taken.error();
  };
  const auto sheet = refuse({7, "banknote", ""});
  CHECK(sheet.cause == engine::Refusal::Cause::kUnknownSheet);
  CHECK(sheet.field == "change_pack.sheet_id");
  const auto material = refuse({1, "lead", ""});
  CHECK(material.cause == engine::Refusal::Cause::kUnknownMaterial);
  CHECK(material.field == "change_pack.material");
  CHECK(material.remedy.find("banknote") != std::string::npos);
}

}  // namespace

TEST_CASE("A listener that is moved is heard from there on, looking at the sheets") {
  const auto plain = play(two_sheets({})), far = play(two_sheets({engine::ListenerMove{{0, -30, 10}}}));
  REQUIRE(plain.mix.size() == far.mix.size());
  CHECK(level_db(far.mix, 1.2, 1.9) < level_db(plain.mix, 1.2, 1.9) - 15);
  const auto same = static_cast<std::ptrdiff_t>((59 / 60.0 - 0.05 - 0.002) * 96000);
  CHECK(std::equal(plain.mix.begin(), plain.mix.begin() + same, far.mix.begin()));

  // As the stream would say it at the newest frame, but that it looks where the stream said before.
  scene::Listener told;
  told.time_s = 59 / 60.0;
  told.position_m = {0, -30, 10};
  CHECK((play(two_sheets({told})).mix == far.mix));
  told.position_m = {0, -1, 0.5};
  told.forward = sheet::Vec3d::UnitX();
  auto turned = told;
  turned.position_m = {0, -30, 10};
  CHECK((play(two_sheets({told, engine::ListenerMove{{0, -30, 10}}})).mix == play(two_sheets({told, turned})).mix));
}

}  // namespace control_test
