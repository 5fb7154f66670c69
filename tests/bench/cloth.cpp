#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "bench.h"
#include "client_sdk/sheets/cloth_motion.h"
#include "cloth_features.h"
#include "server/engine/ingest.h"
#include "server/engine/render.h"
#include "server/synthesis/cloth/unit_selector.h"
#include "sound_db/dsp/random.h"
#include "tests/support/animated_frames.h"

namespace rustle::bench {
namespace {

constexpr int kRate_hz = 48000;

/// Features like those of two minutes of cloth after another, filtered over time: they wander about a mean.
std::vector<float> wander(std::size_t units, std::uint64_t seed) {
  dsp::Random random(seed);
  std::vector<float> out;
  std::array<double, 3> at{};
  for (std::size_t i = 0; i < units; ++i) {
    for (double& x : at) {
      x = 0.98 * x + 0.3 * random.normal();
      out.push_back(static_cast<float>(x));
    }
  }
  return out;
}

/// Row cloth/selection: choices for a second of target, 240 units, among 54,000 units with a look-ahead of 10, live. Goal: a
/// hundredth of real time on one core (C5).
void bench_selection(const Options& options, Report& report) {
  constexpr std::size_t kUnits = 54'000, kSecond = 240;
  const auto database = wander(kUnits, 1), target = wander(12 * kSecond, 2);
  const auto index =
      std::make_shared<const cloth::UnitIndex>(cloth::FeatureRows{database}, cloth::SelectionRules{10, 2.0, 20});
  cloth::UnitSelector selector(index);
  Timings timings;
  std::size_t chosen = 0;
  const int runs = std::clamp(options.frames / 10, 10, 1000);
  for (int run = 0; run < runs; ++run) {
    const std::size_t first = static_cast<std::size_t>(run) % 12 * kSecond;
    timings.run([&] {
      for (std::size_t i = first; i < first + kSecond; ++i)
        chosen += selector.push(std::span(target).subspan(3 * i, 3)).has_value() ? 1 : 0;
    });
  }
  if (chosen == 0) std::abort();
  Row row;
  row.name = "cloth/selection";
  row.count = kUnits;
  row.counted = "units";
  row.median_us = timings.median_us();
  row.p95_us = timings.quantile_us(0.95);
  row.mean_us = timings.mean_us();
  report.add(row);
  report.goal_at_least("cloth/selection: times real time", 1e6 / row.mean_us, 100);
}

/// Cloth that is rubbed to and fro, of which one vertex in ten touches the table.
std::vector<sheet::MeshFrame> rubbed(std::size_t triangles, std::size_t& touching) {
  const auto cloth = sheets::make_rubbed_cloth(
      sheets::make_rectangle(sheets::MeshKind::kDelaunay, sheets::kClothWidth_m, sheets::kClothHeight_m, triangles, 1));
  const test_support::AnimatedFrames frames(*cloth);
  const auto& material = cloth->mesh().material_coordinates;
  std::vector<sheet::MeshFrame> out;
  for (int k = 0; k < static_cast<int>(60 * sheets::kRubbingPeriod_s); ++k) {
    out.push_back(frames.at(k / 60.0));
    for (std::size_t v = 0; v < material.size(); ++v) {
      const double raised = sheets::smooth_step((material[v][0] - 0.12 * sheets::kClothWidth_m) / 0.03);
      out.back().positions_m[v].z() =
          static_cast<float>(0.25 * out.back().positions_m[v].z() * (1 - raised) +
                             raised * (0.02 + static_cast<double>(out.back().positions_m[v].z())));
    }
  }
  touching =
      static_cast<std::size_t>(std::ranges::count_if(out.front().positions_m, [](const auto& p) { return p.z() < 0.003F; }));
  return out;
}

/// Row cloth/pipeline: a second of cloth from mesh frames to sound, analysis included. Goal: faster than real time on one
/// core at 5,000 triangles and 60 frames a second, one contact in ten.
void bench_pipeline(const Options& options, Report& report) {
  const std::size_t triangles = options.triangles > 0 ? static_cast<std::size_t>(options.triangles) : 5000;
  std::size_t touching = 0;
  const auto loop = rubbed(triangles, touching);
  engine::Options engine_options;
  engine_options.default_material = "cotton";
  auto packs = std::make_shared<pack::PackLibrary>(std::vector<std::filesystem::path>{RUSTLE_BUILT_PACKS});
  if (!packs->find("cotton")) {
    report.note("cloth/pipeline: there is no pack of cotton; build the target rustle_packs");
    return;
  }
  engine::Ingest ingest(engine_options, packs);
  engine::Render render(engine_options);
  auto quantum = render.make_quantum();
  double energy = 0;
  const auto take = [&](const engine::StreamItem& item) {
    engine::CueBatch batch;
    if (!ingest.accept(item, batch)) std::abort();
    render.accept(batch);
    while (render.position() + synthesis::kQuantum <= render.horizon()) {
      render.next(quantum);
      for (const float x : quantum.mix) energy += static_cast<double>(x) * x;
    }
  };
  take(engine::SheetDescription{1, "cloth", engine::SheetKind::kCloth, "", "", {}, {}});
  scene::Obstacle table;
  table.id = 1;
  table.surface_material = "wooden-table";
  table.shape = scene::PlaneShape{};
  take(scene::SceneUpdate{0, {table}, {}, {}, {}});
  Timings timings;
  const int seconds = std::clamp(options.frames / 60, 4, 60);
  for (int second = -1; second < seconds; ++second) {
    const auto play = [&] {
      for (int k = 0; k < 60; ++k) {
        const int number = 60 * (second + 1) + k;
        sheet::MeshFrame frame = loop[static_cast<std::size_t>(number) % loop.size()];
        frame.time_s = number / 60.0;
        take(frame);
      }
    };
    if (second < 0) {
      play();  // warming up
    } else {
      timings.run(play);
    }
  }
  if (!(energy > 0)) std::abort();
  Row row;
  row.name = "cloth/pipeline";
  row.count = triangles;
  row.median_us = timings.median_us();
  row.p95_us = timings.quantile_us(0.95);
  row.mean_us = timings.mean_us();
  report.add(row);
  report.note(fmt::format("cloth/pipeline: {} of {} vertices touch", touching, loop.front().positions_m.size()));
  report.goal("cloth/pipeline: s of work per s of sound", 1e-6 * row.mean_us, 1);
}

}  // namespace
}  // namespace rustle::bench

/// Cloth: features, selection, the whole pipeline.
int main(int argc, char** argv) {
  const auto options = rustle::bench::read_options(argc, argv);
  rustle::bench::Report report(options);
  rustle::bench::bench_cloth_features(options, report);
  rustle::bench::bench_selection(options, report);
  rustle::bench::bench_pipeline(options, report);
  return report.finish();
}
