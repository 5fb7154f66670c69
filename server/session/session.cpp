#include "server/session/session.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "server/session/settled_options.h"

namespace rustle::session {
namespace {

using synthesis::kQuantum;

constexpr double kAudioRing_s = 2.0;
constexpr std::chrono::milliseconds kQuietAfter{200};
constexpr double kStep_s = 0.5;  // a frame that far from its place on the sample axis starts a new mapping

}  // namespace

Session::Session(std::string id, SessionOptions options, std::shared_ptr<pack::PackLibrary> packs, const WallClock& clock,
                 const std::shared_ptr<const spatial::Hrtf>& hrtf)
    : id_(std::move(id)),
      options_(settled(std::move(options))),
      clock_(clock),
      started_(clock.now()),
      ingest_(engine_options(options_, hrtf), std::move(packs)),
      origin_s_(options_.time_origin_s),
      render_(engine_options(options_, hrtf)),
      quantum_(render_.make_quantum()),
      audio_(static_cast<std::size_t>(kAudioRing_s * options_.rate_hz) *
             static_cast<std::size_t>(channel_count(options_.channels))) {
  decisions_.keep(options_.record);
}

Offer Session::offer(engine::StreamItem item, std::uint64_t sequence, std::size_t bytes, std::uint64_t arrival) {
  const bool is_frame = std::holds_alternative<sheet::MeshFrame>(item);
  const bool is_end = std::holds_alternative<engine::End>(item);
  std::lock_guard lock(inbox_mutex_);
  ++counters_.items_received;
  if (is_frame) ++counters_.frames_received;
  Waiting waiting{std::move(item), sequence, bytes, arrival};
  if (ended_) {
    drop(waiting, "ended");
    return Offer::kEnded;
  }
  if (is_frame && live()) skip_backlog(bytes);
  // A message larger than the inbox goes alone.
  const bool too_many_bytes = !inbox_.empty() && inbox_bytes_ + bytes > kInboxBytes;
  if (!is_end && (inbox_.size() >= kInboxMessages || too_many_bytes)) {
    drop(waiting, "inbox");
    return Offer::kFull;
  }
  ended_ = is_end;
  if (is_frame) last_frame_ns_.store(clock_.now().count(), std::memory_order_relaxed);
  inbox_bytes_ += bytes;
  inbox_.push_back(std::move(waiting));
  return Offer::kTaken;
}

void Session::skip_backlog(std::size_t bytes) {
  const auto is_frame = [](const Waiting& w) { return std::holds_alternative<sheet::MeshFrame>(w.item); };
  auto frames = static_cast<std::size_t>(std::count_if(inbox_.begin(), inbox_.end(), is_frame));
  for (; frames > 0 && (frames >= kBacklogBudget || inbox_bytes_ + bytes > kInboxBytes); --frames) {
    const auto oldest = std::find_if(inbox_.begin(), inbox_.end(), is_frame);
    inbox_bytes_ -= oldest->bytes;
    drop(*oldest, "backlog");
    inbox_.erase(oldest);
  }
}

void Session::drop(const Waiting& waiting, const std::string& cause) {
  if (std::holds_alternative<sheet::MeshFrame>(waiting.item)) ++counters_.frames_dropped[cause];
  decisions_.dropped(waiting.arrival, waiting.sequence, cause);
}

void Session::count_drop(const std::string& cause, std::uint64_t frames) {
  if (frames == 0) return;
  std::lock_guard lock(inbox_mutex_);
  counters_.frames_received += frames;
  counters_.frames_dropped[cause] += frames;
}

void Session::discard() {
  std::lock_guard lock(inbox_mutex_);
  for (const auto& waiting : inbox_) drop(waiting, "discarded");
  inbox_.clear();
  inbox_bytes_ = 0;
}

bool Session::waiting() const {
  std::lock_guard lock(inbox_mutex_);
  return busy_ || !inbox_.empty();
}

void Session::end() {
  static_cast<void>(offer(engine::End{}, 0));
}

std::vector<Outcome> Session::take_outcomes() {
  std::lock_guard lock(outcomes_mutex_);
  return std::exchange(outcomes_, {});
}

bool Session::take_audio(std::size_t samples, AudioBlock& block) {
  if (finished_) return false;
  const bool complete = complete_.load(std::memory_order_acquire);
  const auto channels = static_cast<std::size_t>(channel_count(options_.channels));
  const std::size_t available = audio_.available() / channels;
  if (available < samples && !complete) return false;
  const std::size_t taken = std::min(available, samples);
  block.first_sample = taken_;
  block.channels = static_cast<int>(channels);
  block.interleaved.resize(taken * channels);
  audio_.pop(block.interleaved);
  taken_ += static_cast<std::int64_t>(taken);
  block.last = complete && available == taken;
  finished_ = block.last;
  return true;
}

double Session::time_of(std::int64_t sample) const {
  return origin_s_.load() + static_cast<double>(sample) / options_.rate_hz;
}

Counters Session::counters() const {
  const bool complete = complete_.load(std::memory_order_acquire);
  const RenderFigures& rendered = render_figures_.latest();
  std::int64_t due = rendered.settled_samples;
  if (live() && !complete) due = std::max(due, live_target());
  std::lock_guard lock(inbox_mutex_);
  Counters out = counters_;
  out.render = rendered.counters;
  out.samples_due = static_cast<std::uint64_t>(due);
  return out;
}

// ---------------------------------------------------------------------------------------------------- analysis worker

bool Session::analyse() {
  collect_retired();
  if (held_) hand_over(std::move(held_));
  if (held_) return false;

  Waiting next{engine::End{}, 0, 0, 0};
  bool waiting = false;
  {
    std::lock_guard lock(inbox_mutex_);
    if (!inbox_.empty()) {
      next = std::move(inbox_.front());
      inbox_.pop_front();
      inbox_bytes_ -= next.bytes;
      busy_ = true;
      waiting = true;
    }
  }
  auto batch = std::make_unique<engine::CueBatch>();
  const std::int64_t rendered = rendered_.load(std::memory_order_acquire);
  Step step;
  std::optional<engine::TimeMapping> mapping;
  if (live()) {
    step.earliest = rendered + kQuantum;
    ingest_.set_rendered(*step.earliest);
  }
  if (!waiting) {
    if (live() && quiet_.exchange(false)) {
      ingest_.fall_quiet(*batch);
      step.what = FellQuiet{};
      decisions_.taken(std::move(step));
      hand_over(std::move(batch));
    }
    return false;
  }

  const auto* frame = std::get_if<sheet::MeshFrame>(&next.item);
  if (frame != nullptr) quiet_.store(false);
  if (live() && frame != nullptr) {
    const std::int64_t due = rendered + static_cast<std::int64_t>(*options_.playout_delay_s * options_.rate_hz);
    const auto off = static_cast<double>(ingest_.sample_of(frame->time_s) - due);
    // Later than its delay absorbs, or far ahead: the sender paused, stepped or runs slower, and is followed from here.
    const double delay = std::max<double>(*options_.playout_delay_s * options_.rate_hz, kQuantum);
    if (!placed_ || off > kStep_s * options_.rate_hz || off < -delay) {
      ingest_.place(frame->time_s, due);
      mapping = engine::TimeMapping{frame->time_s, due, static_cast<double>(options_.rate_hz), *options_.playout_delay_s};
      origin_s_.store(frame->time_s - static_cast<double>(due) / options_.rate_hz);
    }
    placed_ = true;
  }
  auto observed = accept(next.item, *batch);
  if (!observed && observed.error().cause == engine::Refusal::Cause::kFailed) {
    step.what = Failed{next.arrival, next.sequence};
  } else if (next.arrival == 0 && std::holds_alternative<engine::End>(next.item)) {
    step.what = Ended{};
  } else {
    step.what = Given{next.arrival, next.sequence};
  }
  decisions_.taken(std::move(step), mapping);
  hand_over(std::move(batch));

  std::optional<observation::Observation> seen;
  {
    std::lock_guard lock(inbox_mutex_);
    busy_ = false;
    counters_.plan = ingest_.counters();
    if (!observed) {
      ++counters_.items_refused;
      if (frame != nullptr) ++counters_.frames_dropped["refused"];
    } else if (frame != nullptr) {
      ++counters_.frames_analysed;
      counters_.newest_time_s = frame->time_s;
      seen = std::move(*observed);
      if (seen) {
        counters_.crumpling_events += seen->crumpling.size();
        counters_.tear_events += seen->tears.size();
        const std::uint64_t known = newest_episode_;
        for (const auto& contact : seen->friction) {
          if (contact.id > known) ++counters_.friction_episodes;
          newest_episode_ = std::max(newest_episode_, contact.id);
        }
      }
    }
  }
  std::lock_guard lock(outcomes_mutex_);
  if (!observed) outcomes_.emplace_back(Refused{std::move(observed.error()), next.sequence});
  if (seen && !(seen->crumpling.empty() && seen->friction.empty() && seen->tears.empty() && !seen->unidentified))
    outcomes_.emplace_back(std::move(*seen));
  if (next.sequence != 0) outcomes_.emplace_back(Analysed{next.sequence});
  return true;
}

tl::expected<std::optional<observation::Observation>, engine::Refusal> Session::accept(const engine::StreamItem& item,
                                                                                       engine::CueBatch& batch) {
  try {
    return ingest_.accept(item, batch);
  } catch (const std::exception& failure) {  // such as no memory: costs this item, not everyone's session
    batch.cues.clear();
    return tl::unexpected(
        engine::Refusal{engine::Refusal::Cause::kFailed, "stream", failure.what(), "Send a smaller mesh."});
  }
}

void Session::collect_retired() {
  // Read first: what was accepted before it has been retired by then.
  const std::int64_t rendered = rendered_.load(std::memory_order_acquire);
  std::unique_ptr<engine::CueBatch> retired;
  while (retired_.pop(retired)) decisions_.accepted(retired->accepted_at);
  decisions_.rendered(rendered);
}

void Session::hand_over(std::unique_ptr<engine::CueBatch> batch) {
  const bool taken = batches_.push(std::move(batch));
  if (!taken) held_ = std::move(batch);
  held_back_.store(!taken, std::memory_order_release);
}

bool Session::wants_analysis() const {
  if (quiet_.load() || decisions_.rendered_wanted() || (decisions_.kept() && !retired_.empty())) return true;
  std::lock_guard lock(inbox_mutex_);
  return !inbox_.empty() && !held_back();
}

// ------------------------------------------------------------------------------------------------------ render worker

std::int64_t Session::live_target() const {
  const std::chrono::duration<double> running = clock_.now() - started_;
  return static_cast<std::int64_t>(running.count() * options_.rate_hz);
}

Session::RenderOutcome Session::render() {
  RenderOutcome outcome;
  if (complete_.load(std::memory_order_relaxed)) return outcome;
  if (live()) {
    while (take_batch()) {
    }
    render_quanta_until(live_target(), outcome);
    auto last_frame = last_frame_ns_.load();
    if (last_frame != 0 && clock_.now() - WallClock::Duration(last_frame) > kQuietAfter &&
        last_frame_ns_.compare_exchange_strong(last_frame, 0)) {
      quiet_.store(true);
      outcome.wants_analysis = true;
    }
    const std::int64_t step = (std::max<std::int64_t>(options_.block_size, kQuantum) + kQuantum - 1) / kQuantum * kQuantum;
    outcome.next_due = started_ + std::chrono::duration_cast<WallClock::Duration>(std::chrono::duration<double>(
                                      static_cast<double>(render_.position() + step) / options_.rate_hz));
  } else {
    do {
      render_quanta_until(render_.horizon(), outcome);
    } while (render_.position() + kQuantum > render_.horizon() && take_batch());
    // What is left over waits for room on the listener's side.
    if (render_.position() + kQuantum <= render_.horizon()) outcome.next_due = clock_.now() + std::chrono::milliseconds(2);
  }
  outcome.wants_analysis |= decisions_.kept() && !retired_.empty();
  outcome.wants_analysis |= held_back() && render_.position() + kQuantum > render_.horizon();
  if (render_.ending() && !render_.complete()) {
    render_quanta_until(render_.position() + options_.rate_hz, outcome);
    if (!render_.complete() && !live()) outcome.next_due = clock_.now() + std::chrono::milliseconds(2);
  }
  rendered_.store(render_.position(), std::memory_order_release);
  render_figures_.publish({render_.counters(), std::max(render_.position(), live() ? 0 : render_.horizon())});
  if (render_.complete()) complete_.store(true, std::memory_order_release);
  return outcome;
}

bool Session::take_batch() {
  std::unique_ptr<engine::CueBatch> batch;
  if (!batches_.pop(batch)) return false;
  batch->accepted_at = render_.position();
  render_.accept(*batch);
  retired_.push(std::move(batch));
  return true;
}

void Session::render_quanta_until(std::int64_t target, RenderOutcome& outcome) {
  const auto room = static_cast<std::size_t>(kQuantum * channel_count(options_.channels));
  while (render_.position() + kQuantum <= target && !render_.complete() && audio_.room() >= room) {
    render_.next(quantum_);
    audio_.push(quantum_.mix);
    outcome.produced = true;
  }
}

}  // namespace rustle::session
