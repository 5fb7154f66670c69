#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <utility>

#include "server/session/spsc_ring.h"
#include "server/sheet/mesh_frame.h"
#include "server/synthesis/emitter_sounds.h"

namespace rustle::session {

/// One emitter in one quantum: synthesis::EmitterSound with what the network thread needs beside it.
struct EmitterQuantum {
  std::int64_t first_sample = 0;
  sheet::SheetId sheet = 0;
  synthesis::EmitterSound sound;
};

/// Every emitter of a session by itself, on the way from the render worker to the network thread.
struct EmitterTap {
  explicit EmitterTap(std::unique_ptr<synthesis::EmitterSounds> its_sounds)
      : sounds(std::move(its_sounds)), quanta(kQuanta) {}

  static constexpr std::size_t kQuanta = 64 * synthesis::kMostEmitters;

  const std::unique_ptr<synthesis::EmitterSounds> sounds;  // render worker
  SpscRing<EmitterQuantum> quanta;
};

}  // namespace rustle::session
