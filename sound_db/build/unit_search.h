#pragma once

#include <string>
#include <vector>

#include "sound_db/build/prepared_take.h"

namespace rustle::build {

/// A sound found in a crumpling recording.
struct FoundUnit {
  Segment segment;  ///< of the prepared take
  std::vector<float>
      clip;              ///< the same, its start faded over 0.5 ms, or over 5 ms where it was shortened, its end over 5 ms
  double peak_dbfs = 0;  ///< of the clip
  double above_noise_db = 0;  ///< its loudest window over the pauses between sounds
  std::string reason;         ///< why it is no unit; empty: it is
};

struct UnitSearch {
  double threshold_dbfs = 0;  ///< RMS in the window
  double noise_dbfs = 0;      ///< of the pauses
  std::vector<FoundUnit> units;
};

/// The flaps or clacs of a take. The threshold, where the take says none: 30 dB below the loudest window, but 6 dB above the
/// pauses, and 10 dB below the loudest window at most; in crumpling, between 40 and 6 dB below it, the one that yields most
/// clacs. A flap begins take.lead_s before its loudest sample at most, so that it snaps when the sheet does. Left out: what
/// is too short or too long for its class (several sounds at once), clipped, less than 10 dB above the pauses, or cut by the
/// border of the file or of the take's time. Pure.
UnitSearch find_units(const PreparedTake& prepared, const Take& take);

}  // namespace rustle::build
