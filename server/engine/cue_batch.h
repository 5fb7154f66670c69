#pragma once

#include <vector>

#include "server/synthesis/cue.h"

namespace rustle::engine {

/// What one stream item asks of the render side: cues, then the promise that everything before `horizon` is complete.
/// Batches are applied in order; the samples depend on their sequence alone, not on who renders them when.
struct CueBatch {
  std::vector<synthesis::Cue> cues;
  synthesis::SampleTime horizon = 0;
  bool end = false;  ///< nothing follows: after the horizon only tails sound
};

}  // namespace rustle::engine
