#pragma once

#include <cstdint>

#include "server/sheet/vector.h"

/// Instructions from the synthesis plan (analysis side) to the synthesis render (audio side). Plain data of fixed size:
/// they cross a single-producer single-consumer queue. What they point to outlives them (the planner retains it).
namespace rustle::synthesis {

/// Samples since the session's time origin, at the session's rate.
using SampleTime = std::int64_t;

/// Rendering goes in quanta on the absolute sample grid, so that no block size can change a sample.
inline constexpr int kQuantum = 64;

enum class SoundKind : std::uint8_t { kCrumpling, kFriction, kTearing };
inline constexpr int kSoundKinds = 3;

}  // namespace rustle::synthesis
