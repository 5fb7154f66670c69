#pragma once

#include <array>
#include <cstddef>
#include <span>
#include <vector>

#include "server/sheet/mesh_frame.h"
#include "server/synthesis/cue.h"
#include "server/synthesis/emitter_sounds.h"

namespace rustle::engine {

/// One quantum of rendered sound: the mix after the limiter, and every bus before it. Made once, filled again and again.
struct AudioQuantum {
  synthesis::SampleTime first_sample = 0;
  int channels = 0;
  std::vector<float> mix;                        ///< [kQuantum x channels], interleaved
  std::span<const sheet::SheetId> sheets;        ///< in the order of the buses; good until the next batch is accepted
  std::vector<std::vector<float>> stems;         ///< per bus, [kQuantum x channels] interleaved; empty unless asked for
  synthesis::EmitterSounds* emitters = nullptr;  ///< every emitter by itself, where given
};

}  // namespace rustle::engine
