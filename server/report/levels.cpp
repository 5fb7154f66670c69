#include "server/report/levels.h"

#include <algorithm>
#include <cassert>
#include <cmath>

namespace rustle::report {
namespace {

double power_db(double power) {
  return std::max(kSilenceDb, 10 * std::log10(std::max(power, 1e-30)));
}

}  // namespace

LevelTrack level_track(const Sound& sound, double window_s) {
  assert(window_s > 0);
  LevelTrack track;
  track.start_s = sound.start_s;
  track.window_s = window_s;
  const std::size_t frames = sound.frames(), channels = static_cast<std::size_t>(std::max(1, sound.channels));
  const double window_frames = std::max(1.0, window_s * sound.rate_hz);
  double total = 0, total_peak = 0;
  for (std::size_t window = 0, from = 0; from < frames; ++window) {
    const auto end = static_cast<std::size_t>(std::llround(static_cast<double>(window + 1) * window_frames));
    const std::size_t to = std::min(std::max(end, from + 1), frames);
    double power = 0, peak = 0;
    for (std::size_t i = from * channels; i < to * channels; ++i) {
      const double x = sound.samples[i];
      if (!std::isfinite(x)) {
        ++track.non_finite_samples;
        continue;
      }
      power += x * x;
      peak = std::max(peak, std::abs(x));
      track.full_scale_samples += std::abs(x) >= 1;
    }
    total += power;
    total_peak = std::max(total_peak, peak);
    track.rms_db.push_back(static_cast<float>(power_db(power / static_cast<double>((to - from) * channels))));
    track.peak_db.push_back(static_cast<float>(power_db(peak * peak)));
    from = to;
  }
  if (frames > 0) track.total_rms_db = power_db(total / static_cast<double>(frames * channels));
  track.total_peak_db = power_db(total_peak * total_peak);
  return track;
}

}  // namespace rustle::report
