#pragma once

#include <atomic>
#include <cstdint>
#include <deque>
#include <mutex>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "server/session/decision.h"

namespace rustle::session {

/// A session's decisions, told as they become final: a step when the render side has accepted its cues.
///
///   analysis ── taken ──► under way ── accepted ──► log ──► network thread
///
/// The render worker has no part in it: where it accepted a batch travels back to analysis with the batch.
class DecisionLog {
 public:
  /// From now on, or no longer, decisions are kept for take(). [network thread]
  void keep(bool on) { kept_.store(on, std::memory_order_release); }
  /// [any thread]
  bool kept() const { return kept_.load(std::memory_order_acquire); }

  /// A step whose cues are on their way to the render side, in the order of their batches, and the mapping that was put in
  /// force before it. [analysis worker]
  void taken(Step step, std::optional<engine::TimeMapping> mapping = {}) {
    under_way_.push_back({mapping, std::move(step)});
  }
  /// The oldest step under way was accepted at this sample. [analysis worker]
  void accepted(synthesis::SampleTime at);

  /// Asks for a RenderedTo. [network thread]
  void want_rendered() { rendered_wanted_.store(true, std::memory_order_release); }
  /// [any thread]
  bool rendered_wanted() const { return rendered_wanted_.load(std::memory_order_acquire); }
  /// Answers want_rendered(), where it was asked. \pre every step accepted before `sample` was told. [analysis worker]
  void rendered(synthesis::SampleTime sample);

  /// [any thread]
  void dropped(std::uint64_t arrival, std::uint64_t sequence, const std::string& cause);

  /// What has become final since the last call, in order. [network thread]
  std::vector<Decision> take();

 private:
  struct UnderWay {
    std::optional<engine::TimeMapping> mapping;
    Step step;
  };
  void tell(Decision decision);

  std::atomic<bool> kept_{false};
  std::atomic<bool> rendered_wanted_{false};
  std::deque<UnderWay> under_way_;  // analysis worker
  std::mutex mutex_;
  std::vector<Decision> told_;
};

}  // namespace rustle::session
