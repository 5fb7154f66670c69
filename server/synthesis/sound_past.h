#pragma once

#include <algorithm>
#include <bit>
#include <cstddef>
#include <span>
#include <vector>

#include "server/synthesis/cue.h"
#include "server/synthesis/nonblocking.h"

namespace rustle::synthesis {

/// A source's own sound, quantum after quantum, and its past as far as the longest path reaches. Allocates when made and
/// nowhere else. [render worker]
class SoundPast {
 public:
  /// Keeps `samples` and more. [control]
  explicit SoundPast(SampleTime samples) : ring_(std::bit_ceil(static_cast<std::size_t>(samples) + kQuantum)) {}

  /// Samples before the newest quantum that are kept.
  SampleTime reach() const noexcept RUSTLE_NONBLOCKING { return static_cast<SampleTime>(ring_.size()) - kQuantum; }
  void clear() noexcept RUSTLE_NONBLOCKING { std::ranges::fill(ring_, 0.0F); }

  /// The quantum's samples, to be filled: it becomes the newest. \pre quantum_start is a multiple of kQuantum
  std::span<float> quantum(SampleTime quantum_start) noexcept RUSTLE_NONBLOCKING {
    return std::span(ring_).subspan(static_cast<std::size_t>(quantum_start) & (ring_.size() - 1), kQuantum);
  }

  /// Copies samples from `from` on. \pre within `reach` of the end of the newest quantum
  void read(SampleTime from, std::span<float> out) const noexcept RUSTLE_NONBLOCKING {
    const std::size_t mask = ring_.size() - 1;
    auto at = static_cast<std::size_t>(from) & mask;
    for (float& sample : out) {
      sample = ring_[at];
      at = (at + 1) & mask;
    }
  }

 private:
  std::vector<float> ring_;  ///< of a power of two: sample n is at n modulo its size
};

}  // namespace rustle::synthesis
