#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "server/spatial/dipole.h"
#include "server/synthesis/cue.h"
#include "server/synthesis/nonblocking.h"

namespace rustle::synthesis {

/// Overlapping blocks of sources of noise, each source by itself: a block is two hops long, the first of which is heard when
/// it is added. Everything is allocated by construction. [render worker]
class DryNoise {
 public:
  struct Source {
    std::uint64_t id = 0;
    Bus bus = 0;
    spatial::Emitter emitter;  ///< when its last block was added
    int hops_left = 0;         ///< that it is still heard; 0: free
  };

  /// Of twice as many sources as sound at a time: each is heard a hop longer. [control] \pre block_size is even
  DryNoise(int most, int block_size);

  /// Moves on by a hop.
  void next_hop() noexcept RUSTLE_NONBLOCKING;
  /// Where to add a block of a source; empty: there is no room.
  std::span<float> block(std::uint64_t id, Bus bus, const spatial::Emitter& emitter) noexcept RUSTLE_NONBLOCKING;

  std::span<const Source> sources() const noexcept RUSTLE_NONBLOCKING { return sources_; }
  /// The hop that is being heard.
  std::span<const float> heard(const Source& source) const noexcept RUSTLE_NONBLOCKING;

 private:
  std::size_t place_of(const Source& source) const noexcept {
    return static_cast<std::size_t>(&source - sources_.data()) * block_size_;
  }

  std::size_t block_size_;
  std::vector<Source> sources_;
  std::vector<float> sums_;  ///< [source][block_size_]
};

}  // namespace rustle::synthesis
