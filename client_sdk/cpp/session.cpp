#include "client_sdk/cpp/session.h"

#include <algorithm>
#include <deque>
#include <map>
#include <utility>

#include "client_sdk/cpp/stream_messages.h"
#include "client_sdk/cpp/transport.h"

namespace rustle::client {
namespace {

using internal::local_error;
using internal::Socket;
using std::chrono::milliseconds;

constexpr std::size_t kNoticesKept = 1024;
constexpr milliseconds kLookEvery{50};
constexpr int kLiveQueueMessages = 64;
constexpr int kSimulationQueueMessages = 4096;

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

milliseconds until(internal::Clock::time_point deadline) {
  return std::max(milliseconds(0), std::chrono::ceil<milliseconds>(deadline - internal::Clock::now()));
}

}  // namespace

struct Session::Impl {
  Connection connection;
  Socket stream;   ///< XPUB to the daemon's SUB
  Socket answers;  ///< SUB: credits and notices
  std::string id;
  SessionOptions options;
  milliseconds send_timeout{10'000};
  bool detached = false;

  std::uint64_t breaks;             ///< of the control connection, when the session was last known to be there
  std::optional<Error> ended{};     ///< by the daemon
  std::uint64_t last_sequence = 0;  ///< of what was sent
  std::uint64_t next_sequence = 1;
  std::uint64_t sent_messages = 0;
  std::uint64_t dropped_messages = 0;
  std::map<std::uint64_t, std::uint32_t> topology_vertices{};

  struct UnderWay {
    std::uint64_t sequence;
    std::size_t bytes;
  };
  std::deque<UnderWay> under_way{};  ///< simulation clock: sent, not yet acknowledged
  std::size_t bytes_under_way = 0;
  std::uint64_t acknowledged = 0;
  std::uint32_t window_messages = 0;
  std::uint64_t window_bytes = 0;
  std::deque<Notice> notices{};

  bool simulation() const { return options.clock == Clock::kSimulation; }

  void take(const v1::FlowCredit& credit) {
    acknowledged = std::max(acknowledged, credit.acknowledged_sequence());
    window_messages = credit.window_messages();
    window_bytes = credit.window_bytes();
    while (!under_way.empty() && under_way.front().sequence <= acknowledged) {
      bytes_under_way -= under_way.front().bytes;
      under_way.pop_front();
    }
  }

  void take(const std::vector<std::string>& parts) {
    v1::OutMessage message;
    if (parts.size() != 2 || !message.ParseFromString(parts[1])) return;
    if (message.has_credit()) take(message.credit());
    if (message.has_notice()) {
      const v1::Notice& told = message.notice();
      if (told.code() == "idle" || told.code() == "unknown_session")
        ended = local_error(told.code(), told.message(), told.remedy(), told.field());
      if (notices.size() == kNoticesKept) notices.pop_front();
      notices.push_back(internal::read(message.notice()));
    }
  }

  void take_answers() {
    for (auto parts = answers.receive(); !parts.empty(); parts = answers.receive()) take(parts);
    while (!stream.receive().empty()) {  // subscriptions of a daemon that came back
    }
  }

  /// A message larger than the whole window goes alone.
  bool has_room(std::size_t bytes) const {
    if (under_way.size() >= window_messages) return false;
    return window_bytes == 0 || under_way.empty() || bytes_under_way + bytes <= window_bytes;
  }

  /// Whether the session can still be there.
  tl::expected<void, Error> check() {
    if (ended) return tl::unexpected(*ended);
    internal::Link& link = *connection.link();
    if (auto there = link.check(); !there) return there;
    // A daemon that came back may be another one. On the live clock its notices tell; a simulation would wait for credit.
    const auto now = link.connection();
    if (!simulation() || now.breaks == breaks || !now.connected) return {};
    if (auto known = connection.statistics(id); !known) return tl::unexpected(std::move(known.error()));
    breaks = now.breaks;
    return {};
  }

  /// Takes answers until `reached`. Errors: those of check(), `late` after `timeout`.
  template <typename Reached, typename Late>
  tl::expected<void, Error> wait_until(milliseconds timeout, const Reached& reached, const Late& late) {
    const auto deadline = internal::Clock::now() + timeout;
    while (!reached()) {
      const milliseconds left = until(deadline);
      if (left.count() == 0) return tl::unexpected(late());
      answers.wait(std::min(left, kLookEvery));
      take_answers();
      if (auto there = check(); !there) return there;
    }
    return {};
  }

  Error no_credit(milliseconds waited) const {
    return local_error("timeout",
                       "The daemon at " + connection.link()->control_endpoint() +
                           " is there but acknowledged too little within " + std::to_string(waited.count()) +
                           " ms: " + std::to_string(under_way.size()) +
                           " messages are under way, the newest acknowledged is " + std::to_string(acknowledged) + ".",
                       "See in rustled's log what it is busy with, or allow more time.");
  }

  /// Waits for room in the queue to the daemon.
  tl::expected<void, Error> send_waiting(const v1::StreamMessage& message) {
    const auto deadline = internal::Clock::now() + send_timeout;
    while (!stream.send(id, message, std::min(until(deadline), kLookEvery))) {
      if (auto there = check(); !there) return there;
      if (until(deadline).count() == 0)
        return tl::unexpected(local_error("timeout",
                                          "The queue to the daemon at " + connection.link()->stream_endpoint() +
                                              " stayed full for " + std::to_string(send_timeout.count()) + " ms.",
                                          "See in rustled's log what it is busy with, or allow more time."));
    }
    return {};
  }

  v1::StreamMessage begin() const {
    v1::StreamMessage message;
    message.set_session_id(id);
    return message;
  }

  /// Numbers, stamps and sends. `numbered`: the sequence is already there.
  SendResult send(v1::StreamMessage& message, bool wait_on_live, bool numbered = false) {
    if (detached) return tl::unexpected(local_error("closed", "The session was detached.", "Attach a new one."));
    take_answers();
    if (auto there = check(); !there) return tl::unexpected(std::move(there.error()));
    if (!numbered) {
      message.set_sequence(next_sequence);
      message.set_sent_at_s(std::chrono::duration<double>(internal::Clock::now().time_since_epoch()).count());
    }
    const std::size_t bytes = message.ByteSizeLong();
    if (bytes > static_cast<std::size_t>(internal::kMessageBytes))
      return tl::unexpected(local_error("too_large",
                                        "The message has " + std::to_string(bytes) + " bytes; a daemon takes " +
                                            std::to_string(internal::kMessageBytes) + ".",
                                        "Send a coarser mesh, or several smaller ones."));
    if (simulation()) {
      auto room = wait_until(
          send_timeout, [&] { return has_room(bytes); }, [&] { return no_credit(send_timeout); });
      if (!room) return tl::unexpected(std::move(room.error()));
    }
    const std::uint64_t sequence = message.sequence();
    if (simulation() || wait_on_live) {
      if (auto sent = send_waiting(message); !sent) return tl::unexpected(std::move(sent.error()));
    } else if (!stream.send(id, message, milliseconds(0))) {
      ++dropped_messages;
      next_sequence = std::max(next_sequence, sequence + 1);
      return Sent::kDropped;
    }
    last_sequence = std::max(last_sequence, sequence);
    ++sent_messages;
    if (sequence > 0) {
      next_sequence = std::max(next_sequence, sequence + 1);
      if (simulation()) {
        under_way.push_back({sequence, bytes});
        bytes_under_way += bytes;
      }
    }
    return Sent::kQueued;
  }

  SendResult send(v1::StreamMessage& message) { return send(message, !may_be_dropped(message)); }
};

Session::Session(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
Session::Session(Session&&) noexcept = default;

Session& Session::operator=(Session&& other) noexcept {
  std::swap(impl_, other.impl_);
  return *this;
}

Session::~Session() {
  if (impl_ == nullptr || impl_->detached) return;
  v1::ControlRequest request;
  request.set_session_id(impl_->id);
  request.mutable_detach()->set_last_sequence(impl_->last_sequence);
  impl_->connection.link()->tell(request);
}

tl::expected<Session, Error> Session::attach(const Connection& connection, const SessionOptions& options) {
  internal::Link& link = *connection.link();
  const std::string stream_endpoint = link.stream_endpoint();
  const std::string out_endpoint = link.out_endpoint();
  if (stream_endpoint.empty() || out_endpoint.empty())
    return tl::unexpected(local_error("invalid", "The daemon takes no streams: it only subscribes to publishers.",
                                      "Start rustled with --stream, or give Endpoints::stream."));

  v1::ControlRequest request;
  v1::Attach* attach = request.mutable_attach();
  attach->set_name(options.name);
  internal::write(options, attach->mutable_options());
  for (const SheetOptions& sheet : options.sheets) internal::write(sheet, attach->add_sheets());
  auto reply = link.ask(request);
  if (!reply) return tl::unexpected(std::move(reply.error()));
  const std::uint64_t breaks = link.connection().breaks;
  const std::string id = reply->attached().session_id();
  if (id.empty())
    return tl::unexpected(local_error("malformed", "The daemon's answer to attach names no session.",
                                      "Bring the older of SDK and daemon up to date."));
  const auto give_up = [&](Error error) {
    v1::ControlRequest detach;
    detach.set_session_id(id);
    detach.mutable_detach()->set_discard(true);
    link.tell(detach);
    return tl::unexpected(std::move(error));
  };

  SessionOptions in_force = options;
  internal::read(reply->attached().options(), in_force);
  const bool simulation = in_force.clock == Clock::kSimulation;
  auto answers = Socket::connect(link.context(), Socket::Role::kListener, out_endpoint, {.send = 0, .receive = 65'536});
  if (!answers) return give_up(std::move(answers.error()));
  auto stream = Socket::connect(link.context(), Socket::Role::kStream, stream_endpoint,
                                {.send = simulation ? kSimulationQueueMessages : kLiveQueueMessages, .receive = 0});
  if (!stream) return give_up(std::move(stream.error()));

  auto impl = std::make_unique<Impl>(Impl{.connection = connection,
                                          .stream = std::move(*stream),
                                          .answers = std::move(*answers),
                                          .id = id,
                                          .options = in_force,
                                          .breaks = breaks});
  if (reply->attached().has_credit()) impl->take(reply->attached().credit());

  impl->answers.subscribe(id + "/acknowledgements");
  impl->answers.subscribe(id + "/notices");
  std::vector<std::vector<std::string>> early;
  if (!impl->answers.wait_subscribed(link.timeout(), early))
    return give_up(local_error("timeout", "The daemon did not confirm the subscription at " + out_endpoint + " in time.",
                               "Check that the out endpoint can be reached from here."));
  for (const auto& parts : early) impl->take(parts);

  const auto deadline = internal::Clock::now() + link.timeout();
  for (bool subscribed = false; !subscribed;) {
    const milliseconds left = until(deadline);
    if (left.count() == 0 || !impl->stream.wait(left))
      return give_up(local_error("timeout", "The daemon did not subscribe at " + stream_endpoint + " in time.",
                                 "Check that the stream endpoint can be reached from here."));
    const auto parts = impl->stream.receive();
    subscribed =
        !parts.empty() && !parts.front().empty() && parts.front()[0] == 1 && id.starts_with(parts.front().substr(1));
  }
  return Session(std::move(impl));
}

const std::string& Session::id() const {
  return impl_->id;
}
const SessionOptions& Session::options() const {
  return impl_->options;
}

SendResult Session::add_sheet(const SheetOptions& sheet) {
  v1::StreamMessage message = impl_->begin();
  internal::write(sheet, message.mutable_sheet());
  return impl_->send(message);
}

SendResult Session::add_topology(const Topology& topology) {
  if (topology.triangles.size() % 3 != 0)
    return tl::unexpected(local_error("invalid", "The number of indices is no multiple of three.",
                                      "Give three vertices for each triangle.", "topology.triangles"));
  v1::StreamMessage message = impl_->begin();
  internal::write(topology, message.mutable_topology());
  const auto sent = impl_->send(message);
  if (sent) impl_->topology_vertices[topology.id] = topology.vertex_count;
  return sent;
}

SendResult Session::frame(std::uint32_t sheet_id, std::uint64_t topology_id, double time_s, std::span<const float> positions,
                          const FrameExtras& extras) {
  const auto known = impl_->topology_vertices.find(topology_id);
  if (known == impl_->topology_vertices.end())
    return tl::unexpected(local_error("invalid", "Topology " + std::to_string(topology_id) + " was not added.",
                                      "Call add_topology() before the first frame that uses it.", "frame.topology_id"));
  if (positions.size() != std::size_t{3} * known->second)
    return tl::unexpected(local_error("invalid",
                                      std::to_string(positions.size()) + " numbers are given; " +
                                          std::to_string(known->second) + " vertices have " +
                                          std::to_string(std::size_t{3} * known->second) + ".",
                                      "Give x, y and z of every vertex.", "frame.positions"));
  v1::StreamMessage message = impl_->begin();
  v1::MeshFrame* frame = message.mutable_frame();
  frame->set_sheet_id(sheet_id);
  frame->set_topology_id(topology_id);
  frame->set_time_s(time_s);
  internal::set_bytes(positions, frame->mutable_positions());
  internal::write(extras, frame);
  return impl_->send(message);
}

SendResult Session::scene(const SceneUpdate& update) {
  v1::StreamMessage message = impl_->begin();
  internal::write(update, message.mutable_scene());
  return impl_->send(message);
}

SendResult Session::listener(const Listener& listener) {
  v1::StreamMessage message = impl_->begin();
  internal::write(listener, message.mutable_listener());
  return impl_->send(message);
}

SendResult Session::tear_tips(std::uint32_t sheet_id, double time_s, std::span<const TearTip> tips) {
  v1::StreamMessage message = impl_->begin();
  v1::TearTips* sent = message.mutable_tear_tips();
  sent->set_sheet_id(sheet_id);
  sent->set_time_s(time_s);
  for (const TearTip& tip : tips) internal::write(tip, sent->add_tips());
  return impl_->send(message);
}

SendResult Session::advance(double time_s) {
  v1::StreamMessage message = impl_->begin();
  message.mutable_advance()->set_time_s(time_s);
  return impl_->send(message);
}

SendResult Session::end(std::optional<double> time_s) {
  v1::StreamMessage message = impl_->begin();
  message.mutable_end()->set_time_s(time_s.value_or(0));
  return impl_->send(message);
}

SendResult Session::raw(std::span<const std::byte> stream_message, const RawOptions& options) {
  v1::StreamMessage message;
  if (!message.ParseFromArray(stream_message.data(), static_cast<int>(stream_message.size())))
    return tl::unexpected(local_error("malformed", "The bytes are no rustle.v1.StreamMessage.",
                                      "Give a message as a capture's stream channel holds it."));
  message.set_session_id(impl_->id);
  const bool wait = options.wait || !may_be_dropped(message);
  if (message.has_topology()) impl_->topology_vertices[message.topology().topology_id()] = message.topology().vertex_count();
  return impl_->send(message, wait, options.keep_sequence);
}

tl::expected<PcmReader, Error> Session::listen(const ListenOptions& options) const {
  ListenOptions asked = options;
  if (!asked.queue_messages && impl_->simulation()) asked.queue_messages = 0;
  return PcmReader::listen(impl_->connection, impl_->id, asked);
}

tl::expected<Statistics, Error> Session::statistics() const {
  return impl_->connection.statistics(impl_->id);
}

tl::expected<std::vector<Gain>, Error> Session::set_gains(const std::vector<Gain>& gains) const {
  return impl_->connection.set_gains(impl_->id, gains);
}

std::vector<Notice> Session::poll_notices() {
  impl_->take_answers();
  std::vector<Notice> out(std::make_move_iterator(impl_->notices.begin()), std::make_move_iterator(impl_->notices.end()));
  impl_->notices.clear();
  return out;
}

tl::expected<void, Error> Session::drain(milliseconds timeout) {
  if (!impl_->simulation()) return {};
  impl_->take_answers();
  return impl_->wait_until(
      timeout, [&] { return impl_->under_way.empty(); }, [&] { return impl_->no_credit(timeout); });
}

tl::expected<Statistics, Error> Session::detach(bool discard) {
  auto statistics = impl_->connection.detach(impl_->id, discard, impl_->last_sequence);
  if (statistics) impl_->detached = true;
  return statistics;
}

void Session::set_send_timeout(milliseconds timeout) {
  impl_->send_timeout = timeout;
}
std::uint64_t Session::sent_messages() const {
  return impl_->sent_messages;
}
std::uint64_t Session::dropped_messages() const {
  return impl_->dropped_messages;
}
std::uint64_t Session::acknowledged_sequence() const {
  return impl_->acknowledged;
}
std::uint64_t Session::next_sequence() const {
  return impl_->next_sequence;
}

}  // namespace rustle::client
