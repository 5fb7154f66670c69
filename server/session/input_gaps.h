#pragma once

#include <algorithm>
#include <atomic>
#include <cstdint>
#include <limits>

#include "server/synthesis/cue.h"
#include "server/synthesis/nonblocking.h"

namespace rustle::session {

/// Sound of a live session that was due before anything was heard of it.
///
///   analysis ── covered ──► render: gaps, samples, and when the sender has fallen quiet
///
/// Wait-free.
class InputGaps {
 public:
  struct Figures {
    std::uint64_t gaps = 0;     ///< stretches without news
    std::uint64_t samples = 0;  ///< in them
  };

  /// \param quiet_samples after so many in a gap the sender is taken to have fallen quiet
  explicit InputGaps(synthesis::SampleTime quiet_samples) : quiet_samples_(quiet_samples) {}

  /// Input reaches to sample `newest`; what is known there carries on to `until` before news is missed. [analysis worker]
  void cover(synthesis::SampleTime newest, synthesis::SampleTime until) noexcept RUSTLE_NONBLOCKING {
    newest_.store(newest, std::memory_order_relaxed);
    until_.store(until, std::memory_order_release);
  }
  /// Nothing is to come: no gap. [analysis worker]
  void cover_all() noexcept RUSTLE_NONBLOCKING { cover(kForEver, kForEver); }

  /// Sound up to `position` has been rendered. True, once a gap: the sender has fallen quiet. [render worker]
  bool rendered(synthesis::SampleTime position) noexcept RUSTLE_NONBLOCKING {
    const synthesis::SampleTime until = until_.load(std::memory_order_acquire);
    const synthesis::SampleTime newest = newest_.load(std::memory_order_relaxed);
    if (position <= until) {
      counted_to_ = kNone;
      quiet_ = false;
      return false;
    }
    if (counted_to_ == kNone) {
      ++figures_.gaps;
      began_ = counted_to_ = std::min(newest, position);
    }
    figures_.samples += static_cast<std::uint64_t>(position - counted_to_);
    counted_to_ = position;
    if (quiet_ || position - began_ < quiet_samples_) return false;
    return quiet_ = true;
  }

  Figures figures() const noexcept RUSTLE_NONBLOCKING { return figures_; }  // [render worker]

 private:
  static constexpr synthesis::SampleTime kForEver = std::numeric_limits<synthesis::SampleTime>::max();
  static constexpr synthesis::SampleTime kNone = -1;

  const synthesis::SampleTime quiet_samples_;
  std::atomic<synthesis::SampleTime> newest_{kForEver}, until_{kForEver};
  // render worker
  synthesis::SampleTime counted_to_ = kNone, began_ = 0;
  bool quiet_ = false;
  Figures figures_;
};

}  // namespace rustle::session
