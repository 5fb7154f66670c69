#pragma once

#include <cstdint>
#include <optional>

#include "server/session/spsc_ring.h"
#include "server/sheet/mesh_frame.h"
#include "server/synthesis/cue.h"

namespace rustle::session {

/// One sheet's sound of one kind on its way from the render worker to the network thread. Silent until the sheet is there.
struct StemTap {
  /// Holds `capacity` samples of all channels together.
  StemTap(sheet::SheetId its_sheet, synthesis::SoundKind its_kind, std::size_t capacity)
      : sheet(its_sheet), kind(its_kind), audio(capacity) {}

  const sheet::SheetId sheet;
  const synthesis::SoundKind kind;
  SampleRing audio;                          ///< interleaved
  std::optional<std::int64_t> first_sample;  ///< set before anything is in the ring: where what it held first begins
  std::optional<synthesis::Bus> bus;         // render worker
};

}  // namespace rustle::session
