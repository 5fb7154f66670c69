#pragma once

#include <array>

#include "server/spatial/listener.h"

namespace rustle::spatial {

enum class Layout { kMono, kStereo, kBinaural };
inline constexpr int kMaxChannels = 2;

constexpr int channel_count(Layout layout) noexcept {
  return layout == Layout::kMono ? 1 : 2;
}

/// A microphone: its pattern is scale · (1 + shape cos φ), φ the angle between its axis and the direction of the sound.
struct Receiver {
  Vec3 position_m;
  Vec3 axis{1, 0, 0};
  double shape = 0;  ///< 0: the same from everywhere, 1: cardioid
  double scale = 1;
};

/// The listener's receivers, one per channel.
///   mono      a point at the listener's position
///   stereo    left, right: 8.5 cm to either side along the right axis, cardioids turned 55° outward (ORTF), scaled so that
///             a source straight ahead has the mono level in both
///   binaural  both a point at the head's centre; the ears' delays and filters are Hrtf's
/// Negating the listener's `up` swaps the two of stereo exactly.
std::array<Receiver, kMaxChannels> receivers(const Listener& listener, Layout layout) noexcept;

}  // namespace rustle::spatial
