#include "server/session/session.h"

#include <algorithm>
#include <cmath>
#include <new>
#include <utility>

#include "server/session/settled_options.h"
#include "server/synthesis/nonblocking_scope.h"

namespace rustle::session {
namespace {

using synthesis::kQuantum;

constexpr double kAudioRing_s = 2.0;
constexpr double kStemRing_s = 1.0;
constexpr double kQuietAfter_s = 0.15;  // without news of what is due
constexpr double kReorderWait_s = 0.01;
constexpr std::int64_t kSecond = std::nano::den;  // of the clock's
constexpr double kLeastGrace_s = 0.002;           // of a block's deadline
constexpr double kIdleAfter_s = 1;                // without anything from analysis
constexpr WallClock::Duration kIdleStep = std::chrono::milliseconds(20);

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

/// What came by control and not in a message.
std::optional<Asked> asked_of(const engine::StreamItem& item) {
  if (const auto* gains = std::get_if<engine::GainChange>(&item)) return *gains;
  if (const auto* change = std::get_if<engine::PackChange>(&item)) return *change;
  if (const auto* reload = std::get_if<engine::PackReload>(&item)) return *reload;
  if (const auto* load = std::get_if<engine::LoadLevel>(&item)) return *load;
  if (const auto* move = std::get_if<engine::ListenerMove>(&item)) return *move;
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
             static_cast<std::size_t>(channel_count(options_.channels))),
      stem_(static_cast<std::size_t>(kQuantum * channel_count(options_.channels))) {
  decisions_.keep(options_.record);
  counters_.playout_delay_s = delay_s_;
}

Offer Session::offer(engine::StreamItem item, std::uint64_t sequence, std::size_t bytes, std::uint64_t arrival,
                     WallClock::Duration received) {
  const auto* frame = std::get_if<sheet::MeshFrame>(&item);
  const auto now = clock_.now();
  std::lock_guard lock(inbox_mutex_);
  ++counters_.items_received;
  std::uint64_t number = 0;
  if (frame != nullptr) {
    ++counters_.frames_received;
    if (received.count() == 0) received = now;
    number = traces_.begin(sequence, *frame, received, now);
    times_.decode.add(now - received);
  }
  const Offer offered = inbox_.offer({std::move(item), sequence, bytes, arrival, now, false, number});
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
    traces_.drop(lost.frame, lost.cause);
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

void Session::drop_frame(std::uint64_t arrival, std::uint64_t sequence, const char* cause) {
  std::lock_guard lock(inbox_mutex_);
  ++counters_.frames_received;
  ++counters_.frames_dropped[cause];
  inbox_.pass_over(sequence);
  decisions_.dropped(arrival, sequence, cause);
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
  stems_.collect();
  emitters_.collect();
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

std::shared_ptr<StemTap> Session::open_stem(sheet::SheetId sheet, synthesis::SoundKind kind) {
  const auto channels = static_cast<double>(channel_count(options_.channels));
  auto stem = std::make_shared<StemTap>(sheet, kind, static_cast<std::size_t>(kStemRing_s * options_.rate_hz * channels));
  return stems_.open(stem) ? stem : nullptr;
}

std::shared_ptr<EmitterTap> Session::open_emitters() {
  auto emitters = std::make_shared<EmitterTap>(render_.make_emitters());
  return emitters_.open(emitters) ? emitters : nullptr;
}

double Session::time_of(std::int64_t sample) const {
  std::lock_guard lock(outcomes_mutex_);
  auto mapping = mappings_.rbegin();
  while (mapping->first_sample > sample && std::next(mapping) != mappings_.rend()) ++mapping;
  return mapping->time_s(static_cast<double>(sample));
}

engine::TimeMapping Session::mapping() const {
  std::lock_guard lock(outcomes_mutex_);
  return mappings_.back();
}

void Session::watch(std::shared_ptr<Watch> watch) {
  const bool watched = watch != nullptr;
  {
    std::lock_guard lock(watch_mutex_);
    watch_.swap(watch);
  }
  watched_.store(watched, std::memory_order_release);
}

std::shared_ptr<Watch> Session::watch_now() {
  if (!watched_.load(std::memory_order_relaxed)) return nullptr;
  std::lock_guard lock(watch_mutex_);
  return watch_;
}

Counters Session::counters() const {
  const bool complete = complete_.load(std::memory_order_acquire);
  const RenderFigures& rendered = render_figures_.latest();
  std::int64_t due = rendered.settled_samples;
  if (live() && !complete) due = std::max(due, live_target());
  std::lock_guard lock(inbox_mutex_);
  Counters out = counters_;
  out.render = rendered.counters;
  out.emitter_samples_left_out = rendered.emitter_samples_left_out;
  out.input_gaps = rendered.input_gaps;
  out.sequence_gaps = inbox_.sequence_gaps();
  out.samples_due = static_cast<std::uint64_t>(due);
  out.deadline_misses = deadline_misses_.load(std::memory_order_relaxed);
  out.late_by_run_delay = late_by_run_delay_.load(std::memory_order_relaxed);
  return out;
}

void Session::sound_left(std::int64_t sample) {
  traces_.sent(sample, clock_.now(), live() ? &times_.sound : nullptr);
}

WallClock::Duration Session::analysis_stalled() const {
  std::lock_guard lock(inbox_mutex_);
  const auto next = inbox_.next_arrived();
  if (!busy_ && !next) return {};
  return clock_.now() - std::max(taken_at_, next.value_or(taken_at_));
}

// ---------------------------------------------------------------------------------------------------- analysis worker

bool Session::analyse() {
  try {
    return analyse_next();
  } catch (const std::bad_alloc&) {
    leave_item();
    return wants_analysis();
  }
}

void Session::leave_item() {
  std::uint64_t sequence = 0;
  {
    std::lock_guard lock(inbox_mutex_);
    if (!std::exchange(busy_, false)) return;
    ++counters_.items_refused;
    if (std::exchange(frame_uncounted_, false)) ++counters_.frames_dropped["memory"];
    sequence = taken_sequence_;
  }
  std::lock_guard lock(outcomes_mutex_);
  if (sequence != 0) outcomes_.emplace_back(Analysed{sequence});
  has_news.store(true);
}

bool Session::analyse_next() {
  collect_retired();
  if (held_) hand_over(std::move(held_));
  if (held_) return false;

  auto batch = std::make_unique<engine::CueBatch>();
  std::optional<Inbox::Waiting> next = next_item();
  const std::int64_t rendered = rendered_.load(std::memory_order_acquire);
  Step step;
  std::optional<engine::TimeMapping> mapping;
  if (live()) {
    step.earliest = rendered + kQuantum;
    ingest_.set_rendered(*step.earliest);
  }
  if (!next) {
    if (const auto watch = watch_now()) watch->look(ingest_);
    if (live() && quiet_.exchange(false)) {
      ingest_.fall_quiet(*batch);
      step.what = FellQuiet{};
      send(std::move(step), {}, std::move(batch));
    }
    return false;
  }

  const auto* frame = std::get_if<sheet::MeshFrame>(&next->item);
  const auto begun = clock_.now();
  if (frame != nullptr) {
    quiet_.store(false);
    traces_.pass(next->frame, Station::kBegun, begun);
    times_.wait.add(begun - next->arrived);
  }
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
  } else if (auto asked = asked_of(next->item)) {
    step.what = std::move(*asked);
  } else {
    step.what = Given{next->arrival, next->sequence};
  }
  if (frame != nullptr) {
    const auto analysed = clock_.now();
    times_.analysis.add(analysed - begun);
    analysis_ns_.fetch_add((analysed - begun).count(), std::memory_order_relaxed);
    const std::int64_t first_sample = ingest_.sample_of(frame->time_s);
    traces_.place(next->frame, live() ? std::max(first_sample, *step.earliest) : first_sample,
                  delay_s_.load(std::memory_order_relaxed));
    if (!observed) traces_.drop(next->frame, "refused");
    traces_.pass(next->frame, Station::kAnalysed, analysed);
    batch->frame = next->frame;
  }
  send(std::move(step), mapping, std::move(batch));
  if (live()) cover(next->item, observed.has_value());
  if (const auto watch = watch_now(); watch && observed) {
    if (auto* seen = std::get_if<sheet::MeshFrame>(&next->item); seen != nullptr && *observed) {
      watch->saw(ingest_, std::move(*seen), **observed, clock_.now());
    } else {
      watch->look(ingest_);
    }
  }

  std::optional<observation::Observation> seen;
  {
    std::lock_guard lock(inbox_mutex_);
    busy_ = frame_uncounted_ = false;
    counters_.plan = ingest_.counters();
    if (const auto* load = std::get_if<engine::LoadLevel>(&next->item)) counters_.load_level = load->level;
    if (live()) {
      counters_.time_jumps = time_jumps_;
      counters_.playout_delay_s = playout_.delay_s() + latency_s();
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
        counters_.events_joined += seen->events_joined;
        const std::uint64_t known = newest_episode_;
        for (const auto& tear : seen->tears) {
          if (tear.id > known) ++counters_.tear_events;
          newest_episode_ = std::max(newest_episode_, tear.id);
        }
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
  has_news.store(true);
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
  if (busy_) {
    taken_at_ = clock_.now();
    taken_sequence_ = next->sequence;
    frame_uncounted_ = std::holds_alternative<sheet::MeshFrame>(next->item);
  }
  return next;
}

std::optional<engine::TimeMapping> Session::map_time(const Inbox::Waiting& next, synthesis::SampleTime rendered) {
  if (next.steps_back) playout_.start_again();
  engine::TimeMapping mapping;
  if (const auto* frame = std::get_if<sheet::MeshFrame>(&next.item)) {
    const bool anew = playout_.placed() || next.steps_back;
    const auto change = playout_.frame(frame->time_s, seconds(next.arrived - started_));
    const synthesis::SampleTime latency = ingest_.latency();
    if (change == PlayoutClock::Change::kNone && latency == latency_) return std::nullopt;
    latency_ = latency;
    if (change == PlayoutClock::Change::kPlaced && anew) ++time_jumps_;
    mapping = playout_.mapping();
    delay_s_.store(playout_.delay_s(), std::memory_order_relaxed);
    mapping.first_sample += latency;
    mapping.playout_delay_s += latency_s();
  } else {
    const auto time_s = time_of_scene(next.item);
    if (playout_.placed() || !time_s) return std::nullopt;
    latency_ = ingest_.latency();
    mapping = {*time_s, rendered + latency_ + static_cast<std::int64_t>(delay_s_ * options_.rate_hz),
               static_cast<double>(options_.rate_hz), delay_s_ + latency_s()};
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
  for (; retired_.pop(retired); --under_way_) decisions_.accepted(retired->accepted_at);
  decisions_.rendered(rendered);
  if (under_way_ == 0) ingest_.settle(rendered);
}

void Session::send(Step step, const std::optional<engine::TimeMapping>& mapping, std::unique_ptr<engine::CueBatch> batch) {
  decisions_.taken(std::move(step), mapping);
  ++under_way_;
  hand_over(std::move(batch));
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

std::int64_t Session::live_target() const noexcept {
  return samples_due(clock_.now());
}

std::int64_t Session::samples_due(WallClock::Duration now) const noexcept {
  return static_cast<std::int64_t>(seconds(now - started_) * options_.rate_hz);
}

std::int64_t Session::live_step_target() const noexcept {
  if (step_blocks_.load(std::memory_order_relaxed) <= 1) return live_target();
  return samples_due(shared_moment(shared_moments()));
}

std::int64_t Session::shared_moments() const noexcept {
  const std::int64_t rate_hz = options_.rate_hz, now = clock_.now().count();
  const std::int64_t samples = now / kSecond * rate_hz + now % kSecond * rate_hz / kSecond;
  return samples / (quanta_of_block() * step_blocks_.load(std::memory_order_relaxed));
}

WallClock::Duration Session::shared_moment(std::int64_t number) const noexcept {
  const std::int64_t rate_hz = options_.rate_hz;
  const std::int64_t samples = number * quanta_of_block() * step_blocks_.load(std::memory_order_relaxed);
  return WallClock::Duration(samples / rate_hz * kSecond + (samples % rate_hz * kSecond + rate_hz - 1) / rate_hz);
}

Session::RenderOutcome Session::render() noexcept {
  const synthesis::NonblockingScope nonblocking;
  RenderOutcome outcome;
  if (complete_.load(std::memory_order_relaxed)) return outcome;
  const auto began = clock_.now();
  const std::int64_t promised = step_;
  const std::int64_t from = render_.position() + promised - quanta_of_block();  // no block before it can be late
  if (live()) {
    while (take_batch()) {
    }
    render_quanta_until(live_step_target(), outcome);
    if (gaps_.rendered(render_.position())) {
      quiet_.store(true);
      outcome.wants_analysis = true;
    }
    outcome.next_due = next_due();
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
  render_figures_.publish({render_.counters(), emitter_samples_left_out_,
                           std::max(render_.position(), live() ? 0 : render_.horizon()), gaps_.figures()});
  if (render_.complete()) complete_.store(true, std::memory_order_release);
  if (outcome.produced || render_.complete()) has_news.store(true, std::memory_order_release);
  if (outcome.produced) {
    const auto ended = clock_.now();
    times_.render.add(ended - began);
    if (live() && promised > 0 && !render_.ending()) judge_lateness(from, ended, outcome);
  }
  return outcome;
}

WallClock::Duration Session::next_due() noexcept {
  const std::int64_t position = render_.position();
  auto block_due = started_ + duration(static_cast<double>(position + quanta_of_block()) / options_.rate_hz);
  step_ = quanta_of_block();
  if (step_blocks_.load(std::memory_order_relaxed) > 1) {
    block_due = shared_moment(shared_moments() + 1);
    step_ = samples_due(block_due) - position;
  }
  const bool quiet = static_cast<double>(position - accepted_at_) > kIdleAfter_s * options_.rate_hz && render_.silent();
  // Said before looking: analysis calls for rendering when it hands something over after that.
  idle_.store(quiet);
  if (!quiet || !batches_.empty()) return block_due;
  const auto due = (block_due + kIdleStep - WallClock::Duration(1)) / kIdleStep * kIdleStep;
  step_ = std::max(step_, static_cast<std::int64_t>(seconds(due - started_) * options_.rate_hz) - position);
  return due;
}

std::int64_t Session::quanta_of_block() const noexcept {
  return (std::max<std::int64_t>(options_.block_size, kQuantum) + kQuantum - 1) / kQuantum * kQuantum;
}

void Session::judge_lateness(std::int64_t from, WallClock::Duration now, RenderOutcome& outcome) const noexcept {
  const double rate_hz = options_.rate_hz, block = static_cast<double>(quanta_of_block());
  const double grace_s = std::max(step_blocks_.load(std::memory_order_relaxed) * block / rate_hz, kLeastGrace_s);
  // Blocks that end after `from` and were due before this moment are late.
  const double in_time_from = (seconds(now - started_) - grace_s) * rate_hz;
  const double late = std::floor((in_time_from - static_cast<double>(from)) / block);
  if (late < 1) return;
  const std::int64_t rendered = std::max<std::int64_t>(0, render_.position() - from) / quanta_of_block();
  outcome.blocks_late = static_cast<std::uint64_t>(std::min(static_cast<std::int64_t>(late), rendered));
  outcome.due = started_ + duration((static_cast<double>(from) + block) / rate_hz);
  outcome.late = duration((in_time_from - static_cast<double>(from) - block) / rate_hz);
}

void Session::count_late(std::uint64_t blocks, bool by_run_delay) noexcept {
  auto& count = by_run_delay ? late_by_run_delay_ : deadline_misses_;
  count.store(count.load(std::memory_order_relaxed) + blocks, std::memory_order_relaxed);
}

bool Session::take_batch() noexcept {
  std::unique_ptr<engine::CueBatch> batch;
  if (!batches_.pop(batch)) return false;
  batch->accepted_at = render_.position();
  render_.accept(*batch);
  accepted_at_ = render_.position();
  if (batch->frame != 0) {
    const auto waited = traces_.pass(batch->frame, Station::kAccepted, clock_.now());
    if (waited.count() >= 0) times_.hand_over.add(waited);
  }
  retired_.push(std::move(batch));
  return true;
}

void Session::render_quanta_until(std::int64_t target, RenderOutcome& outcome) noexcept {
  // After what analysis has handed over: who listened before something was sent hears it from the beginning.
  stems_.attend();
  emitters_.attend();
  while (render_.position() + kQuantum <= target && !render_.complete() && room_for_quantum()) {
    quantum_.emitters = emitters_.open().empty() ? nullptr : emitters_.open().front()->sounds.get();
    render_.next(quantum_);
    audio_.push(quantum_.mix);
    feed_stems();
    feed_emitters();
    outcome.produced = true;
  }
}

bool Session::room_for_quantum() const noexcept {
  const std::size_t needed = stem_.size();
  if (!emitters_.open().empty() && emitters_.open().front()->quanta.room() < synthesis::kMostEmitters) return false;
  return audio_.room() >= needed &&
         std::ranges::all_of(stems_.open(), [&](const auto& stem) { return stem->audio.room() >= needed; });
}

void Session::feed_stems() noexcept {
  for (const auto& stem : stems_.open()) {
    if (!stem->bus) stem->bus = render_.bus_of(stem->sheet, stem->kind);
    if (!stem->first_sample) stem->first_sample = quantum_.first_sample;
    if (stem->bus) {
      render_.stem(*stem->bus, stem_);
    } else {
      std::ranges::fill(stem_, 0.0f);
    }
    stem->audio.push(stem_);
  }
}

void Session::feed_emitters() noexcept {
  if (!quantum_.emitters) return;
  EmitterTap& tap = *emitters_.open().front();
  for (const synthesis::EmitterSound& sound : quantum_.emitters->sounds()) {
    const auto sheet = static_cast<std::size_t>(synthesis::sheet_of(sound.bus));
    tap.quanta.push({quantum_.first_sample, quantum_.sheets[sheet], sound});
  }
  emitter_samples_left_out_ += quantum_.emitters->take_left_out();
}

}  // namespace rustle::session
