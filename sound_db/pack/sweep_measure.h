#pragma once

#include <cstddef>
#include <functional>
#include <span>
#include <vector>

#include "sound_db/pack/friction_sweep.h"

namespace rustle::pack {

/// Clip spectra summed in power, speed by speed; several recordings may add to one (An et al. 2012, section 2: triangular
/// window; C1: averaged in power, for one clip's bins scatter by 5.6 dB).
class SweepMeasure {
 public:
  /// \pre rate_hz > 0; speeds rise and are above 0
  SweepMeasure(double rate_hz, std::vector<double> speeds_m_per_s);

  /// Adds the clips of a recording, half overlapping. A clip whose speed at its centre lies within `tolerance` of a wanted
  /// one counts there. `speed_at`: m/s at a time from the signal's start; `usable`: whether samples [begin, end) count.
  /// Returns how many clips counted.
  int add(std::span<const float> signal, const std::function<double(double)>& speed_at, double tolerance = 0.06,
          const std::function<bool(std::size_t, std::size_t)>& usable = {});

  /// Spectra of the speeds that at least `least_clips` clips were heard at, each at the mean of their speeds; the rest of
  /// the sweep is its default.
  FrictionSweep sweep(int least_clips = 1) const;

 private:
  struct Sum {
    std::vector<double> power;
    double speeds = 0;
    int clips = 0;
  };
  double rate_hz_;
  std::vector<double> wanted_;
  std::vector<Sum> sums_;  ///< [wanted]
};

/// Speeds in equal ratios. \pre 0 < slowest < fastest, count ≥ 2
std::vector<double> geometric_speeds(double slowest_m_per_s, double fastest_m_per_s, int count);

}  // namespace rustle::pack
