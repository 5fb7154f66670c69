#pragma once

#include <cstddef>
#include <limits>

namespace rustle::analysis {

/// How much is done for a frame where time is short. The default is all.
struct Effort {
  double partition_serves_s = 0;  ///< the partition serves for so long, however the sheet bends meanwhile
  std::size_t most_events = std::numeric_limits<std::size_t>::max();  ///< of a frame's flips the greatest, which sound for
                                                                      ///< all: Σ amplitude² stays
};

}  // namespace rustle::analysis
