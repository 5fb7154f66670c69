#include <catch2/catch.hpp>

#include <algorithm>
#include <cmath>

#include "client_sdk/sheets/demos.h"
#include "server/engine/ingest.h"
#include "server/engine/render.h"
#include "tests/support/animated_frames.h"

namespace engine_test {

namespace {

using namespace rustle;
using engine::CueBatch;
using engine::StreamItem;
using synthesis::kQuantum;

std::shared_ptr<pack::PackLibrary> packs() {
  static const auto library = std::make_shared<pack::PackLibrary>(std::vector<std::filesystem::path>{RUSTLE_BUILT_PACKS});
  return library;
}

scene::SceneUpdate table_and_wall() {
  scene::Obstacle table;
  table.id = 1;
  table.surface_material = "wooden-table";
  table.reflecting = true;
  table.shape = scene::PlaneShape{};
  scene::Obstacle wall = table;
  wall.id = 2;
  wall.pose = {{0, 0.8, 0}, Eigen::Quaterniond::FromTwoVectors(Eigen::Vector3d::UnitZ(), -Eigen::Vector3d::UnitY())};
  return {0, {table, wall}, {}, {}, {}};
}

std::vector<StreamItem> demo_stream(std::string_view name, double from_s, double to_s) {
  const auto sheet = sheets::make_demo(name, 446);
  const test_support::AnimatedFrames frames(*sheet);
  std::vector<StreamItem> items;
  items.emplace_back(engine::SheetDescription{1, "sheet", engine::SheetKind::kPaper, "", "", {}, {}});
  items.emplace_back(table_and_wall());
  for (int k = 0; from_s + k / 60.0 <= to_s; ++k) {
    auto frame = frames.at(from_s + k / 60.0);
    frame.time_s = k / 60.0;
    items.emplace_back(std::move(frame));
  }
  items.emplace_back(engine::End{});
  return items;
}

/// The whole mix. `eager`: rendered after every item as far as it goes; else everything is analysed before.
std::vector<float> play(const engine::Options& options, const std::vector<StreamItem>& items, bool eager = true) {
  engine::Ingest ingest(options, packs());
  engine::Render render(options);
  auto quantum = render.make_quantum();
  std::vector<float> mix;
  const auto render_batch = [&](const CueBatch& batch) {
    render.accept(batch);
    while (render.position() + kQuantum <= render.horizon() || (render.ending() && !render.complete())) {
      render.next(quantum);
      mix.insert(mix.end(), quantum.mix.begin(), quantum.mix.end());
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
  return mix;
}

float peak(const std::vector<float>& samples) {
  float most = 0;
  for (const float x : samples) most = std::max(most, std::abs(x));
  return most;
}

TEST_CASE("A demo sounds, finite and within bounds, whenever it is rendered") {
  const auto items = demo_stream("snap", 0.0, 1.5);
  const auto mix = play({}, items);
  CHECK(peak(mix) > 1e-3f);
  CHECK(peak(mix) <= 1.0f);
  CHECK(std::all_of(mix.begin(), mix.end(), [](float x) { return std::isfinite(x); }));
  CHECK(play({}, items, false) == mix);
}

TEST_CASE("Below what the mesh shows paper has events and cloth has not, unless told otherwise") {
  const auto cues_of = [](engine::SheetKind kind, std::optional<bool> fine_events) {
    engine::Options options;
    options.fine_events = fine_events;
    engine::Ingest ingest(options, packs());
    std::size_t units = 0;
    for (auto item : demo_stream("shake", 0.3, 1.3)) {
      if (auto* description = std::get_if<engine::SheetDescription>(&item)) description->kind = kind;
      CueBatch batch;
      REQUIRE(ingest.accept(item, batch));
      for (const auto& cue : batch.cues) units += std::holds_alternative<synthesis::CrumpleCue>(cue) ? 1 : 0;
    }
    return units;
  };
  const auto paper = cues_of(engine::SheetKind::kPaper, std::nullopt);
  const auto cloth = cues_of(engine::SheetKind::kCloth, std::nullopt);
  CHECK(cloth > 0);
  CHECK(paper > 2 * cloth);
  CHECK(cues_of(engine::SheetKind::kCloth, true) == paper);
  CHECK(cues_of(engine::SheetKind::kPaper, false) == cloth);
}

TEST_CASE("Turning the listener upside down swaps the channels, bit for bit") {
  for (const auto* name : {"snap", "slide"}) {
    auto items = demo_stream(name, 0.3, 1.6);
    scene::Listener listener{0, {0.4, -0.9, 0.6}, sheet::Vec3d(-0.3, 0.9, -0.5).normalized(), sheet::Vec3d::UnitZ()};
    items.insert(items.begin(), listener);
    const auto upright = play({}, items);
    listener.up = -listener.up;
    items.front() = listener;
    const auto turned = play({}, items);
    REQUIRE(upright.size() == turned.size());
    REQUIRE(peak(upright) > 1e-4f);
    bool swapped = true, alike = true;
    for (std::size_t i = 0; i < upright.size(); i += 2) {
      swapped &= upright[i] == turned[i + 1] && upright[i + 1] == turned[i];
      alike &= upright[i] == upright[i + 1];
    }
    CHECK(swapped);
    CHECK_FALSE(alike);
  }
}

TEST_CASE("Sound is promised behind the newest frame, as far as an advance says, and to the end") {
  const auto sheet = sheets::make_demo("shake", 183);
  const test_support::AnimatedFrames frames(*sheet);
  engine::Options options;
  options.look_ahead_s = 0.05;
  engine::Ingest ingest(options, packs());
  const auto horizon_after = [&](const StreamItem& item) {
    CueBatch batch;
    REQUIRE(ingest.accept(item, batch));
    return static_cast<double>(batch.horizon) / options.rate_hz;
  };
  const double quantum_s = static_cast<double>(kQuantum) / options.rate_hz;
  CHECK(horizon_after(engine::SheetDescription{1, "a", engine::SheetKind::kPaper, "", "", {}, {}}) == 0);
  CHECK(horizon_after(engine::SheetDescription{2, "b", engine::SheetKind::kPaper, "", "", {}, {}}) == 0);
  CHECK(horizon_after(frames.at(0.5)) == 0);  // the other sheet has not begun
  auto other = frames.at(0.3);
  other.sheet = 2;
  CHECK(horizon_after(other) == Approx(0.25).margin(quantum_s));
  CHECK(horizon_after(engine::Advance{0.4}) == Approx(0.4).margin(quantum_s));
  other.time_s = 0.41;
  CHECK(horizon_after(other) == Approx(0.4).margin(quantum_s));  // what was promised stays promised
  CueBatch last;
  REQUIRE(ingest.accept(engine::End{}, last));
  CHECK(last.end);
  CHECK(static_cast<double>(last.horizon) / options.rate_hz == Approx(0.5).margin(quantum_s));
}

TEST_CASE("What cannot be taken is refused with a remedy, and the session goes on") {
  engine::Ingest ingest({}, packs());
  CueBatch batch;
  const auto unknown = ingest.accept(engine::SheetDescription{7, "x", engine::SheetKind::kPaper, "lead", "", {}, {}}, batch);
  REQUIRE_FALSE(unknown);
  CHECK(unknown.error().cause == engine::Refusal::Cause::kUnknownMaterial);
  CHECK(unknown.error().message.find("lead") != std::string::npos);
  CHECK_FALSE(unknown.error().remedy.empty());

  const auto sheet = sheets::make_demo("bend", 183);
  const test_support::AnimatedFrames frames(*sheet, 7);
  CHECK_FALSE(ingest.accept(frames.at(0), batch));
  REQUIRE(ingest.accept(engine::SheetDescription{7, "x", engine::SheetKind::kPaper, "printer-paper", "", {}, {}}, batch));
  CHECK(ingest.accept(frames.at(0.1), batch));
  const auto repeated = ingest.accept(frames.at(0.1), batch);
  REQUIRE_FALSE(repeated);
  CHECK(repeated.error().cause == engine::Refusal::Cause::kTimeOrder);
  CHECK(ingest.accept(frames.at(0.2), batch));
}

}  // namespace

}  // namespace engine_test
