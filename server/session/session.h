#pragma once

#include <atomic>
#include <cstdint>
#include <deque>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include "server/engine/ingest.h"
#include "server/engine/render.h"
#include "server/session/clock.h"
#include "server/session/decision_log.h"
#include "server/session/session_options.h"
#include "server/session/spsc_ring.h"
#include "sound_db/pack/library.h"

namespace rustle::session {

/// Figures of a session. frames_received = frames_analysed + Σ frames_dropped + frames still waiting, always.
struct Counters {
  std::uint64_t items_received = 0;
  std::uint64_t frames_received = 0;
  std::uint64_t frames_analysed = 0;
  std::map<std::string, std::uint64_t> frames_dropped;  ///< by cause
  std::uint64_t items_refused = 0;
  std::uint64_t crumpling_events = 0;
  std::uint64_t friction_episodes = 0;
  std::uint64_t tear_events = 0;
  double newest_time_s = 0;
  synthesis::PlanCounters plan;
  engine::RenderCounters render;
  std::uint64_t samples_due = 0;  ///< that the session's clock has called for, tails of an ended stream included
};

/// What became of an item offered to a session.
enum class Offer : std::uint8_t {
  kTaken,
  kFull,   ///< the inbox holds Session::kInboxMessages or Session::kInboxBytes: the sender ignores its credit
  kEnded,  ///< the stream has ended before
};

/// What analysis tells the network thread.
struct Refused {
  engine::Refusal why;
  std::uint64_t sequence;
};
struct Analysed {  ///< everything up to this sequence has been taken from the inbox
  std::uint64_t sequence;
};
using Outcome = std::variant<observation::Observation, Refused, Analysed>;

/// A stretch of finished sound.
struct AudioBlock {
  std::int64_t first_sample = 0;
  int channels = 0;
  std::vector<float> interleaved;
  bool last = false;  ///< the stream ends with it
};

/// One simulator's stream on its way to sound. Three threads meet here; each method says whose it is.
///
///   network ── inbox ──► analysis ── cue batches ──► render ── samples ──► network
///      ▲                    │  outcomes                 (retired batches go back to analysis)
///      └────────────────────┘
class Session {
 public:
  /// `hrtf`: the head that options.hrtf names, where the sound is binaural.
  Session(std::string id, SessionOptions options, std::shared_ptr<pack::PackLibrary> packs, const WallClock& clock,
          const std::shared_ptr<const spatial::Hrtf>& hrtf = nullptr);

  const std::string& id() const { return id_; }
  const SessionOptions& options() const { return options_; }  ///< as in force: nothing left at 0

  // ---- [network thread]

  static constexpr std::size_t kInboxMessages = 4096;
  static constexpr std::size_t kInboxBytes = std::size_t{128} << 20;  ///< as received; twice what a flow credit allows

  /// Takes an item that came in `bytes`. In a live session frames beyond the backlog budget, or beyond the inbox's bytes,
  /// push out the oldest waiting ones.
  /// `arrival`: the number of its message in the order of arrival, by which decisions name it; 0: it came in none.
  [[nodiscard]] Offer offer(engine::StreamItem item, std::uint64_t sequence, std::size_t bytes = 0,
                            std::uint64_t arrival = 0);
  /// What the sound depends on besides what is offered. Kept from the beginning where options().record says so.
  DecisionLog& decisions() { return decisions_; }
  /// Counts frames that were refused before they became items.
  void count_drop(const std::string& cause, std::uint64_t frames = 1);
  /// Drops what waits, counted.
  void discard();
  /// Something has been offered that analysis has not finished with.
  bool waiting() const;
  /// Ends the stream as an End item would, once.
  void end();
  std::vector<Outcome> take_outcomes();
  /// Moves finished sound into `block`, as many whole blocks of `samples` as asked; the last may be shorter.
  /// False: not enough yet.
  bool take_audio(std::size_t samples, AudioBlock& block);
  /// The whole stream was taken.
  bool finished() const { return finished_; }
  Counters counters() const;
  /// Simulation time of a sample; in a live session by the mapping in force.
  double time_of(std::int64_t sample) const;
  std::int64_t samples_rendered() const { return rendered_.load(std::memory_order_acquire); }

  // ---- [analysis worker], one at a time

  /// Takes one item from the inbox. False: there was none, or the render side has no room for its cues yet.
  bool analyse();
  /// The render side has no room for the cues of the last item. [any thread]
  bool held_back() const { return held_back_.load(std::memory_order_acquire); }
  /// analyse() would do something. [any thread]
  bool wants_analysis() const;

  // ---- [render worker], one at a time

  struct RenderOutcome {
    bool produced = false;
    bool wants_analysis = false;  ///< analysis has room again, or the sender went quiet and its contacts must end
    std::optional<WallClock::Duration> next_due;  ///< when there will be something to do; absent: when a batch comes
  };
  RenderOutcome render();

  /// Used by the scheduler so that one worker at a time holds the session's analysis.
  std::atomic<bool> analysis_scheduled{false};

 private:
  static constexpr std::size_t kBacklogBudget = 3;

  struct Waiting {
    engine::StreamItem item;
    std::uint64_t sequence;
    std::size_t bytes;
    std::uint64_t arrival;
  };
  /// What the render side tells the network thread.
  struct RenderFigures {
    engine::RenderCounters counters;
    std::int64_t settled_samples = 0;  ///< rendered, or ready to be
  };

  void skip_backlog(std::size_t bytes);                         // inbox_mutex_ is held
  void drop(const Waiting& waiting, const std::string& cause);  // inbox_mutex_ is held
  bool live() const { return options_.clock == Clock::kLive; }
  std::int64_t live_target() const;
  tl::expected<std::optional<observation::Observation>, engine::Refusal> accept(const engine::StreamItem& item,
                                                                                engine::CueBatch& batch);
  void collect_retired();                                   // analysis worker
  void hand_over(std::unique_ptr<engine::CueBatch> batch);  // analysis worker
  bool take_batch();                                        // render worker
  void render_quanta_until(std::int64_t target, RenderOutcome& outcome);

  const std::string id_;
  const SessionOptions options_;
  const WallClock& clock_;
  const WallClock::Duration started_;

  mutable std::mutex inbox_mutex_;
  std::deque<Waiting> inbox_;
  std::size_t inbox_bytes_ = 0;
  bool busy_ = false;  ///< an item has left the inbox and is being analysed
  Counters counters_;
  bool ended_ = false;

  std::mutex outcomes_mutex_;
  std::vector<Outcome> outcomes_;

  engine::Ingest ingest_;         // analysis worker
  std::atomic<double> origin_s_;  // simulation time of sample 0
  std::uint64_t newest_episode_ = 0;
  bool placed_ = false;  // live: the first frame has fixed where simulation time lies on the sample axis
  std::atomic<std::int64_t> last_frame_ns_{0};
  std::atomic<bool> quiet_{false};

  SpscRing<std::unique_ptr<engine::CueBatch>> batches_{1024};
  SpscRing<std::unique_ptr<engine::CueBatch>> retired_{2048};
  DecisionLog decisions_;
  std::unique_ptr<engine::CueBatch> held_;  // analysis worker: found the ring full
  std::atomic<bool> held_back_{false};

  engine::Render render_;  // render worker
  engine::AudioQuantum quantum_;
  std::atomic<std::int64_t> rendered_{0};
  std::atomic<bool> complete_{false};
  mutable LatestValue<RenderFigures> render_figures_;  // render worker → network thread

  SampleRing audio_;        // render worker → network thread
  std::int64_t taken_ = 0;  // network thread
  bool finished_ = false;
};

}  // namespace rustle::session
