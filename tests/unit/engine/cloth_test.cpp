#include <catch2/catch.hpp>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "client_sdk/sheets/cloth_motion.h"
#include "server/engine/ingest.h"
#include "server/engine/render.h"
#include "server/session/offline.h"
#include "tests/support/animated_frames.h"

namespace rustle::engine::cloth_tests {
namespace {

using synthesis::kQuantum;
using synthesis::SampleTime;

constexpr int kFrames = 240;  // the demo's strokes

std::shared_ptr<pack::PackLibrary> packs() {
  static const auto library = std::make_shared<pack::PackLibrary>(std::vector<std::filesystem::path>{RUSTLE_BUILT_PACKS});
  return library;
}

scene::SceneUpdate on(const std::string& surface) {
  scene::Obstacle table;
  table.id = 1;
  table.surface_material = surface;
  table.shape = scene::PlaneShape{};
  return {0, {table}, {}, {}, {}};
}

std::vector<StreamItem> rubbed(const std::string& material, const std::string& surface = "wooden-table") {
  const auto cloth = sheets::make_cloth_demo(446);
  const test_support::AnimatedFrames frames(*cloth);
  std::vector<StreamItem> items;
  items.emplace_back(engine::SheetDescription{1, "cloth", engine::SheetKind::kCloth, material, "", {}, {}});
  items.emplace_back(on(surface));
  for (int k = 0; k < kFrames; ++k) items.emplace_back(frames.at(k / 60.0));
  return items;
}

engine::Options mono() {
  engine::Options options;
  options.layout = engine::Layout::kMono;
  return options;
}

/// As `rustle render` does it.
std::vector<float> offline(const engine::Options& options, std::vector<StreamItem> items, int workers) {
  std::vector<float> mix;
  std::size_t next = 0;
  session::OfflineEnds ends;
  ends.next = [&]() -> std::optional<StreamItem> {
    if (next == items.size()) return std::nullopt;
    return items[next++];
  };
  ends.audio = [&](const engine::AudioQuantum& quantum) {
    mix.insert(mix.end(), quantum.mix.begin(), quantum.mix.end());
    return true;
  };
  session::render_offline(options, packs(), workers, ends);
  return mix;
}

/// As a live session does it: a frame each 800 samples, heard `delay` samples after it came.
std::vector<float> live(const engine::Options& options, const std::vector<StreamItem>& items, SampleTime delay) {
  engine::Ingest ingest(options, packs());
  engine::Render render(options);
  auto quantum = render.make_quantum();
  std::vector<float> mix;
  const auto render_to = [&](SampleTime sample) {
    while (render.position() + kQuantum <= sample) {
      render.next(quantum);
      mix.insert(mix.end(), quantum.mix.begin(), quantum.mix.end());
    }
  };
  ingest.map_time({0, delay, 48000, 0});
  SampleTime now = 0;
  for (const StreamItem& item : items) {
    render_to(now);
    ingest.set_rendered(render.position());
    CueBatch batch;
    REQUIRE(ingest.accept(item, batch));
    render.accept(batch);
    if (std::holds_alternative<sheet::MeshFrame>(item)) now += 800;
  }
  render_to(now);
  return mix;
}

double rms(const std::vector<float>& x) {
  double sum = 0;
  for (const float s : x) sum += static_cast<double>(s) * s;
  return std::sqrt(sum / static_cast<double>(std::max<std::size_t>(1, x.size())));
}

TEST_CASE("Cloth is the same live and offline, but for the delay that it declares") {
  for (const auto* material : {"cotton", "polyester"}) {
    const auto items = rubbed(material);
    engine::Ingest declared(mono(), packs());
    CueBatch batch;
    REQUIRE(declared.accept(items.front(), batch));
    INFO(material << " " << static_cast<double>(declared.latency()) / 48000 << " s");
    CHECK(declared.latency() > 0);
    CHECK(static_cast<double>(declared.latency()) / 48000 <= 0.110);
    // A playout delay of 40 ms, up to the next quantum.
    const SampleTime delay = (declared.latency() + 1920 + kQuantum - 1) / kQuantum * kQuantum;
    const auto whole = offline(mono(), items, 1), heard = live(mono(), items, delay);
    REQUIRE(rms(whole) > 1e-4);
    // What is heard before the last frames, which offline are the end.
    const auto settled = static_cast<std::ptrdiff_t>(heard.size()) - 2 * delay;
    REQUIRE(settled > 48000);
    CHECK(std::all_of(heard.begin(), heard.begin() + delay, [](float x) { return x == 0; }));
    CHECK(std::equal(heard.begin() + delay, heard.begin() + delay + settled, whole.begin()));
  }
}

TEST_CASE("Cloth does not depend on who renders it") {
  const auto items = rubbed("corduroy");
  const auto alone = offline(mono(), items, 1);
  CHECK(rms(alone) > 1e-4);
  CHECK(offline(mono(), items, 2) == alone);
}

TEST_CASE("A simulation's horizon waits for cloth, and an advance does not") {
  engine::Ingest ingest(mono(), packs());
  CueBatch batch;
  for (const StreamItem& item : rubbed("cotton")) {
    batch = {};
    REQUIRE(ingest.accept(item, batch));
  }
  const SampleTime newest = (kFrames - 1) * 800;
  CHECK(batch.horizon <= newest - 2400);
  CHECK(batch.horizon >= newest - ingest.latency() - kQuantum);
  batch = {};
  REQUIRE(ingest.accept(engine::Advance{newest / 48000.0}, batch));
  CHECK(batch.horizon == newest / kQuantum * kQuantum);
}

TEST_CASE("Cloth on cloth of another material sounds of both packs") {
  const auto pieces_of = [](const std::string& surface) {
    engine::Ingest ingest(mono(), packs());
    std::map<std::string, std::size_t> heard;
    const auto cotton = packs()->load("cotton", "", 48000), nylon = packs()->load("windbreaker", "", 48000);
    for (const StreamItem& item : rubbed("cotton", surface)) {
      CueBatch batch;
      REQUIRE(ingest.accept(item, batch));
      for (const auto& cue : batch.cues) {
        const auto* piece = std::get_if<synthesis::ClothPieceCue>(&cue);
        if (piece == nullptr) continue;
        for (const auto& pack : {*cotton, *nylon}) {
          for (const auto& recording : pack->cloth->recordings) {
            const auto& samples = recording.channels[0];
            if (piece->samples >= samples.data() && piece->samples < samples.data() + samples.size())
              heard[pack->material] += piece->count;
          }
        }
      }
    }
    return heard;
  };
  auto mixed = pieces_of("windbreaker"), plain = pieces_of("wooden-table");
  CHECK(mixed["cotton"] > 48000);
  CHECK(mixed["windbreaker"] > 48000);
  CHECK(plain["cotton"] > 48000);
  CHECK(plain["windbreaker"] == 0);
}

}  // namespace
}  // namespace rustle::engine::cloth_tests
