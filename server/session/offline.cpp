#include "server/session/offline.h"

#include <chrono>
#include <condition_variable>
#include <deque>
#include <exception>
#include <mutex>
#include <thread>

namespace rustle::session {
namespace {

using Seconds = std::chrono::duration<double>;

/// Reads items until the stream has ended, one batch of cues each.
class AnalysisStage {
 public:
  AnalysisStage(const engine::Options& options, std::shared_ptr<pack::PackLibrary> packs, const OfflineEnds& ends)
      : ingest_(options, std::move(packs)), ends_(ends) {}

  /// The next batch; nothing after the one that ends the stream.
  std::optional<engine::CueBatch> next() {
    if (ended_) return std::nullopt;
    auto item = ends_.next();
    if (!item) item = engine::End{};
    ended_ = std::holds_alternative<engine::End>(*item);
    const auto before = std::chrono::steady_clock::now();
    engine::CueBatch batch;
    const auto observed = ingest_.accept(*item, batch);
    spent_s += Seconds(std::chrono::steady_clock::now() - before).count();
    if (!observed) {
      ++refused;
      if (ends_.refused) ends_.refused(observed.error());
    } else if (*observed) {
      ++frames;
      if (ends_.observed) ends_.observed(**observed);
    }
    return batch;
  }

  double spent_s = 0;
  std::uint64_t frames = 0;
  std::uint64_t refused = 0;

  synthesis::PlanCounters counters() const { return ingest_.counters(); }

 private:
  engine::Ingest ingest_;
  const OfflineEnds& ends_;
  bool ended_ = false;
};

/// A bounded queue of batches between the two stages.
class BatchQueue {
 public:
  void push(std::optional<engine::CueBatch> batch) {
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [this] { return batches_.size() < kDepth || abandoned_; });
    batches_.push_back(std::move(batch));
    changed_.notify_all();
  }
  std::optional<engine::CueBatch> pop() {
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [this] { return !batches_.empty(); });
    auto batch = std::move(batches_.front());
    batches_.pop_front();
    changed_.notify_all();
    return batch;
  }
  void abandon() {
    std::lock_guard lock(mutex_);
    abandoned_ = true;
    changed_.notify_all();
  }
  bool abandoned() {
    std::lock_guard lock(mutex_);
    return abandoned_;
  }

 private:
  static constexpr std::size_t kDepth = 64;
  std::mutex mutex_;
  std::condition_variable changed_;
  std::deque<std::optional<engine::CueBatch>> batches_;
  bool abandoned_ = false;
};

/// Renders what one batch allows. False: the sink wants no more.
bool render_batch(engine::Render& render, const engine::CueBatch& batch, engine::AudioQuantum& quantum,
                  const OfflineEnds& ends) {
  render.accept(batch);
  while (render.position() + synthesis::kQuantum <= render.horizon() || (render.ending() && !render.complete())) {
    render.next(quantum);
    if (!ends.audio(quantum)) return false;
  }
  return true;
}

}  // namespace

OfflineSummary render_offline(const engine::Options& options, std::shared_ptr<pack::PackLibrary> packs, int workers,
                              const OfflineEnds& ends) {
  AnalysisStage analysis(options, std::move(packs), ends);
  engine::Render render(options);
  engine::AudioQuantum quantum = render.make_quantum();
  OfflineSummary summary;
  const auto timed_render = [&](const engine::CueBatch& batch) {
    const auto before = std::chrono::steady_clock::now();
    const bool go_on = render_batch(render, batch, quantum, ends);
    summary.synthesis_s += Seconds(std::chrono::steady_clock::now() - before).count();
    return go_on;
  };

  if (workers <= 1) {
    while (auto batch = analysis.next()) {
      if (!timed_render(*batch)) break;
    }
  } else {
    BatchQueue queue;
    std::exception_ptr failure;
    std::thread ahead([&] {
      try {
        for (bool more = true; more && !queue.abandoned();) {
          auto batch = analysis.next();
          more = batch.has_value();
          queue.push(std::move(batch));
        }
      } catch (...) {
        failure = std::current_exception();
        queue.push(std::nullopt);
      }
    });
    const auto stop = [&] {
      queue.abandon();
      ahead.join();
    };
    try {
      while (auto batch = queue.pop()) {
        if (!timed_render(*batch)) break;
      }
    } catch (...) {
      stop();
      throw;
    }
    stop();
    if (failure) std::rethrow_exception(failure);
  }
  summary.samples = render.position();
  summary.plan = analysis.counters();
  summary.render = render.counters();
  summary.frames = analysis.frames;
  summary.refused = analysis.refused;
  summary.analysis_s = analysis.spent_s;
  return summary;
}

}  // namespace rustle::session
