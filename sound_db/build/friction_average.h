#pragma once

#include <vector>

#include "sound_db/build/prepared_take.h"
#include "sound_db/build/speed_track.h"

namespace rustle::build {

/// Sums over the blocks of slides at one grid point. With P_b a block's power spectrum, sine window, normalised so that
/// white noise of unit variance gives 1, and v_b its speed, the mean spectrum at the reference speed v₀ is
///   M² = Σ_b P_b / Σ_b (v_b/v₀)^2e          (e the speed exponent; fast blocks count more, as they stand out of the noise)
struct FrictionSum {
  std::vector<double> power;  ///< [fft_size/2 + 1]; empty: no block yet
  double weight = 0;
  int blocks = 0;
  FrictionSum& operator+=(const FrictionSum& other);
};

/// M of at least kLeastBlocks blocks. Few blocks are smoothed over neighbouring bins until each is the mean of 64 values.
std::vector<float> mean_spectrum(const FrictionSum& sum);
inline constexpr int kLeastBlocks = 2;

struct FrictionBlocks {
  FrictionSum sum;
  double threshold_dbfs = 0;  ///< RMS at the reference speed that a block must reach
  double kept_s = 0, quiet_s = 0, slow_s = 0, clipped_s = 0;
  double from_s = 0, to_s = 0;  ///< in the file, from the first kept block to the end of the last
  double level_dbfs = 0;        ///< RMS of the kept blocks
};

/// Blocks of fft_size samples, half overlapping. Left out: the clipped, those slower than a twentieth of the track's
/// fastest, and those that are threshold_db (20 if the take says nothing) quieter than the loudest tenth, speed allowed for.
/// Pure.
/// \pre fft_size a multiple of 4
FrictionBlocks average_friction(const PreparedTake& prepared, const Take& take, const SpeedTrack& speed, int fft_size,
                                double reference_speed_m_per_s, double speed_exponent);

}  // namespace rustle::build
