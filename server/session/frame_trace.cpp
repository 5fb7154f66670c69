#include "server/session/frame_trace.h"

#include <algorithm>

namespace rustle::session {

std::uint64_t FrameTraces::begin(std::uint64_t sequence, const sheet::MeshFrame& frame, WallClock::Duration received,
                                 WallClock::Duration decoded) noexcept {
  const std::uint64_t number = count_.load(std::memory_order_relaxed) + 1;
  Kept& kept = kept_[number % kKept];
  kept.frame.store(0, std::memory_order_release);  // not to be found while it changes
  kept.sequence.store(sequence, std::memory_order_relaxed);
  kept.sheet.store(frame.sheet, std::memory_order_relaxed);
  kept.time_s.store(frame.time_s, std::memory_order_relaxed);
  kept.delay_s.store(0, std::memory_order_relaxed);
  kept.first_sample.store(-1, std::memory_order_relaxed);
  for (auto& passed : kept.passed_ns) passed.store(0, std::memory_order_relaxed);
  kept.dropped.store(nullptr, std::memory_order_relaxed);
  at(kept, Station::kReceived).store(received.count(), std::memory_order_relaxed);
  at(kept, Station::kDecoded).store(decoded.count(), std::memory_order_relaxed);
  kept.frame.store(number, std::memory_order_release);
  count_.store(number, std::memory_order_release);
  return number;
}

WallClock::Duration FrameTraces::pass(std::uint64_t frame, Station station, WallClock::Duration now) noexcept {
  Kept* kept = find(frame);
  if (kept == nullptr) return WallClock::Duration(-1);
  at(*kept, station).store(now.count(), std::memory_order_release);
  const auto before = static_cast<Station>(static_cast<std::uint8_t>(station) - 1);
  return now - WallClock::Duration(at(*kept, before).load(std::memory_order_acquire));
}

void FrameTraces::place(std::uint64_t frame, std::int64_t first_sample, double delay_s) noexcept {
  Kept* kept = find(frame);
  if (kept == nullptr) return;
  kept->delay_s.store(delay_s, std::memory_order_relaxed);
  kept->first_sample.store(first_sample, std::memory_order_release);
}

void FrameTraces::drop(std::uint64_t frame, const char* cause) noexcept {
  if (Kept* kept = find(frame)) kept->dropped.store(cause, std::memory_order_release);
}

void FrameTraces::sent(std::int64_t sample, WallClock::Duration now, DurationHistogram* beyond_delay) noexcept {
  const std::uint64_t newest = count_.load(std::memory_order_relaxed);
  unsent_ = std::max(unsent_, newest >= kKept ? newest - kKept + 1 : 1);
  bool all_before = true;
  for (std::uint64_t frame = unsent_; frame <= newest; ++frame) {
    Kept& kept = kept_[frame % kKept];
    bool done = kept.dropped.load(std::memory_order_acquire) != nullptr || at(kept, Station::kSent).load() != 0;
    if (!done && at(kept, Station::kAnalysed).load(std::memory_order_acquire) != 0 &&
        kept.first_sample.load(std::memory_order_acquire) < sample) {
      at(kept, Station::kSent).store(now.count(), std::memory_order_release);
      if (beyond_delay != nullptr) {
        const double delay_ns = 1e9 * kept.delay_s.load(std::memory_order_relaxed);
        beyond_delay->add(now - WallClock::Duration(at(kept, Station::kReceived).load(std::memory_order_relaxed)) -
                          WallClock::Duration(static_cast<std::int64_t>(delay_ns)));
      }
      done = true;
    }
    all_before &= done;
    if (all_before) unsent_ = frame + 1;
  }
}

std::vector<FrameTrace> FrameTraces::newest(std::size_t most) const {
  std::vector<FrameTrace> out;
  const std::uint64_t newest = count();
  const std::uint64_t wanted = std::min<std::uint64_t>({most, kKept, newest});
  for (std::uint64_t frame = newest - wanted + 1; frame <= newest; ++frame) {
    const Kept& kept = kept_[frame % kKept];
    FrameTrace trace;
    trace.frame = frame;
    if (kept.frame.load(std::memory_order_acquire) != frame) continue;
    trace.sequence = kept.sequence.load(std::memory_order_relaxed);
    trace.sheet = kept.sheet.load(std::memory_order_relaxed);
    trace.time_s = kept.time_s.load(std::memory_order_relaxed);
    trace.first_sample = kept.first_sample.load(std::memory_order_acquire);
    trace.delay_s = kept.delay_s.load(std::memory_order_relaxed);
    for (std::size_t k = 0; k < kStations; ++k)
      trace.passed[k] = WallClock::Duration(kept.passed_ns[k].load(std::memory_order_acquire));
    trace.dropped = kept.dropped.load(std::memory_order_acquire);
    if (kept.frame.load(std::memory_order_acquire) == frame) out.push_back(trace);  // else it has made room meanwhile
  }
  return out;
}

}  // namespace rustle::session
