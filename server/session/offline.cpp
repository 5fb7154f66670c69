#include "server/session/offline.h"

#include <algorithm>
#include <chrono>
#include <condition_variable>
#include <deque>
#include <exception>
#include <mutex>
#include <thread>
#include <utility>

namespace rustle::session {
namespace {

using Seconds = std::chrono::duration<double>;

/// A batch of cues, and where a recording says that it was accepted; else it is as soon as the horizon is reached.
struct Planned {
  engine::CueBatch cues;
  std::optional<synthesis::SampleTime> accepted_at;
};

/// Reads items until the stream has ended, one batch of cues each.
class AnalysisStage {
 public:
  AnalysisStage(const engine::Options& options, std::shared_ptr<pack::PackLibrary> packs, const OfflineEnds& ends)
      : ingest_(options, std::move(packs)), ends_(ends) {}

  /// The next batch; nothing after the last.
  std::optional<Planned> next() {
    if (ends_.next_directed) return next_directed();
    if (!parts_.empty()) return next_part();
    if (ended_) return std::nullopt;
    auto item = ends_.next();
    if (!item) item = engine::End{};
    ended_ = std::holds_alternative<engine::End>(*item);
    Planned planned;
    take(*item, planned.cues);
    if (planned.cues.cues.size() <= kMostCues) return planned;
    divide(std::move(planned));
    return next_part();
  }

  double spent_s = 0;
  std::uint64_t frames = 0;
  std::uint64_t refused = 0;

  synthesis::PlanCounters counters() const { return ingest_.counters(); }

 private:
  std::optional<Planned> next_directed() {
    const auto directed = ends_.next_directed();
    if (!directed) return std::nullopt;
    Planned planned;
    planned.accepted_at = directed->accepted_at;
    if (directed->earliest) ingest_.set_rendered(*directed->earliest);
    if (directed->start_again) ingest_.start_again(planned.cues);
    if (directed->mapping) ingest_.map_time(*directed->mapping);
    if (const auto* item = std::get_if<engine::StreamItem>(&directed->what)) take(*item, planned.cues);
    if (std::holds_alternative<FellQuiet>(directed->what)) ingest_.fall_quiet(planned.cues);
    return planned;
  }

  /// More cues than may wait in a mixer, as when cloth is chosen as a whole: parts by their time, each with the horizon that
  /// the next one leaves.
  void divide(Planned planned) {
    std::vector<synthesis::Cue> cues = std::move(planned.cues.cues);
    std::ranges::stable_sort(cues, {}, [](const synthesis::Cue& cue) { return synthesis::start_of(cue); });
    for (std::size_t first = 0; first < cues.size(); first += kMostCues) {
      const std::size_t end = std::min(first + kMostCues, cues.size());
      Planned part;
      part.cues.cues.assign(cues.begin() + static_cast<std::ptrdiff_t>(first),
                            cues.begin() + static_cast<std::ptrdiff_t>(end));
      part.cues.new_sheet = std::exchange(planned.cues.new_sheet, std::nullopt);
      part.cues.horizon = planned.cues.horizon;
      if (end < cues.size()) {
        const synthesis::SampleTime next = std::max<synthesis::SampleTime>(0, synthesis::start_of(cues[end]));
        part.cues.horizon = std::min(part.cues.horizon, next / synthesis::kQuantum * synthesis::kQuantum);
      } else {
        part.cues.end = planned.cues.end;
      }
      parts_.push_back(std::move(part));
    }
  }

  std::optional<Planned> next_part() {
    Planned part = std::move(parts_.front());
    parts_.pop_front();
    return part;
  }

  void take(const engine::StreamItem& item, engine::CueBatch& cues) {
    const auto before = std::chrono::steady_clock::now();
    const auto observed = ingest_.accept(item, cues);
    spent_s += Seconds(std::chrono::steady_clock::now() - before).count();
    if (!observed) {
      ++refused;
      if (ends_.refused) ends_.refused(observed.error());
    } else if (*observed) {
      ++frames;
      if (ends_.observed) ends_.observed(**observed);
    }
  }

  static constexpr std::size_t kMostCues = synthesis::kMaxWaitingCues / 4;

  engine::Ingest ingest_;
  const OfflineEnds& ends_;
  std::deque<Planned> parts_;  ///< of the last item, still to be handed out
  bool ended_ = false;
};

/// A bounded queue of batches between the two stages.
class BatchQueue {
 public:
  void push(std::optional<Planned> batch) {
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [this] { return batches_.size() < kDepth || abandoned_; });
    batches_.push_back(std::move(batch));
    changed_.notify_all();
  }
  std::optional<Planned> pop() {
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
  std::deque<std::optional<Planned>> batches_;
  bool abandoned_ = false;
};

/// Renders on as long as `more` says. False: the sink wants no more.
template <typename More>
bool render_while(engine::Render& render, engine::AudioQuantum& quantum, const OfflineEnds& ends, const More& more) {
  while (more()) {
    render.next(quantum);
    if (!ends.audio(quantum)) return false;
  }
  return true;
}

/// Renders what one batch allows. False: the sink wants no more.
bool render_batch(engine::Render& render, const Planned& planned, engine::AudioQuantum& quantum, const OfflineEnds& ends) {
  const auto whole_before = [&](synthesis::SampleTime sample) { return render.position() + synthesis::kQuantum <= sample; };
  if (planned.accepted_at) {
    const bool go_on =
        render_while(render, quantum, ends, [&] { return whole_before(*planned.accepted_at) && !render.complete(); });
    if (go_on) render.accept(planned.cues);
    return go_on;
  }
  render.accept(planned.cues);
  return render_while(render, quantum, ends,
                      [&] { return whole_before(render.horizon()) || (render.ending() && !render.complete()); });
}

}  // namespace

OfflineSummary render_offline(const engine::Options& options, std::shared_ptr<pack::PackLibrary> packs, int workers,
                              const OfflineEnds& ends) {
  AnalysisStage analysis(options, std::move(packs), ends);
  engine::Render render(options);
  engine::AudioQuantum quantum = render.make_quantum();
  const auto emitters = options.emitters ? render.make_emitters() : nullptr;
  quantum.emitters = emitters.get();
  OfflineSummary summary;
  bool wanted = true;
  const auto timed = [&](const auto& rendering) {
    const auto before = std::chrono::steady_clock::now();
    wanted = rendering();
    summary.synthesis_s += Seconds(std::chrono::steady_clock::now() - before).count();
    return wanted;
  };
  const auto timed_render = [&](const Planned& planned) {
    return timed([&] { return render_batch(render, planned, quantum, ends); });
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
  // A recording that holds its stream's end holds the tails as well.
  if (wanted)
    timed([&] { return render_while(render, quantum, ends, [&] { return render.ending() && !render.complete(); }); });
  summary.samples = render.position();
  if (emitters) summary.emitter_samples_left_out = emitters->take_left_out();
  summary.plan = analysis.counters();
  summary.render = render.counters();
  summary.frames = analysis.frames;
  summary.refused = analysis.refused;
  summary.analysis_s = analysis.spent_s;
  return summary;
}

}  // namespace rustle::session
