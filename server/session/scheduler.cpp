#include "server/session/scheduler.h"

#include <algorithm>
#include <utility>

namespace rustle::session {
namespace {

constexpr std::chrono::milliseconds kTurn{2};
// Sessions out of step with each other are rendered together.
constexpr std::chrono::microseconds kLeastWait{250};
constexpr int kSayAfter = 8;

/// What cannot wait. Sessions that follow simulation time take all that is left, by design; those beyond their budget more
/// than is theirs.
bool is_load(const Session& session) {
  return session.options().clock == Clock::kLive && !session.beyond_budget.load();
}

}  // namespace

Scheduler::Scheduler(const Options& options, const WallClock& clock, std::function<void()> audio_ready)
    : options_(options), clock_(clock), audio_ready_(std::move(audio_ready)) {
  for (int worker = 0; worker < std::max(1, options_.analysis_workers); ++worker)
    threads_.emplace_back([this] { run_analysis(false); });
  threads_.emplace_back([this] { run_analysis(true); });
  for (int worker = 0; worker < std::max(1, options_.render_workers); ++worker)
    threads_.emplace_back([this] { run_render(); });
  std::unique_lock lock(begun_mutex_);
  begun_changed_.wait(lock, [this] { return begun_ == threads_.size(); });
}

Scheduler::~Scheduler() {
  {
    std::scoped_lock lock(turns_mutex_, due_mutex_);
    stopping_ = true;
  }
  any_turn_.called.notify_all();
  short_turn_.called.notify_all();
  due_changed_.notify_all();
  for (auto& thread : threads_) thread.join();
}

void Scheduler::begun(const char* name, const std::vector<int>& cpus, bool raise) {
  name_this_thread(name);
  const bool pinned = pin_this_thread(cpus);
  const Priority priority = raise ? raise_this_thread() : Priority::kRealTime;
  std::lock_guard lock(begun_mutex_);
  pinned_ &= pinned;
  render_priority_ = std::min(render_priority_, priority);
  ++begun_;
  begun_changed_.notify_one();
}

void Scheduler::add(Held session) {
  {
    std::lock_guard lock(due_mutex_);
    due_.add(std::move(session));
  }
  due_changed_.notify_one();
}

void Scheduler::remove(const Held& session) {
  std::lock_guard lock(due_mutex_);
  due_.remove(session);
}

Scheduler::Busy Scheduler::busy() const {
  std::scoped_lock lock(turns_mutex_, due_mutex_);
  return {analysis_busy_, render_busy_};
}

// ----------------------------------------------------------------------------------------------------------- analysis

void Scheduler::wake_analysis(const Held& session) {
  if (!session->analysis_scheduled.exchange(true)) queue(session);
}

bool Scheduler::call(Waiting& workers) {
  if (workers.idle == 0) return false;
  --workers.idle;
  ++workers.calls;
  workers.called.notify_one();
  return true;
}

void Scheduler::queue(Held session) {
  std::lock_guard lock(turns_mutex_);
  turns_.want(std::move(session));
  if (!call(any_turn_) && turns_.short_waits()) call(short_turn_);
}

void Scheduler::run_analysis(bool short_only) {
  begun(short_only ? "rustle-short" : "rustle-analyse", options_.analysis_cpus, false);
  Waiting& waiting = short_only ? short_turn_ : any_turn_;
  std::unique_lock lock(turns_mutex_);
  while (!stopping_) {
    const auto session = turns_.take(short_only);
    if (!session) {
      ++waiting.idle;
      waiting.called.wait(lock, [&] { return stopping_ || waiting.calls > 0; });
      waiting.calls -= stopping_ ? 0 : 1;
      continue;
    }
    lock.unlock();
    analyse_a_turn(*session);
    lock.lock();
  }
}

void Scheduler::analyse_a_turn(const Held& session) {
  // The flag stays up while the session is queued or worked on, so one worker at a time holds it.
  const auto began = clock_.now();
  bool more = true;
  WallClock::Duration turn{};
  while (more && turn < kTurn) {
    more = session->analyse();
    turn = clock_.now() - began;
  }
  {
    std::lock_guard lock(turns_mutex_);
    turns_.done(session, turn);
    if (is_load(*session)) analysis_busy_ += turn;
  }
  if (more) {
    queue(session);
  } else {
    session->analysis_scheduled.store(false);
    if (session->wants_analysis()) wake_analysis(session);  // something came while the last look was taken
  }
  if (session->renders_on_call() && !session->held_back()) call_render(session);
  // What a live session's analysis tells can wait for its sound.
  if (session->options().clock != Clock::kLive) audio_ready_();
}

// ------------------------------------------------------------------------------------------------------------- render

void Scheduler::call_render(const Held& session) {
  {
    std::lock_guard lock(due_mutex_);
    due_.call(session);
  }
  due_changed_.notify_one();
}

void Scheduler::run_render() {
  begun("rustle-render", options_.render_cpus, true);
  int produced = 0;  // sessions, since it was said
  RunDelay run_delay;
  std::unique_lock lock(due_mutex_);
  while (!stopping_) {
    const auto now = clock_.now();
    run_delay.note(now);
    const auto ticket = due_.take(now);
    const auto next = due_.next_due();
    if (ticket) {
      Held session = due_.member(*ticket);
      const bool unwatched = next && *next < watched_until_;
      lock.unlock();
      if (unwatched) due_changed_.notify_one();
      const auto outcome = session->render();
      produced += outcome.produced ? 1 : 0;
      if (outcome.wants_analysis) wake_analysis(session);
      if (outcome.blocks_late > 0) session->count_late(outcome.blocks_late, run_delay.since(outcome.due) >= outcome.late);
      const bool counts = outcome.produced && is_load(*session);
      session.reset();
      if (produced >= kSayAfter) {
        produced = 0;
        audio_ready_();
      }
      lock.lock();
      if (counts) render_busy_ += clock_.now() - now;
      due_.give_back(*ticket, outcome.next_due);
    } else if (produced > 0) {
      produced = 0;
      lock.unlock();
      audio_ready_();
      lock.lock();
    } else if (next && *next < watched_until_) {
      watched_until_ = *next;
      due_changed_.wait_for(lock, std::max<WallClock::Duration>(kLeastWait, *next - clock_.now()));
      if (watched_until_ == *next) watched_until_ = WallClock::Duration::max();
    } else {
      due_changed_.wait(lock);
    }
  }
}

}  // namespace rustle::session
