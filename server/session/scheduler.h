#pragma once

#include <condition_variable>
#include <deque>
#include <functional>
#include <memory>
#include <mutex>
#include <thread>
#include <vector>

#include "server/session/session.h"

namespace rustle::session {

/// The threads that carry sessions from frames to samples: analysis workers, which take any session that has items (one
/// worker a session at a time, so its order is kept), and one render worker, which renders what is due.
class Scheduler {
 public:
  /// `audio_ready` is called by the render worker after a pass in which some session produced sound, and by analysis
  /// workers when outcomes wait; it must be thread-safe and quick.
  Scheduler(int analysis_workers, const WallClock& clock, std::function<void()> audio_ready);
  ~Scheduler();
  Scheduler(const Scheduler&) = delete;
  Scheduler& operator=(const Scheduler&) = delete;

  // [any thread]
  void add(std::shared_ptr<Session> session);
  void remove(const Session& session);
  /// The session has items to analyse.
  void wake_analysis(const std::shared_ptr<Session>& session);

 private:
  void requeue(std::shared_ptr<Session> session);
  void run_analysis();
  void run_render();
  void wake_render();

  const WallClock& clock_;
  const std::function<void()> audio_ready_;

  std::mutex ready_mutex_;
  std::condition_variable ready_changed_;
  std::deque<std::shared_ptr<Session>> ready_;
  bool stopping_ = false;

  std::mutex sessions_mutex_;
  std::condition_variable render_wanted_;
  std::vector<std::shared_ptr<Session>> sessions_;
  bool render_again_ = false;

  std::vector<std::thread> threads_;
};

}  // namespace rustle::session
