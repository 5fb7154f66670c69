#include "server/session/scheduler.h"

#include <algorithm>

namespace rustle::session {
namespace {

// Sessions out of step with each other are served together.
constexpr std::chrono::milliseconds kLeastWait{1};

}  // namespace

Scheduler::Scheduler(int analysis_workers, const WallClock& clock, std::function<void()> audio_ready)
    : clock_(clock), audio_ready_(std::move(audio_ready)) {
  for (int worker = 0; worker < std::max(1, analysis_workers); ++worker) threads_.emplace_back([this] { run_analysis(); });
  threads_.emplace_back([this] { run_render(); });
}

Scheduler::~Scheduler() {
  {
    std::scoped_lock lock(ready_mutex_, sessions_mutex_);
    stopping_ = true;
  }
  ready_changed_.notify_all();
  render_wanted_.notify_all();
  for (auto& thread : threads_) thread.join();
}

void Scheduler::add(std::shared_ptr<Session> session) {
  {
    std::lock_guard lock(sessions_mutex_);
    sessions_.push_back(std::move(session));
  }
  wake_render();
}

void Scheduler::remove(const Session& session) {
  std::lock_guard lock(sessions_mutex_);
  std::erase_if(sessions_, [&](const auto& held) { return held.get() == &session; });
}

void Scheduler::wake_analysis(const std::shared_ptr<Session>& session) {
  if (!session->analysis_scheduled.exchange(true)) requeue(session);
}

void Scheduler::requeue(std::shared_ptr<Session> session) {
  {
    std::lock_guard lock(ready_mutex_);
    ready_.push_back(std::move(session));
  }
  ready_changed_.notify_one();
}

void Scheduler::wake_render() {
  {
    std::lock_guard lock(sessions_mutex_);
    render_again_ = true;
  }
  render_wanted_.notify_one();
}

void Scheduler::run_analysis() {
  std::unique_lock lock(ready_mutex_);
  for (;;) {
    ready_changed_.wait(lock, [this] { return stopping_ || !ready_.empty(); });
    if (stopping_) return;
    const std::shared_ptr<Session> session = std::move(ready_.front());
    ready_.pop_front();
    lock.unlock();
    // The flag stays up while the session is queued or worked on, so one worker at a time holds it.
    if (session->analyse()) {
      requeue(session);
    } else {
      session->analysis_scheduled.store(false);
      if (session->wants_analysis()) wake_analysis(session);  // something came while the last look was taken
    }
    if (!session->held_back()) wake_render();  // else it is the render side that must come first
    audio_ready_();
    lock.lock();
  }
}

void Scheduler::run_render() {
  std::vector<std::shared_ptr<Session>> sessions;
  std::unique_lock lock(sessions_mutex_);
  while (!stopping_) {
    sessions = sessions_;
    render_again_ = false;
    lock.unlock();
    bool produced = false;
    std::optional<WallClock::Duration> next;
    for (const auto& session : sessions) {
      const auto outcome = session->render();
      produced |= outcome.produced;
      if (outcome.wants_analysis) wake_analysis(session);
      if (outcome.next_due && (!next || *outcome.next_due < *next)) next = outcome.next_due;
    }
    sessions.clear();
    if (produced) audio_ready_();
    lock.lock();
    if (stopping_ || render_again_) continue;
    if (next) {
      render_wanted_.wait_for(lock, std::max<WallClock::Duration>(kLeastWait, *next - clock_.now()));
    } else {
      render_wanted_.wait(lock, [this] { return stopping_ || render_again_; });
    }
  }
}

}  // namespace rustle::session
