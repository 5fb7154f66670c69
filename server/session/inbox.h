#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "server/engine/stream_item.h"
#include "server/session/clock.h"
#include "server/session/sequence_window.h"

namespace rustle::session {

/// What became of an item offered to a session.
enum class Offer : std::uint8_t {
  kTaken,
  kFull,   ///< the inbox holds Inbox::kMessages or Inbox::kBytes: the sender ignores its credit
  kEnded,  ///< the stream has ended before
};

/// What a session has been sent and has not analysed yet, in the order in which it is to be.
///
/// On the simulation clock: as it came, bounded. On the live clock the sender cannot be slowed down, so
///   a number of the sequence is missing    what comes after it waits a moment for it (the reorder wait)
///   a frame came before ("duplicate")      its sheet has been at its very time, or its number is one that has come
///   a frame is older than its sheet's newest and fills a missing number or has none    "reordered", dropped
///   a frame or the scene steps back by more than half a second, in sequence            the sender's time begins anew
///   three frames of a sheet wait and a fourth comes, or bytes are short                the oldest is dropped, "backlog"
/// Frames received = taken + Σ dropped + waiting, always. Not thread-safe: the session guards it.
class Inbox {
 public:
  static constexpr std::size_t kMessages = 4096;
  static constexpr std::size_t kBytes = std::size_t{128} << 20;  ///< as received; twice what a flow credit allows
  static constexpr std::size_t kBacklogFrames = 3;
  static constexpr double kStepBack_s = 0.5;

  struct Waiting {
    engine::StreamItem item;
    std::uint64_t sequence = 0;  ///< 0: unnumbered
    std::size_t bytes = 0;
    std::uint64_t arrival = 0;  ///< by which decisions name it
    WallClock::Duration arrived{};
    bool steps_back = false;  ///< set by take()
    std::uint64_t frame = 0;  ///< its number in FrameTraces; 0: no frame
  };
  struct Lost {
    std::uint64_t arrival, sequence;
    bool is_frame;
    const char* cause;
    std::uint64_t frame = 0;  ///< as of Waiting
  };

  explicit Inbox(bool live) : live_(live) {}

  [[nodiscard]] Offer offer(Waiting incoming);
  /// A message of this number has come that is no item.
  void pass_over(std::uint64_t sequence);
  /// The next item; nothing where none waits, or where the next must wait for a missing number until its `arrived` +
  /// `reorder_wait`.
  std::optional<Waiting> take(WallClock::Duration now, WallClock::Duration reorder_wait);
  /// When take() has something; absent: nothing waits.
  std::optional<WallClock::Duration> ready_at(WallClock::Duration reorder_wait) const;
  void discard();

  bool empty() const { return waiting_.empty(); }
  /// When what is next came; absent: nothing waits.
  std::optional<WallClock::Duration> next_arrived() const {
    return waiting_.empty() ? std::nullopt : std::optional(waiting_.front().arrived);
  }
  bool ended() const { return ended_; }
  /// Numbers of the sequence that have not come.
  std::uint64_t sequence_gaps() const { return sequence_.missing(); }
  /// What was dropped since the last call.
  std::vector<Lost> take_lost();

 private:
  /// What has a time order of its own: a sheet's frames, or the scene (kScene).
  using Track = std::int64_t;
  static constexpr Track kScene = -1;
  struct Moment {
    Track track;
    double time_s;
  };
  static std::optional<Moment> moment_of(const Waiting& waiting);
  static const sheet::MeshFrame* frame_of(const Waiting& waiting) { return std::get_if<sheet::MeshFrame>(&waiting.item); }
  bool came_before(const sheet::MeshFrame& frame, SequenceWindow::Arrival arrival) const;
  void make_room(const Waiting& incoming);
  void drop(std::deque<Waiting>::iterator waiting, const char* cause);

  const bool live_;
  std::deque<Waiting> waiting_;
  std::size_t bytes_ = 0;
  bool ended_ = false;
  SequenceWindow sequence_;
  std::map<Track, double> taken_s_;   ///< the newest time of each
  std::uint64_t taken_sequence_ = 0;  ///< the greatest
  std::vector<Lost> lost_;
};

}  // namespace rustle::session
