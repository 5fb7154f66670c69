#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "server/sheet/mesh_frame.h"
#include "server/synthesis/cue.h"

namespace rustle::engine {

/// What one stream item asks of the render side: cues, then the promise that everything before `horizon` is complete.
/// Batches are applied in order; the samples depend on their sequence alone, not on who renders them when.
struct CueBatch {
  std::vector<synthesis::Cue> cues;
  synthesis::SampleTime horizon = 0;
  std::optional<sheet::SheetId> new_sheet;  ///< accepted with this item: the next one among the buses
  bool end = false;                         ///< nothing follows: after the horizon only tails sound
  synthesis::SampleTime accepted_at = 0;    ///< first sample that it takes part in; set by who hands it to the render side
  std::uint64_t frame = 0;                  ///< number of the frame it came of, by who hands it over; 0: of none
};

}  // namespace rustle::engine
