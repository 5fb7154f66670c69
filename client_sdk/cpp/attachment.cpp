#include "client_sdk/cpp/attachment.h"

#include <utility>

namespace rustle::client::internal {
namespace {

using std::chrono::milliseconds;

constexpr int kLiveQueueMessages = 64;
constexpr int kSimulationQueueMessages = 4096;
constexpr int kAnswerQueueMessages = 65'536;
constexpr milliseconds kAnswerWithin{1'000};
constexpr milliseconds kAgainAfter{100};

bool passes(int code) {
  return code == v1::ERROR_CODE_SESSION_EXISTS || code == v1::ERROR_CODE_QUOTA_EXCEEDED || code == v1::ERROR_CODE_OVERLOADED;
}

}  // namespace

StreamOpening::StreamOpening(Streams streams, std::string session_id, std::string marker)
    : streams_(std::move(streams)), session_id_(std::move(session_id)), marker_(std::move(marker)) {}

tl::expected<StreamOpening, Error> StreamOpening::begin(const Link& link, const std::string& session_id,
                                                        rustle::client::Clock clock) {
  auto answers = Socket::connect(link.context(), Socket::Role::kListener, link.out_endpoint(),
                                 {.send = 0, .receive = kAnswerQueueMessages});
  if (!answers) return tl::unexpected(std::move(answers.error()));
  const std::string marker = "subscribed/" + nonce();
  for (const std::string& topic : {session_id + "/acknowledgements", session_id + "/notices", marker})
    answers->subscribe(topic);
  const bool simulation = clock == rustle::client::Clock::kSimulation;
  auto stream = Socket::connect(link.context(), Socket::Role::kStream, link.stream_endpoint(),
                                {.send = simulation ? kSimulationQueueMessages : kLiveQueueMessages, .receive = 0});
  if (!stream) return tl::unexpected(std::move(stream.error()));
  return StreamOpening({.stream = std::move(*stream), .answers = std::move(*answers)}, session_id, marker);
}

bool StreamOpening::step() {
  while (!heard_) {
    auto parts = streams_.answers.receive();
    if (parts.empty()) break;
    heard_ = parts.front() == marker_;
    if (!heard_) streams_.early.push_back(std::move(parts));
  }
  while (!taken_) {
    const auto parts = streams_.stream.receive();
    if (parts.empty()) break;
    const std::string& change = parts.front();
    taken_ = !change.empty() && change[0] == 1 && session_id_.starts_with(change.substr(1));
  }
  if (!heard_ || !taken_) return false;
  streams_.answers.unsubscribe(marker_);
  return true;
}

void StreamOpening::wait(milliseconds timeout) const {
  (heard_ ? streams_.stream : streams_.answers).wait(timeout);
}

Reattachment::Reattachment(std::shared_ptr<Link> link, Wanted wanted) : link_(std::move(link)), wanted_(std::move(wanted)) {}

tl::expected<Reattachment::Progress, Error> Reattachment::step() {
  for (;;) {
    tl::expected<std::optional<Progress>, Error> next = std::nullopt;
    switch (state_) {
      case State::kBegin: {
        auto control = Socket::connect(link_->context(), Socket::Role::kControl, link_->control_endpoint(),
                                       {.send = 16, .receive = 16});
        if (!control) return tl::unexpected(std::move(control.error()));
        control->forget_unsent();
        control_ = std::move(*control);
        ask(State::kHello, hello());
        break;
      }
      case State::kHello:
      case State::kKnown:
      case State::kAttach:
      case State::kGains:
        next = follow(answer());
        break;
      case State::kReaders:
        if (!wanted_.is_heard() && internal::Clock::now() < deadline_) return Progress::kWaiting;
        if (auto opening = StreamOpening::begin(*link_, wanted_.session_id, wanted_.clock)) {
          opening_ = std::move(*opening);
          state_ = State::kStreams;
          deadline_ = internal::Clock::now() + 2 * kAnswerWithin;
        } else {
          return tl::unexpected(std::move(opening.error()));
        }
        break;
      case State::kStreams:
        if (opening_->step()) return Progress::kAttached;
        if (internal::Clock::now() < deadline_) return Progress::kWaiting;
        begin_again();
        break;
      case State::kPause:
        if (internal::Clock::now() < deadline_) return Progress::kWaiting;
        begin_again();
        break;
    }
    if (!next) return tl::unexpected(std::move(next.error()));
    if (*next) return **next;
  }
}

void Reattachment::ask(State state, v1::ControlRequest request) {
  state_ = state;
  request_ = std::move(request);
  request_.set_request_id(next_request_++);
  sent_ = false;
}

Reattachment::Answer Reattachment::answer() {
  if (!sent_) {
    sent_ = control_->send(request_, milliseconds(0));  // until the daemon is there
    if (!sent_) return {.kind = Answer::Kind::kWaiting};
    deadline_ = internal::Clock::now() + kAnswerWithin;
  }
  for (auto parts = control_->receive(); !parts.empty(); parts = control_->receive()) {
    v1::ControlReply reply;
    if (parts.size() != 1 || !reply.ParseFromString(parts.front()) || reply.request_id() != request_.request_id()) continue;
    if (reply.has_error()) return {.kind = Answer::Kind::kRefused, .error = from_wire(reply.error())};
    return {.kind = Answer::Kind::kReply, .reply = std::move(reply)};
  }
  return {.kind = internal::Clock::now() < deadline_ ? Answer::Kind::kWaiting : Answer::Kind::kNone};
}

tl::expected<std::optional<Reattachment::Progress>, Error> Reattachment::follow(Answer answer) {
  switch (answer.kind) {
    case Answer::Kind::kWaiting:
      return Progress::kWaiting;
    case Answer::Kind::kNone:  // the connection broke again
      begin_again();
      return Progress::kWaiting;
    case Answer::Kind::kRefused:
      return refused(answer.error);
    case Answer::Kind::kReply:
      break;
  }
  switch (state_) {
    case State::kHello: {
      auto server = read_welcome(answer.reply);
      if (!server) return tl::unexpected(std::move(server.error()));
      link_->set_server(std::move(*server));
      v1::ControlRequest request;
      request.set_session_id(wanted_.session_id);
      request.mutable_get_statistics();
      ask(State::kKnown, std::move(request));
      break;
    }
    case State::kKnown:  // it is there
      if (attached_) {
        await_readers();
      } else if (!wanted_.ended) {
        return Progress::kThere;
      } else {
        pause();
      }
      break;
    case State::kAttach:
      attached_ = answer.reply.attached();
      if (wanted_.gains.empty()) {
        await_readers();
      } else {
        v1::ControlRequest request;
        request.set_session_id(wanted_.session_id);
        for (const Gain& gain : wanted_.gains) to_wire(gain, request.mutable_set_gains()->add_gains());
        ask(State::kGains, std::move(request));
      }
      break;
    default:
      await_readers();
      break;
  }
  return std::nullopt;
}

tl::expected<std::optional<Reattachment::Progress>, Error> Reattachment::refused(const Error& error) {
  if (state_ == State::kKnown && error.code == v1::ERROR_CODE_UNKNOWN_SESSION) {
    v1::ControlRequest request;
    request.set_session_id(wanted_.session_id);
    *request.mutable_attach() = wanted_.attach;
    ask(State::kAttach, std::move(request));
    return std::nullopt;
  }
  if (!passes(error.code)) return tl::unexpected(error);
  pause();
  return std::nullopt;
}

void Reattachment::await_readers() {
  state_ = State::kReaders;
  deadline_ = internal::Clock::now() + kAnswerWithin;
}

void Reattachment::pause() {
  state_ = State::kPause;
  deadline_ = internal::Clock::now() + kAgainAfter;
}

void Reattachment::begin_again() {
  state_ = State::kBegin;
  control_.reset();
  opening_.reset();
}

}  // namespace rustle::client::internal
