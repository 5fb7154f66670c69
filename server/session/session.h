#pragma once

#include <atomic>
#include <cstdint>
#include <deque>
#include <limits>
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
#include "server/session/emitter_tap.h"
#include "server/session/frame_trace.h"
#include "server/session/inbox.h"
#include "server/session/input_gaps.h"
#include "server/session/playout_clock.h"
#include "server/session/session_options.h"
#include "server/session/spsc_ring.h"
#include "server/session/stem_tap.h"
#include "server/session/taps.h"
#include "server/session/turn_queue.h"
#include "server/session/watch.h"
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
  std::uint64_t events_joined = 0;  ///< flips that sounded in their frame's greatest ones, under load
  std::uint32_t load_level = 0;     ///< in force where analysis is
  std::uint64_t friction_episodes = 0;
  std::uint64_t tear_events = 0;
  double newest_time_s = 0;
  synthesis::PlanCounters plan;
  engine::RenderCounters render;
  std::uint64_t emitter_samples_left_out = 0;  ///< of emitters that were listened to and beyond kMostEmitters
  std::uint64_t samples_due = 0;    ///< that the session's clock has called for, tails of an ended stream included
  std::uint64_t sequence_gaps = 0;  ///< messages that did not come
  // of a live session
  std::uint64_t frames_late = 0;        ///< analysed after they were due: what they show sounds at once
  std::uint64_t time_jumps = 0;         ///< simulation time was placed anew on the sample axis
  std::uint64_t deadline_misses = 0;    ///< blocks rendered too late by the render worker's own time; see RenderOutcome
  std::uint64_t late_by_run_delay = 0;  ///< blocks too late because the worker waited for a processor
  InputGaps::Figures input_gaps;
  double playout_delay_s = 0;
  double clock_drift_ppm = 0;  ///< how much faster simulation time runs than the audio clock
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

inline constexpr std::size_t kMostStems = 64;  ///< of one session that are listened to at a time

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

  /// Takes an item that came in `bytes`; inbox.h says what a live session does with frames that are too many, repeated or
  /// late. `arrival`: the number of its message in the order of arrival, by which decisions name it; 0: it came in none.
  /// `received`: when the message came, of the session's clock; 0: just now.
  [[nodiscard]] Offer offer(engine::StreamItem item, std::uint64_t sequence, std::size_t bytes = 0,
                            std::uint64_t arrival = 0, WallClock::Duration received = {});
  /// What the sound depends on besides what is offered. Kept from the beginning where options().record says so.
  DecisionLog& decisions() { return decisions_; }
  /// A message came that is no item, such as a topology: its number is not missing.
  void pass_over(std::uint64_t sequence);
  /// A frame's message came and is not wanted: it is counted, and told as a decision.
  void drop_frame(std::uint64_t arrival, std::uint64_t sequence, const char* cause);
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
  /// A stem of what is rendered from now on, besides what was rendered already and not taken. It is to be emptied whenever
  /// take_audio() is called: sound waits for room in it. After the last block of the mix it holds all that is left.
  /// Null: kMostStems are listened to.
  std::shared_ptr<StemTap> open_stem(sheet::SheetId sheet, synthesis::SoundKind kind);
  void close_stem(const StemTap& stem) { stems_.close(stem); }
  /// Every emitter by itself, under the same conditions. Null: too many such taps were closed just now.
  /// \pre the last one was closed
  std::shared_ptr<EmitterTap> open_emitters();
  void close_emitters(const EmitterTap& emitters) { emitters_.close(emitters); }
  /// So many blocks may be rendered at once, 1 unless told: as many as listeners want in a message. Where there are several,
  /// a live session is rendered at moments that it shares with all whose steps are as long.
  void render_in_steps_of(int blocks) { step_blocks_.store(blocks, std::memory_order_relaxed); }
  /// From now on this sees what is analysed, and its surroundings; null: nobody does, which costs nothing. A turn of
  /// analysis should follow.
  void watch(std::shared_ptr<Watch> watch);
  /// The whole stream was taken.
  bool finished() const { return finished_; }
  Counters counters() const;
  /// Simulation time of a sample; in a live session by the mapping in force there.
  double time_of(std::int64_t sample) const;
  /// The newest.
  engine::TimeMapping mapping() const;
  std::int64_t samples_rendered() const { return rendered_.load(std::memory_order_acquire); }
  /// Sound before this sample has gone out.
  void sound_left(std::int64_t sample);
  /// For so long something has waited while analysis took nothing up.
  WallClock::Duration analysis_stalled() const;

  // ---- [any thread]

  const FrameTraces& traces() const { return traces_; }
  const StageTimes& stage_times() const { return times_; }
  /// That its frames have taken so far.
  WallClock::Duration analysis_time() const { return WallClock::Duration(analysis_ns_.load(std::memory_order_relaxed)); }

  // ---- [analysis worker], one at a time

  /// Takes one item from the inbox. False: there was none, or the render side has no room for its cues yet.
  bool analyse();
  /// The render side has no room for the cues of the last item. [any thread]
  bool held_back() const { return held_back_.load(std::memory_order_acquire); }
  /// analyse() would do something. [any thread]
  bool wants_analysis() const;

  // ---- [render worker], one at a time

  /// A live block is due when the clock has passed it, and late when it is not rendered a block (2 ms, if that is more)
  /// after that.
  struct RenderOutcome {
    bool produced = false;
    std::uint64_t blocks_late = 0;
    WallClock::Duration due{};    ///< the first of them
    WallClock::Duration late{};   ///< the first of them, beyond that time
    bool wants_analysis = false;  ///< analysis has room again, or the sender went quiet and its contacts must end
    std::optional<WallClock::Duration> next_due;  ///< when there will be something to do; absent: when a batch comes
  };
  RenderOutcome render() noexcept RUSTLE_NONBLOCKING;
  /// Of the last RenderOutcome: whether its blocks would have been in time if the worker had not waited for a processor.
  void count_late(std::uint64_t blocks, bool by_run_delay) noexcept RUSTLE_NONBLOCKING;

  // ---- [scheduler]

  /// Rendering goes on when analysis has handed something over, not by the clock alone.
  bool renders_on_call() const { return !live() || idle_.load(); }
  /// So that one worker at a time holds the session's analysis.
  std::atomic<bool> analysis_scheduled{false};
  /// It asks for more than it may have: what its workers do is not the daemon's load. [network thread → all]
  std::atomic<bool> beyond_budget{false};
  /// Since this was last set to false there are outcomes or sound to take. [workers → network thread]
  std::atomic<bool> has_news{true};
  TurnAccount turns;

 private:
  /// What the render side tells the network thread.
  struct RenderFigures {
    engine::RenderCounters counters;
    std::uint64_t emitter_samples_left_out = 0;
    std::int64_t settled_samples = 0;  ///< rendered, or ready to be
    InputGaps::Figures input_gaps;
  };

  void count_lost();                          // inbox_mutex_ is held
  void watch_inbox();                         // inbox_mutex_ is held
  bool analyse_next();                        // analysis worker
  std::optional<Inbox::Waiting> next_item();  // analysis worker
  /// The item under way is left, as there is no memory for it. [analysis worker]
  void leave_item();
  WallClock::Duration reorder_wait() const;
  /// What is due is known as far as this item says. [analysis worker]
  void cover(const engine::StreamItem& item, bool taken);
  double latency_s() const { return static_cast<double>(latency_) / options_.rate_hz; }
  /// Where a live item is heard; a mapping that is put in force with it.
  std::optional<engine::TimeMapping> map_time(const Inbox::Waiting& next, synthesis::SampleTime rendered);
  /// [analysis worker]
  std::shared_ptr<Watch> watch_now();
  static constexpr std::int64_t kNever = std::numeric_limits<std::int64_t>::max();

  bool live() const { return options_.clock == Clock::kLive; }
  std::int64_t live_target() const noexcept RUSTLE_NONBLOCKING;
  tl::expected<std::optional<observation::Observation>, engine::Refusal> accept(const engine::StreamItem& item,
                                                                                engine::CueBatch& batch);
  void collect_retired();  // analysis worker
  /// A step's cues on their way to the render side. [analysis worker]
  void send(Step step, const std::optional<engine::TimeMapping>& mapping, std::unique_ptr<engine::CueBatch> batch);
  void hand_over(std::unique_ptr<engine::CueBatch> batch);  // analysis worker
  bool take_batch() noexcept RUSTLE_NONBLOCKING;            // render worker
  void render_quanta_until(std::int64_t target, RenderOutcome& outcome) noexcept RUSTLE_NONBLOCKING;
  bool room_for_quantum() const noexcept RUSTLE_NONBLOCKING;         // render worker
  void feed_stems() noexcept RUSTLE_NONBLOCKING;                     // render worker
  void feed_emitters() noexcept RUSTLE_NONBLOCKING;                  // render worker
  std::int64_t quanta_of_block() const noexcept RUSTLE_NONBLOCKING;  ///< samples of a block, in whole quanta
  /// What is to be rendered by now: what is due, or was at the last of the moments shared.
  std::int64_t live_step_target() const noexcept RUSTLE_NONBLOCKING;
  /// The number of the last shared moment, and when a moment is.
  std::int64_t shared_moments() const noexcept RUSTLE_NONBLOCKING;
  WallClock::Duration shared_moment(std::int64_t number) const noexcept RUSTLE_NONBLOCKING;
  std::int64_t samples_due(WallClock::Duration now) const noexcept RUSTLE_NONBLOCKING;
  /// A live session that is silent and has not been given anything for a while is rendered in long steps, all such sessions
  /// at the same moments. Returns the next one.
  WallClock::Duration next_due() noexcept RUSTLE_NONBLOCKING;
  void judge_lateness(std::int64_t from, WallClock::Duration now, RenderOutcome& outcome) const noexcept RUSTLE_NONBLOCKING;

  const std::string id_;
  const SessionOptions options_;
  const WallClock& clock_;
  const WallClock::Duration started_;

  mutable std::mutex inbox_mutex_;
  Inbox inbox_;
  bool busy_ = false;             ///< an item has left the inbox and is being analysed
  bool frame_uncounted_ = false;  ///< it is a frame that is in no sum yet
  std::uint64_t taken_sequence_ = 0;
  WallClock::Duration taken_at_{};  ///< when the last one left it
  Counters counters_;

  mutable std::mutex outcomes_mutex_;
  std::vector<Outcome> outcomes_;
  std::deque<engine::TimeMapping> mappings_;  ///< for samples not yet taken and the newest second

  std::atomic<bool> watched_{false};
  std::mutex watch_mutex_;
  std::shared_ptr<Watch> watch_;

  engine::Ingest ingest_;  // analysis worker
  std::uint64_t newest_episode_ = 0;
  synthesis::SampleTime latency_ = 0;  // analysis worker; of cloth: everything is heard so much later
  PlayoutClock playout_;               // analysis worker
  std::atomic<double> delay_s_;
  std::uint64_t time_jumps_ = 0;                      // analysis worker
  std::atomic<std::int64_t> inbox_ready_ns_{kNever};  // when what waits for a missing message waits no more
  std::atomic<bool> quiet_{false};
  InputGaps gaps_;

  SpscRing<std::unique_ptr<engine::CueBatch>> batches_{1024};
  SpscRing<std::unique_ptr<engine::CueBatch>> retired_{2048};
  DecisionLog decisions_;
  FrameTraces traces_;
  StageTimes times_;
  std::atomic<std::int64_t> analysis_ns_{0};
  std::atomic<std::uint64_t> deadline_misses_{0}, late_by_run_delay_{0};  // render worker
  std::unique_ptr<engine::CueBatch> held_;                                // analysis worker: found the ring full
  std::size_t under_way_ = 0;  // analysis worker: batches that have not come back from the render side
  std::atomic<bool> held_back_{false};

  engine::Render render_;  // render worker
  engine::AudioQuantum quantum_;
  std::atomic<std::int64_t> rendered_{0};
  std::int64_t accepted_at_ = 0;     // render worker: where the last batch was accepted
  std::int64_t step_ = 0;            // render worker: samples until what is next due
  std::atomic<bool> idle_{false};    // render worker → scheduler
  std::atomic<int> step_blocks_{1};  // network thread → render worker
  std::atomic<bool> complete_{false};
  mutable LatestValue<RenderFigures> render_figures_;  // render worker → network thread

  SampleRing audio_;  // render worker → network thread
  Taps<StemTap> stems_{kMostStems};
  Taps<EmitterTap> emitters_{4};                // one is open at a time; others may not have been given back
  std::uint64_t emitter_samples_left_out_ = 0;  // render worker
  std::vector<float> stem_;                     // render worker: a quantum
  std::int64_t taken_ = 0;                      // network thread
  bool finished_ = false;
};

}  // namespace rustle::session
