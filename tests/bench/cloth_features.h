#pragma once

#include <vector>

#include "bench.h"
#include "sound_db/dsp/random.h"
#include "sound_db/dsp/unit_features.h"

namespace rustle::bench {

/// Row cloth/features: features of all units of a second of sound at 48 kHz, filtered over time (C3), as when a pack is
/// measured. Goal: at most 0.005 s per second of sound on one core.
inline void bench_cloth_features(const Options& options, Report& report) {
  constexpr int kRate_hz = 48000, kUnit = 200;
  constexpr std::size_t kSeconds = 4;
  constexpr double kGoal_s_per_s = 0.005;
  dsp::Random random(1);
  std::vector<float> sound(kSeconds * kRate_hz);
  for (float& x : sound) x = static_cast<float>(0.05 * random.normal());
  const std::vector<int> widths = {20, 50, 10};
  const std::vector<std::uint32_t> whole = {0, static_cast<std::uint32_t>(sound.size() / kUnit)};
  Timings timings;
  double sum = 0;
  const int runs = std::max(5, options.frames / 10);
  for (int run = 0; run < runs; ++run) {
    timings.run([&] {
      const auto raw = dsp::unit_features(sound, kUnit, kRate_hz);
      for (const bool causal : {true, false}) {
        sum += static_cast<double>(dsp::filtered_features(raw, dsp::kUnitFeatures, widths, whole, causal).back());
      }
    });
  }
  if (!std::isfinite(sum)) std::abort();
  Row row;
  row.name = "cloth/features";
  row.count = kRate_hz / kUnit;
  row.counted = "units";
  row.median_us = timings.median_us() / kSeconds;
  row.p95_us = timings.quantile_us(0.95) / kSeconds;
  row.mean_us = timings.mean_us() / kSeconds;
  report.add(row);
  report.goal("cloth/features: s of work per s of sound", 1e-6 * row.median_us, kGoal_s_per_s);
}

}  // namespace rustle::bench
