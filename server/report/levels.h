#pragma once

#include <cstddef>
#include <vector>

#include "server/report/sound_event.h"

namespace rustle::report {

inline constexpr double kSilenceDb = -120;  ///< levels below are shown as this

/// Levels in dBFS: 0 dB is a sample of magnitude 1, for RMS as for peak.
struct LevelTrack {
  double start_s = 0;
  double window_s = 0.020;
  std::vector<float> rms_db;   ///< [windows], power mean over the channels
  std::vector<float> peak_db;  ///< [windows], greatest magnitude of any channel
  double total_rms_db = kSilenceDb;
  double total_peak_db = kSilenceDb;
  std::size_t full_scale_samples = 0;  ///< of magnitude 1 or more
  std::size_t non_finite_samples = 0;  ///< NaN or infinite, counted as 0
};

/// Pure. One pass. \pre window_s > 0
LevelTrack level_track(const Sound& sound, double window_s = 0.020);

}  // namespace rustle::report
