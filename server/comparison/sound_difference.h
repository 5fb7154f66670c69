#pragma once

#include <cstddef>
#include <span>
#include <vector>

/// Two sounds of the same motion held against each other, from their first sample on.
namespace rustle::comparison {

/// Level in a band a third of an octave wide, in dBFS.
struct BandLevels {
  double centre_hz = 0, reference_db = 0, other_db = 0;
};

struct SoundDifference {
  bool identical = false;                 ///< as long, and every sample the same
  double reference_db = 0, other_db = 0;  ///< RMS of the whole, dBFS
  double window_s = 0.02;                 ///< of the level tracks
  std::vector<double> reference_track_db, other_track_db;
  double level_correlation = 1;         ///< of the level tracks where either sounds; 1 where both are silent or steady
  double mean_level_difference_db = 0;  ///< of the sizes of differences, where either sounds
  double reference_centroid_hz = 0, other_centroid_hz = 0;
  std::vector<BandLevels> bands;  ///< 50 Hz to 16 kHz, as far as the rate carries them
  double mean_band_difference_db =
      0;  ///< of the sizes, after levels are made equal, in bands less than 40 dB below the loudest
};

/// "Either sounds" means: within 60 dB of the louder sound's loudest window. A shorter sound ends in silence.
/// \pre rate_hz > 0
[[nodiscard]] SoundDifference compare_sounds(std::span<const float> reference, std::span<const float> other, double rate_hz);

}  // namespace rustle::comparison
