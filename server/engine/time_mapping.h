#pragma once

#include <algorithm>
#include <cmath>

#include "server/synthesis/cue.h"

namespace rustle::engine {

/// Where simulation time lies on the sample axis:
///   sample = first_sample + (time_s - first_time_s) · samples_per_s
/// Plain data: what a live session decides and its recording stores. \pre samples_per_s > 0
struct TimeMapping {
  double first_time_s = 0;
  synthesis::SampleTime first_sample = 0;
  double samples_per_s = 48000;
  double playout_delay_s = 0;  ///< that was in force when it was made; not part of the formula

  /// In samples, unrounded, within ±1e17.
  double position(double time_s) const {
    return std::clamp(static_cast<double>(first_sample) + (time_s - first_time_s) * samples_per_s, -1e17, 1e17);
  }
  double time_s(double sample) const { return first_time_s + (sample - static_cast<double>(first_sample)) / samples_per_s; }

  bool operator==(const TimeMapping&) const = default;
};

}  // namespace rustle::engine
