#pragma once

#include <algorithm>
#include <cstddef>
#include <memory>
#include <span>
#include <utility>
#include <vector>

#include "server/session/spsc_ring.h"

namespace rustle::session {

/// What somebody listens to beside the mix, opened and closed by the network thread while the render worker feeds it. A tap
/// is made and freed on the network thread; the render worker only moves it from ring to ring.
///
///   network ── opened, closed ──► render
///      ▲                            │
///      └──────── retired ───────────┘
///
/// Lock-free; the render side allocates nothing.
template <typename Tap>
class Taps {
 public:
  explicit Taps(std::size_t most) : most_(most), changes_(2 * most), retired_(most), fed_(most) {}

  // ---- [network thread]

  /// False: as many as there may be are open, or closed and not given back yet.
  bool open(std::shared_ptr<Tap> tap) {
    collect();
    if (held_ == most_) return false;
    ++held_;
    changes_.push({std::move(tap), nullptr});
    return true;
  }
  /// Frees what was given back.
  void collect() {
    for (std::shared_ptr<Tap> retired; retired_.pop(retired);) --held_;
  }
  /// \pre open, and not closed yet
  void close(const Tap& tap) { changes_.push({nullptr, &tap}); }

  // ---- [render worker]

  /// Takes in what was opened and closed.
  void attend() noexcept {
    for (Change change; changes_.pop(change);) {
      if (change.opened) {
        fed_[count_++] = std::move(change.opened);
        continue;
      }
      const auto end = fed_.begin() + static_cast<std::ptrdiff_t>(count_);
      const auto closed = std::find_if(fed_.begin(), end, [&](const auto& tap) { return tap.get() == change.closed; });
      if (closed == end) continue;
      retired_.push(std::move(*closed));
      *closed = std::move(fed_[--count_]);
    }
  }
  /// Those that are open, in no particular order.
  std::span<const std::shared_ptr<Tap>> open() const noexcept { return std::span(fed_).first(count_); }

 private:
  struct Change {
    std::shared_ptr<Tap> opened;
    const Tap* closed = nullptr;
  };

  const std::size_t most_;
  std::size_t held_ = 0;      // network thread
  SpscRing<Change> changes_;  // network thread → render worker
  SpscRing<std::shared_ptr<Tap>> retired_;
  std::vector<std::shared_ptr<Tap>> fed_;  // render worker
  std::size_t count_ = 0;
};

}  // namespace rustle::session
