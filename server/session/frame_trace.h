#pragma once

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <vector>

#include "server/session/clock.h"
#include "server/session/duration_histogram.h"
#include "server/sheet/mesh_frame.h"

namespace rustle::session {

/// Where a frame passes on its way to sound, in this order.
enum class Station : std::uint8_t {
  kReceived,  ///< its message has come
  kDecoded,   ///< and has been offered to the session
  kBegun,     ///< analysis takes it
  kAnalysed,  ///< its cues are handed over
  kAccepted,  ///< the render side has them
  kSent,      ///< its first sample has left for the listeners, or the device
};
inline constexpr std::size_t kStations = 6;

/// One frame's way. Times are the session clock's.
struct FrameTrace {
  std::uint64_t frame = 0;     ///< its number among the frames offered to the session, from 1
  std::uint64_t sequence = 0;  ///< of its message; 0: unnumbered
  sheet::SheetId sheet = 0;
  double time_s = 0;                                    ///< simulation time
  std::int64_t first_sample = -1;                       ///< where its moment sounds; -1: not known yet
  double delay_s = 0;                                   ///< playout delay in force
  std::array<WallClock::Duration, kStations> passed{};  ///< 0: not yet
  const char* dropped = nullptr;                        ///< the cause, where that is how it ended

  WallClock::Duration at(Station station) const { return passed[static_cast<std::size_t>(station)]; }
};

/// How long frames took from station to station, and blocks to be rendered.
struct StageTimes {
  DurationHistogram decode;     ///< received to decoded [network thread]
  DurationHistogram wait;       ///< decoded to begun [analysis worker]
  DurationHistogram analysis;   ///< begun to analysed, refused frames included [analysis worker]
  DurationHistogram hand_over;  ///< analysed to accepted [render worker]
  DurationHistogram render;     ///< every time that the render worker made sound [render worker]
  DurationHistogram sound;      ///< received to sent, beyond the playout delay, of live sessions [network thread]
};

/// The newest frames of a session and when they passed where. Frames leave their mark from three threads; anyone may look.
/// Wait-free; allocates when made. A mark of a frame that is no longer kept is lost.
class FrameTraces {
 public:
  static constexpr std::size_t kKept = 1024;

  FrameTraces() : kept_(kKept) {}

  /// A frame has come. Returns its number. [network thread]
  std::uint64_t begin(std::uint64_t sequence, const sheet::MeshFrame& frame, WallClock::Duration received,
                      WallClock::Duration decoded) noexcept;
  /// Returns how long it took from the station before; negative: not kept. [whoever has the frame]
  WallClock::Duration pass(std::uint64_t frame, Station station, WallClock::Duration now) noexcept RUSTLE_NONBLOCKING;
  /// Where it sounds. Before it passes kAnalysed. [analysis worker]
  void place(std::uint64_t frame, std::int64_t first_sample, double delay_s) noexcept;
  /// It never sounds. `cause` lives for ever. [whoever has the frame]
  void drop(std::uint64_t frame, const char* cause) noexcept;
  /// Sound before `sample` has left: the frames whose first sample was among it pass kSent; those of a live session are
  /// added to `beyond_delay`, where it is given. [network thread]
  void sent(std::int64_t sample, WallClock::Duration now, DurationHistogram* beyond_delay) noexcept;

  /// Frames so far. [any thread]
  std::uint64_t count() const noexcept { return count_.load(std::memory_order_acquire); }
  /// The newest frames that are kept, the oldest first. [any thread]
  std::vector<FrameTrace> newest(std::size_t most = kKept) const;

 private:
  struct Kept {
    std::atomic<std::uint64_t> frame{0}, sequence{0};
    std::atomic<sheet::SheetId> sheet{0};
    std::atomic<double> time_s{0}, delay_s{0};
    std::atomic<std::int64_t> first_sample{-1};
    std::array<std::atomic<std::int64_t>, kStations> passed_ns{};
    std::atomic<const char*> dropped{nullptr};
  };
  Kept* find(std::uint64_t frame) noexcept {
    Kept& kept = kept_[frame % kKept];
    return frame != 0 && kept.frame.load(std::memory_order_acquire) == frame ? &kept : nullptr;
  }
  static std::atomic<std::int64_t>& at(Kept& kept, Station station) noexcept {
    return kept.passed_ns[static_cast<std::size_t>(station)];
  }

  std::vector<Kept> kept_;
  std::atomic<std::uint64_t> count_{0};
  std::uint64_t unsent_ = 1;  // network thread: all before it have been sent or dropped
};

}  // namespace rustle::session
