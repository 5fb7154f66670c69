#pragma once

#include <condition_variable>
#include <functional>
#include <memory>
#include <mutex>
#include <thread>
#include <vector>

#include "server/session/due_queue.h"
#include "server/session/session.h"
#include "server/session/turn_queue.h"
#include "server/session/worker_thread.h"

namespace rustle::session {

/// The threads that carry sessions from frames to samples.
///
///   analysis workers  take turns: the session that has had least time is next, for 2 ms or one item, whatever takes longer.
///                     One worker at a time has a session, so its order is kept. One thread more than asked for takes only
///                     sessions whose turns are short, so that those never wait for a heavy one's frame to be finished.
///   render workers    render what is due, the earliest deadline first, before analysis: at real-time priority where the
///                     system grants it. They never wait for analysis; what it has not handed over is not heard yet.
class Scheduler {
 public:
  struct Options {
    int analysis_workers = 1;
    int render_workers = 1;
    std::vector<int> analysis_cpus, render_cpus;  ///< where they run; empty: anywhere
  };

  /// `audio_ready` is called by render workers after they made sound, and by analysis workers when outcomes wait; it must be
  /// thread-safe and quick.
  Scheduler(const Options& options, const WallClock& clock, std::function<void()> audio_ready);
  ~Scheduler();
  Scheduler(const Scheduler&) = delete;
  Scheduler& operator=(const Scheduler&) = delete;

  // [any thread]
  void add(std::shared_ptr<Session> session);
  void remove(const std::shared_ptr<Session>& session);
  /// The session has items to analyse.
  void wake_analysis(const std::shared_ptr<Session>& session);

  /// For how long workers have worked, all of a kind together, for live sessions that keep to their budget.
  struct Busy {
    WallClock::Duration analysis{}, render{};
  };
  Busy busy() const;

  /// What every render worker was granted.
  Priority render_priority() const { return render_priority_; }
  /// Every worker is on the processors it was to be on.
  bool pinned() const { return pinned_; }

 private:
  using Held = std::shared_ptr<Session>;

  void queue(Held session);
  void analyse_a_turn(const Held& session);
  void run_analysis(bool short_only);
  void run_render();
  void call_render(const Held& session);
  /// A worker has begun. [every worker, once]
  void begun(const char* name, const std::vector<int>& cpus, bool raise);

  const Options options_;
  const WallClock& clock_;
  const std::function<void()> audio_ready_;

  mutable std::mutex turns_mutex_;
  /// Analysis workers of one kind that have nothing to do. Who queues a session calls one of them, once: a call costs more
  /// Analysis workers of one kind. Who queues a session calls one of those that have nothing to do, once.
  struct Waiting {
    std::condition_variable called;
    int idle = 0;   ///< wait and have not been called
    int calls = 0;  ///< that have not been answered yet
  };
  bool call(Waiting& workers);  ///< False: all are at work, and look for more when they are done. turns_mutex_ is held
  Waiting any_turn_, short_turn_;
  TurnQueue<Held> turns_;
  WallClock::Duration analysis_busy_{};
  bool stopping_ = false;  // both mutexes

  mutable std::mutex due_mutex_;
  std::condition_variable due_changed_;
  DueQueue<Held> due_;
  WallClock::Duration render_busy_{};
  WallClock::Duration watched_until_ = WallClock::Duration::max();  ///< a render worker waits until then

  std::mutex begun_mutex_;
  std::condition_variable begun_changed_;
  std::size_t begun_ = 0;
  Priority render_priority_ = Priority::kRealTime;
  bool pinned_ = true;

  std::vector<std::thread> threads_;
};

}  // namespace rustle::session
