#include "client_sdk/cpp/session_stream.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <thread>
#include <utility>

#include "client_sdk/cpp/stream_messages.h"

namespace rustle::client::internal {
namespace {

using std::chrono::milliseconds;

constexpr std::size_t kNoticesKept = 1024;
constexpr std::size_t kPutOff = 256;  ///< messages kept while a daemon is away; beyond them, what stands is told instead
constexpr milliseconds kAnswersEvery{50};
constexpr milliseconds kStep{5};

/// What may be left out rather than waited for on the live clock.
bool may_be_dropped(const v1::StreamMessage& message) {
  switch (message.body_case()) {
    case v1::StreamMessage::kFrame:
    case v1::StreamMessage::kTearTips:
    case v1::StreamMessage::kListener:
    case v1::StreamMessage::kAdvance:
      return true;
    default:
      return false;
  }
}

/// What a daemon that starts anew is told anyway.
bool stands(const v1::StreamMessage& message) {
  return message.has_sheet() || message.has_topology() || message.has_scene();
}

milliseconds until(internal::Clock::time_point deadline) {
  return std::max(milliseconds(0), std::chrono::ceil<milliseconds>(deadline - internal::Clock::now()));
}

}  // namespace

SessionStream::SessionStream(Start start)
    : connection_(std::move(start.connection)),
      link_(connection_.link()),
      id_(std::move(start.id)),
      asked_(std::move(start.asked)),
      options_(std::move(start.options)),
      streams_(std::move(start.streams)),
      reconnect_(start.reconnect),
      on_notice_(std::move(start.on_notice)),
      breaks_(start.breaks),
      recording_file_name_(std::move(start.recording_file_name)) {
  take(start.credit);
  for (const auto& parts : streams_.early) take(parts);
  streams_.early.clear();
  for (const v1::Sheet& sheet : asked_.sheets()) {
    v1::StreamMessage told;
    *told.mutable_sheet() = sheet;
    standing_.take(told);
    note(sheet);
  }
}

void SessionStream::note(const v1::Sheet& sheet) {
  KnownSheet& known = sheets_[sheet.sheet_id()];
  std::string said = sheet.SerializeAsString();
  if (known.said == said) return;
  known = {.said = std::move(said), .now = sheet};
}

void SessionStream::keep_pack(std::uint32_t sheet_id, const std::string& material, const std::string& touched_surface) {
  const auto known = sheets_.find(sheet_id);
  if (known == sheets_.end()) return;
  if (!material.empty()) known->second.now.set_material(material);
  if (!touched_surface.empty()) known->second.now.set_touched_surface(touched_surface);
}

void SessionStream::tell_again(std::vector<v1::StreamMessage> messages) {
  pending_.clear();
  for (v1::StreamMessage& message : messages) {
    if (message.has_sheet()) *message.mutable_sheet() = sheets_.at(message.sheet().sheet_id()).now;
    pending_.push_back(std::move(message));
  }
}

void SessionStream::take(const v1::FlowCredit& credit) {
  acknowledged_ = std::max(acknowledged_, credit.acknowledged_sequence());
  window_messages_ = credit.window_messages();
  window_bytes_ = credit.window_bytes();
  while (!under_way_.empty() && under_way_.front().sequence <= acknowledged_) {
    bytes_under_way_ -= under_way_.front().bytes;
    if (reconnect_) standing_.take(under_way_.front().message);
    under_way_.pop_front();
  }
}

void SessionStream::take(const std::vector<std::string>& parts) {
  v1::OutMessage message;
  if (parts.size() != 2 || !message.ParseFromString(parts[1])) return;
  if (message.has_credit()) take(message.credit());
  if (message.has_stored()) {
    recording_file_name_ = message.stored().file_name();
    stored_sequence_ = message.stored().sequence();
  }
  if (!message.has_notice()) return;
  const v1::Notice& told = message.notice();
  if (told.code() == "idle" || told.code() == "unknown_session")
    lost_ = local_error(told.code(), told.message(), told.remedy(), told.field());
  if (told.code() == "storage") recording_file_name_.clear();
  if (notices_.size() == kNoticesKept) notices_.pop_front();
  notices_.push_back(internal::read(told));
  if (on_notice_) untold_.push_back(notices_.back());
}

void SessionStream::take_answers() {
  if (detached_) return;
  for (auto parts = streams_.answers.receive(); !parts.empty(); parts = streams_.answers.receive()) take(parts);
  while (!streams_.stream.receive().empty()) {  // subscriptions of a daemon that came back
  }
  while (!untold_.empty()) {
    const Notice notice = std::move(untold_.front());
    untold_.pop_front();
    on_notice_(notice);
  }
}

/// A message larger than the whole window goes alone.
bool SessionStream::has_room(std::size_t bytes) const {
  if (!simulation()) return true;
  if (under_way_.size() >= window_messages_) return false;
  return window_bytes_ == 0 || under_way_.empty() || bytes_under_way_ + bytes <= window_bytes_;
}

tl::expected<void, Error> SessionStream::look() {
  if (failure_) return tl::unexpected(*failure_);
  const ConnectionMonitor::State state = link_->connection();
  if (comes_back()) {
    const bool idle = lost_ && lost_->code_name == "idle";
    if (!recovery_ && (state.breaks != breaks_ || idle)) {
      breaks_ = state.breaks;
      begin_recovery(idle);
    }
    if (recovery_) {
      if (auto going = recover(); !going) return going;
    }
    if (auto sent = send_pending(); !sent) return sent;
  }
  if (lost_) return tl::unexpected(*lost_);
  if (comes_back()) return {};
  if (auto there = link_->check(); !there) return there;
  // A daemon that came back may be another one. On the live clock its notices tell; a simulation would wait for credit.
  if (simulation() && state.breaks != breaks_ && state.connected) {
    if (auto known = connection_.statistics(id_); !known) return tl::unexpected(std::move(known.error()));
    breaks_ = state.breaks;
  }
  return {};
}

void SessionStream::begin_recovery(bool ended) {
  lost_.reset();
  Reattachment::Wanted wanted;
  wanted.session_id = id_;
  wanted.attach = attach_again();
  wanted.gains = gains_;
  wanted.clock = options_.clock;
  wanted.ended = ended;
  // On the live clock nobody waits.
  wanted.is_heard = [this] { return !simulation() || readers_are_heard(); };
  recovery_.emplace(link_, std::move(wanted));
}

tl::expected<void, Error> SessionStream::recover() {
  auto progress = recovery_->step();
  if (!progress) {
    recovery_.reset();
    failure_ = progress.error();
    return tl::unexpected(std::move(progress.error()));
  }
  if (*progress == Reattachment::Progress::kWaiting) return {};
  if (*progress == Reattachment::Progress::kAttached) {
    begin_again();
  } else if (tell_all_) {
    tell_again(standing_.messages());
  }
  tell_all_ = false;
  recovery_.reset();
  return {};
}

void SessionStream::begin_again() {
  streams_.stream.forget_unsent();
  const v1::Attached attached = recovery_->attached();
  streams_ = recovery_->take_streams();
  std::deque<UnderWay> unacknowledged = std::move(under_way_);
  under_way_.clear();
  bytes_under_way_ = 0;
  lost_.reset();
  ++reattached_;
  std::vector<v1::StreamMessage> told = standing_.messages();
  for (UnderWay& sent : unacknowledged) told.push_back(std::move(sent.message));
  tell_again(std::move(told));
  if (attached.has_credit()) take(attached.credit());
  recording_file_name_ = attached.recording_file_name();
  const auto early = std::exchange(streams_.early, {});
  for (const auto& parts : early) take(parts);
}

v1::Attach SessionStream::attach_again() const {
  v1::Attach attach = asked_;
  attach.mutable_options()->set_rate_hz(options_.rate_hz);
  attach.mutable_options()->set_block_size(options_.block_size);
  attach.clear_sheets();
  for (const auto& [id, sheet] : sheets_) *attach.add_sheets() = sheet.now;  // for gains that concern them
  if (const auto newest_s = standing_.newest_time_s(); simulation() && newest_s) {
    const double samples = std::floor((*newest_s - options_.time_origin_s) * options_.rate_hz);
    attach.mutable_options()->set_time_origin_s(options_.time_origin_s + std::max(0.0, samples) / options_.rate_hz);
  }
  return attach;
}

void SessionStream::keep(std::weak_ptr<Subscription> reader) {
  std::erase_if(readers_, [](const auto& known) { return known.expired(); });
  readers_.push_back(std::move(reader));
}

bool SessionStream::readers_are_heard() {
  return std::ranges::all_of(readers_, [](const auto& known) {
    const auto reader = known.lock();
    return reader == nullptr || reader->is_heard();
  });
}

void SessionStream::put_off(v1::StreamMessage message) {
  if (recovery_ && pending_.size() >= kPutOff) {
    tell_all_ = true;
    pending_.clear();
  }
  if (!tell_all_) pending_.push_back(std::move(message));
}

tl::expected<void, Error> SessionStream::send_pending() {
  while (!recovery_ && !pending_.empty()) {
    auto sent = send_now(pending_.front(), false);
    if (!sent) return tl::unexpected(std::move(sent.error()));
    if (!*sent) break;
    pending_.pop_front();
  }
  return {};
}

tl::expected<bool, Error> SessionStream::send_now(v1::StreamMessage& message, bool keep_sequence) {
  message.set_session_id(id_);
  if (!keep_sequence) {
    message.set_sequence(next_sequence_);
    message.set_sent_at_s(std::chrono::duration<double>(internal::Clock::now().time_since_epoch()).count());
  }
  const std::size_t bytes = message.ByteSizeLong();
  if (bytes > static_cast<std::size_t>(kMessageBytes))
    return tl::unexpected(local_error(
        "too_large",
        "The message has " + std::to_string(bytes) + " bytes; a daemon takes " + std::to_string(kMessageBytes) + ".",
        "Send a coarser mesh, or several smaller ones."));
  if (!has_room(bytes) || !streams_.stream.send(id_, message, milliseconds(0))) return false;
  const std::uint64_t sequence = message.sequence();
  last_sequence_ = std::max(last_sequence_, sequence);
  ++sent_messages_;
  if (sequence > 0) {
    next_sequence_ = std::max(next_sequence_, sequence + 1);
    if (simulation()) {
      under_way_.push_back({.sequence = sequence, .bytes = bytes, .message = {}});
      if (reconnect_) under_way_.back().message = std::move(message);
      bytes_under_way_ += bytes;
    }
  }
  return true;
}

SendResult SessionStream::send(v1::StreamMessage message, bool keep_sequence, bool may_drop) {
  if (detached_) return tl::unexpected(local_error("closed", "The session was detached.", "Attach a new one."));
  take_answers();
  if (auto there = look(); !there) return tl::unexpected(std::move(there.error()));
  if (message.has_sheet()) note(message.sheet());
  if (!simulation()) {
    if (may_drop && may_be_dropped(message)) {
      if (reconnect_) standing_.take(message);
      if (connected()) {
        auto sent = send_now(message, keep_sequence);
        if (!sent) return tl::unexpected(std::move(sent.error()));
        if (*sent) return Sent::kQueued;
      }
      ++dropped_messages_;
      if (!keep_sequence) message.set_sequence(next_sequence_);
      next_sequence_ = std::max(next_sequence_, message.sequence() + 1);
      return Sent::kDropped;
    }
    if (!connected() && stands(message)) {
      standing_.take(message);      // told when the session attaches again
      put_off(std::move(message));  // or here, where the daemon had the session all the time
      return Sent::kQueued;
    }
  }
  auto sent = wait_until(send_timeout, [&]() -> tl::expected<bool, Error> {
    if (!connected()) return false;
    return send_now(message, keep_sequence);
  });
  if (!sent) return tl::unexpected(std::move(sent.error()));
  if (reconnect_ && !simulation()) standing_.take(message);
  return Sent::kQueued;
}

/// Takes answers until `reached`. Errors: those of look() and `reached`, too_late().
template <typename Reached>
tl::expected<void, Error> SessionStream::wait_until(milliseconds timeout, const Reached& reached) {
  const auto deadline = internal::Clock::now() + timeout;
  for (;;) {
    tl::expected<bool, Error> done = reached();
    if (!done) return tl::unexpected(std::move(done.error()));
    if (*done) return {};
    const milliseconds left = until(deadline);
    if (left.count() == 0) return tl::unexpected(too_late(timeout));
    if (recovery_) {
      std::this_thread::sleep_for(std::min(left, kStep));
    } else {
      streams_.answers.wait(std::min(left, simulation() ? kAnswersEvery : kStep));
    }
    take_answers();
    if (auto there = look(); !there) return there;
  }
}

Error SessionStream::too_late(milliseconds waited) const {
  const std::string within = " within " + std::to_string(waited.count()) + " ms";
  if (recovery_)
    return local_error("unreachable",
                       "The daemon at " + link_->control_endpoint() + " is gone and did not come back" + within + ".",
                       "See why rustled ended, start it again, or allow more time by set_send_timeout().");
  if (simulation())
    return local_error("timeout",
                       "The daemon at " + link_->control_endpoint() + " is there but acknowledged too little" + within +
                           ": " + std::to_string(under_way_.size()) +
                           " messages are under way, the newest acknowledged is " + std::to_string(acknowledged_) + ".",
                       "See in rustled's log what it is busy with, or allow more time.");
  return local_error("timeout", "The queue to the daemon at " + link_->stream_endpoint() + " stayed full" + within + ".",
                     "See in rustled's log what it is busy with, or allow more time.");
}

tl::expected<void, Error> SessionStream::drain(milliseconds timeout) {
  if (!simulation()) return {};
  take_answers();
  if (auto there = look(); !there) return there;
  return wait_until(timeout, [&]() -> tl::expected<bool, Error> { return under_way_.empty() && pending_.empty(); });
}

std::vector<Notice> SessionStream::poll_notices() {
  take_answers();
  std::vector<Notice> out(std::make_move_iterator(notices_.begin()), std::make_move_iterator(notices_.end()));
  notices_.clear();
  return out;
}

tl::expected<Statistics, Error> SessionStream::detach(bool discard) {
  auto statistics = connection_.detach(id_, discard, last_sequence_);
  if (statistics) {
    detached_ = true;
    recovery_.reset();
  }
  return statistics;
}

void SessionStream::tell_detach() {
  v1::ControlRequest request;
  request.set_session_id(id_);
  request.mutable_detach()->set_last_sequence(last_sequence_);
  link_->tell(request);
}

}  // namespace rustle::client::internal
