#include "server/session/session.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "server/session/settled_options.h"

namespace rustle::session {
namespace {

using synthesis::kQuantum;

constexpr double kAudioRing_s = 2.0;
constexpr double kQuietAfter_s = 0.15;  // without news of what is due
constexpr double kReorderWait_s = 0.01;

double seconds(WallClock::Duration duration) {
  return std::chrono::duration<double>(duration).count();
}

WallClock::Duration duration(double time_s) {
  return std::chrono::duration_cast<WallClock::Duration>(std::chrono::duration<double>(time_s));
}

/// Of what must have a place on the sample axis even before a frame has come.
std::optional<double> time_of_scene(const engine::StreamItem& item) {
  if (const auto* update = std::get_if<scene::SceneUpdate>(&item)) return update->time_s;
  if (const auto* listener = std::get_if<scene::Listener>(&item)) return listener->time_s;
  return std::nullopt;
}

}  // namespace

Session::Session(std::string id, SessionOptions options, std::shared_ptr<pack::PackLibrary> packs, const WallClock& clock,
                 const std::shared_ptr<const spatial::Hrtf>& hrtf)
    : id_(std::move(id)),
      options_(settled(std::move(options))),
      clock_(clock),
      started_(clock.now()),
      inbox_(options_.clock == Clock::kLive),
      mappings_{{options_.time_origin_s, 0, static_cast<double>(options_.rate_hz), 0}},
      ingest_(engine_options(options_, hrtf), std::move(packs)),
      playout_({static_cast<double>(options_.rate_hz), options_.playout_delay_s}),
      delay_s_(options_.playout_delay_s.value_or(PlayoutClock::kStartDelay_s)),
      gaps_(static_cast<std::int64_t>(kQuietAfter_s * options_.rate_hz)),
      render_(engine_options(options_, hrtf)),
      quantum_(render_.make_quantum()),
      audio_(static_cast<std::size_t>(kAudioRing_s * options_.rate_hz) *
             static_cast<std::size_t>(channel_count(options_.channels))) {
  decisions_.keep(options_.record);
  counters_.playout_delay_s = delay_s_;
}

Offer Session::offer(engine::StreamItem item, std::uint64_t sequence, std::size_t bytes, std::uint64_t arrival) {
  const bool is_frame = std::holds_alternative<sheet::MeshFrame>(item);
  std::lock_guard lock(inbox_mutex_);
  ++counters_.items_received;
  if (is_frame) ++counters_.frames_received;
  const Offer offered = inbox_.offer({std::move(item), sequence, bytes, arrival, clock_.now(), false});
  count_lost();
  watch_inbox();
  return offered;
}

void Session::pass_over(std::uint64_t sequence) {
  std::lock_guard lock(inbox_mutex_);
  inbox_.pass_over(sequence);
}

void Session::count_lost() {
  for (const auto& lost : inbox_.take_lost()) {
    if (lost.is_frame) ++counters_.frames_dropped[lost.cause];
    decisions_.dropped(lost.arrival, lost.sequence, lost.cause);
  }
}

WallClock::Duration Session::reorder_wait() const {
  return duration(std::min(kReorderWait_s, delay_s_.load(std::memory_order_relaxed) / 4));
}

void Session::watch_inbox() {
  const auto ready = inbox_.ready_at(reorder_wait());
  inbox_ready_ns_.store(ready && ready->count() > 0 ? ready->count() : kNever, std::memory_order_release);
}

void Session::count_drop(const std::string& cause, std::uint64_t frames) {
  if (frames == 0) return;
  std::lock_guard lock(inbox_mutex_);
  counters_.frames_received += frames;
  counters_.frames_dropped[cause] += frames;
}

void Session::discard() {
  std::lock_guard lock(inbox_mutex_);
  inbox_.discard();
  count_lost();
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
  std::lock_guard lock(outcomes_mutex_);
  auto mapping = mappings_.rbegin();
  while (mapping->first_sample > sample && std::next(mapping) != mappings_.rend()) ++mapping;
  return mapping->time_s(static_cast<double>(sample));
}

Counters Session::counters() const {
  const bool complete = complete_.load(std::memory_order_acquire);
  const RenderFigures& rendered = render_figures_.latest();
  std::int64_t due = rendered.settled_samples;
  if (live() && !complete) due = std::max(due, live_target());
  std::lock_guard lock(inbox_mutex_);
  Counters out = counters_;
  out.render = rendered.counters;
  out.input_gaps = rendered.input_gaps;
  out.sequence_gaps = inbox_.sequence_gaps();
  out.samples_due = static_cast<std::uint64_t>(due);
  return out;
}

// ---------------------------------------------------------------------------------------------------- analysis worker

bool Session::analyse() {
  collect_retired();
  if (held_) hand_over(std::move(held_));
  if (held_) return false;

  std::optional<Inbox::Waiting> next = next_item();
  auto batch = std::make_unique<engine::CueBatch>();
  const std::int64_t rendered = rendered_.load(std::memory_order_acquire);
  Step step;
  std::optional<engine::TimeMapping> mapping;
  if (live()) {
    step.earliest = rendered + kQuantum;
    ingest_.set_rendered(*step.earliest);
  }
  if (!next) {
    if (live() && quiet_.exchange(false)) {
      ingest_.fall_quiet(*batch);
      step.what = FellQuiet{};
      decisions_.taken(std::move(step));
      hand_over(std::move(batch));
    }
    return false;
  }

  const auto* frame = std::get_if<sheet::MeshFrame>(&next->item);
  if (frame != nullptr) quiet_.store(false);
  if (live()) {
    if (next->steps_back) {
      ingest_.start_again(*batch);
      step.start_again = true;
    }
    mapping = map_time(*next, rendered);
  }
  const bool late = live() && frame != nullptr && ingest_.sample_of(frame->time_s) < *step.earliest;
  auto observed = accept(next->item, *batch);
  if (!observed && observed.error().cause == engine::Refusal::Cause::kFailed) {
    step.what = Failed{next->arrival, next->sequence};
  } else if (next->arrival == 0 && std::holds_alternative<engine::End>(next->item)) {
    step.what = Ended{};
  } else {
    step.what = Given{next->arrival, next->sequence};
  }
  decisions_.taken(std::move(step), mapping);
  hand_over(std::move(batch));
  if (live()) cover(next->item, observed.has_value());

  std::optional<observation::Observation> seen;
  {
    std::lock_guard lock(inbox_mutex_);
    busy_ = false;
    counters_.plan = ingest_.counters();
    if (live()) {
      counters_.time_jumps = time_jumps_;
      counters_.playout_delay_s = playout_.delay_s();
      counters_.clock_drift_ppm = playout_.drift_ppm();
    }
    if (!observed) {
      ++counters_.items_refused;
      if (frame != nullptr) ++counters_.frames_dropped["refused"];
    } else if (frame != nullptr) {
      ++counters_.frames_analysed;
      if (late) ++counters_.frames_late;
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
  if (!observed) outcomes_.emplace_back(Refused{std::move(observed.error()), next->sequence});
  if (seen && !(seen->crumpling.empty() && seen->friction.empty() && seen->tears.empty() && !seen->unidentified))
    outcomes_.emplace_back(std::move(*seen));
  if (next->sequence != 0) outcomes_.emplace_back(Analysed{next->sequence});
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

std::optional<Inbox::Waiting> Session::next_item() {
  std::lock_guard lock(inbox_mutex_);
  auto next = inbox_.take(clock_.now(), reorder_wait());
  count_lost();
  watch_inbox();
  busy_ = next.has_value();
  return next;
}

std::optional<engine::TimeMapping> Session::map_time(const Inbox::Waiting& next, synthesis::SampleTime rendered) {
  if (next.steps_back) playout_.start_again();
  engine::TimeMapping mapping;
  if (const auto* frame = std::get_if<sheet::MeshFrame>(&next.item)) {
    const bool anew = playout_.placed() || next.steps_back;
    const auto change = playout_.frame(frame->time_s, seconds(next.arrived - started_));
    if (change == PlayoutClock::Change::kNone) return std::nullopt;
    if (change == PlayoutClock::Change::kPlaced && anew) ++time_jumps_;
    mapping = playout_.mapping();
    delay_s_.store(playout_.delay_s(), std::memory_order_relaxed);
  } else {
    const auto time_s = time_of_scene(next.item);
    if (playout_.placed() || !time_s) return std::nullopt;
    mapping = {*time_s, rendered + static_cast<std::int64_t>(delay_s_ * options_.rate_hz),
               static_cast<double>(options_.rate_hz), delay_s_};
  }
  ingest_.map_time(mapping);
  std::lock_guard lock(outcomes_mutex_);
  mappings_.push_back(mapping);
  while (mappings_.size() > 1 && mappings_[1].first_sample < rendered - options_.rate_hz) mappings_.pop_front();
  return mapping;
}

void Session::cover(const engine::StreamItem& item, bool taken) {
  if (std::holds_alternative<engine::End>(item)) gaps_.cover_all();
  if (!playout_.placed() || !taken) return;
  std::optional<double> newest_s;
  if (std::holds_alternative<sheet::MeshFrame>(item)) {
    playout_.ready(seconds(clock_.now() - started_));
    newest_s = playout_.newest_s();
  }
  if (const auto* advance = std::get_if<engine::Advance>(&item)) newest_s = std::max(playout_.newest_s(), advance->time_s);
  if (!newest_s) return;
  const std::int64_t newest = ingest_.sample_of(*newest_s);
  gaps_.cover(newest, newest + static_cast<std::int64_t>(playout_.carry_s() * options_.rate_hz));
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
  const auto ready = inbox_.ready_at(reorder_wait());
  return ready && *ready <= clock_.now() && !held_back();
}

// ------------------------------------------------------------------------------------------------------ render worker

std::int64_t Session::live_target() const {
  return static_cast<std::int64_t>(seconds(clock_.now() - started_) * options_.rate_hz);
}

Session::RenderOutcome Session::render() {
  RenderOutcome outcome;
  if (complete_.load(std::memory_order_relaxed)) return outcome;
  if (live()) {
    while (take_batch()) {
    }
    render_quanta_until(live_target(), outcome);
    if (gaps_.rendered(render_.position())) {
      quiet_.store(true);
      outcome.wants_analysis = true;
    }
    const std::int64_t step = (std::max<std::int64_t>(options_.block_size, kQuantum) + kQuantum - 1) / kQuantum * kQuantum;
    outcome.next_due = started_ + duration(static_cast<double>(render_.position() + step) / options_.rate_hz);
    std::int64_t inbox_ready = inbox_ready_ns_.load(std::memory_order_acquire);
    if (inbox_ready <= clock_.now().count()) {
      outcome.wants_analysis |= inbox_ready_ns_.compare_exchange_strong(inbox_ready, kNever);
    } else if (inbox_ready != kNever) {
      outcome.next_due = std::min(*outcome.next_due, WallClock::Duration(inbox_ready));
    }
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
  render_figures_.publish(
      {render_.counters(), std::max(render_.position(), live() ? 0 : render_.horizon()), gaps_.figures()});
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
