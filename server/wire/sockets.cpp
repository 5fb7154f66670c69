#include "server/wire/sockets.h"

#include <cerrno>
#include <cstring>
#include <mutex>
#include <optional>
#include <set>
#include <utility>

#include <sys/eventfd.h>
#include <unistd.h>

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <zmq.h>

#include "server/wire/authenticator.h"
#include "server/wire/control.h"
#include "server/wire/endpoint.h"
#include "server/wire/listeners.h"
#include "server/wire/socket.h"
#include "server/wire/topics.h"

namespace rustle::wire {
namespace {

static_assert(sizeof(zmq_msg_t) == 64 && alignof(zmq_msg_t) <= alignof(void*));

zmq_msg_t* raw(std::byte* storage) {
  return static_cast<zmq_msg_t*>(static_cast<void*>(storage));
}

constexpr int kIoThreads = 1;
constexpr int kMaxSockets = 64;  // three of ours, three of the authenticator's, one a publisher, and the reaper's
constexpr int kControlQueueMessages = 256;
constexpr std::int64_t kSubscriptionBytes = 1024;
constexpr int kBatch = 256;
constexpr std::size_t kBatchBytes = std::size_t{64} << 20;  ///< of the stream: a batch ends with the message that exceeds it

/// All parts of one message; at most `kMostParts` are kept, the others are read and dropped.
constexpr std::size_t kMostParts = 4;

std::string text_of(const Message& message) {
  const auto bytes = message.bytes();
  return {static_cast<const char*>(static_cast<const void*>(bytes.data())), bytes.size()};
}

bool send_part(void* socket, std::string_view bytes, int flags) {
  return zmq_send(socket, bytes.data(), bytes.size(), flags | ZMQ_DONTWAIT) >= 0;
}

struct Post {
  std::optional<ControlPeer> peer;  ///< present: a reply; absent: a publication
  std::string topic, bytes;
};

}  // namespace

Message::Message() noexcept {
  zmq_msg_init(raw(storage_));
}
Message::Message(Message&& other) noexcept {
  zmq_msg_init(raw(storage_));
  zmq_msg_move(raw(storage_), raw(other.storage_));
}
Message& Message::operator=(Message&& other) noexcept {
  if (this != &other) zmq_msg_move(raw(storage_), raw(other.storage_));
  return *this;
}
Message::~Message() {
  zmq_msg_close(raw(storage_));
}

std::span<const std::byte> Message::bytes() const {
  // libzmq's accessors take non-const messages but change nothing.
  auto* message = raw(const_cast<std::byte*>(storage_));  // NOLINT
  return {static_cast<const std::byte*>(zmq_msg_data(message)), zmq_msg_size(message)};
}

struct Sockets::Impl {
  struct Context {
    void* handle = zmq_ctx_new();
    ~Context() {
      if (handle != nullptr) zmq_ctx_term(handle);
    }
  } context;
  std::optional<Security> security;
  std::unique_ptr<Authenticator> authenticator;
  struct PublisherSocket {
    Socket socket;
    std::string user;
  };
  Socket control, stream, out;
  std::vector<PublisherSocket> publishers;
  std::string control_endpoint, stream_endpoint, out_endpoint;
  int wake_fd = -1;

  std::mutex post_mutex;
  std::vector<Post> posts;

  std::set<std::string, std::less<>> topics;
  Listeners listeners;  ///< with keys only
  struct SubscribedAnswer {
    std::string topic, bytes;
  };
  std::vector<SubscribedAnswer> subscribed_answers;
  Counters counters;

  ~Impl() {
    if (wake_fd >= 0) ::close(wake_fd);
  }

  /// Reads one message; false when none waits. `parts` holds at most kMostParts, `count` all of them.
  static bool receive(void* socket, std::vector<Message>& parts, std::size_t& count) {
    parts.clear();
    count = 0;
    while (true) {
      Message part;
      if (zmq_msg_recv(raw(part.storage_), socket, ZMQ_DONTWAIT) < 0) return false;
      const bool more = zmq_msg_more(raw(part.storage_)) != 0;
      ++count;
      if (parts.size() < kMostParts) parts.push_back(std::move(part));
      if (!more) return true;
    }
  }

  /// Who sent a message, and whether it counts: with keys, one that has been revoked since it connected is cut off.
  bool knows(const Message& message, std::string& user) {
    if (!security) return true;
    auto* const received = raw(const_cast<std::byte*>(message.storage_));  // NOLINT: libzmq's accessors change nothing
    const char* const id = zmq_msg_gets(received, "User-Id");
    if (id != nullptr && security->admits(id)) {
      user = id;
      return true;
    }
    ++counters.revoked_messages;
    cut(connection_of(message));
    return false;
  }

  /// By which a message came. Nothing: it has ended.
  static PeerConnection connection_of(const Message& message) {
    auto* const received = raw(const_cast<std::byte*>(message.storage_));  // NOLINT
    return connection_at(zmq_msg_get(received, ZMQ_SRCFD));
  }

  void read_control(std::vector<Event>& events) {
    std::vector<Message> parts;
    std::size_t count = 0;
    for (int i = 0; i < kBatch && receive(control.get(), parts, count); ++i) {
      const bool delimited = count == 3 && parts[1].bytes().empty();
      if (count != 2 && !delimited) {
        ++counters.malformed_messages;
        continue;
      }
      std::string user;
      if (!knows(parts[count - 1], user)) continue;
      events.emplace_back(ControlRequestReceived{.peer = {.identity = text_of(parts[0]), .delimited = delimited},
                                                 .bytes = std::move(parts[count - 1]),
                                                 .user = std::move(user)});
    }
  }

  /// `pinned`: the user of a publisher that we connected to and that has proved to be it; null: the message says.
  void read_stream(const Socket& from, const std::string* pinned, std::vector<Event>& events) {
    std::vector<Message> parts;
    std::size_t count = 0, bytes = 0;
    for (int i = 0; i < kBatch && bytes < kBatchBytes && receive(from.get(), parts, count); ++i) {
      if (count > 2) {
        ++counters.malformed_messages;
        continue;
      }
      std::string user;
      if (pinned != nullptr) {
        user = *pinned;
        if (security && !security->admits(user)) {
          ++counters.revoked_messages;
          continue;
        }
      } else if (!knows(parts.back(), user)) {
        continue;
      }
      bytes += parts.back().bytes().size();
      events.emplace_back(StreamReceived{.topic = count == 2 ? text_of(parts[0]) : std::string(),
                                         .bytes = std::move(parts[count - 1]),
                                         .user = std::move(user)});
    }
  }

  void read_subscriptions(std::vector<Event>& events) {
    std::vector<Message> parts;
    std::size_t count = 0;
    for (int i = 0; i < kBatch && receive(out.get(), parts, count); ++i) {
      std::string text = text_of(parts[0]);
      if (count != 1 || text.empty() || (text[0] != 0 && text[0] != 1)) {
        ++counters.malformed_messages;
        continue;
      }
      const bool on = text[0] == 1;
      text.erase(0, 1);
      if (text.starts_with(kSubscribedPrefix)) {
        if (security) zmq_setsockopt(out.get(), on ? ZMQ_SUBSCRIBE : ZMQ_UNSUBSCRIBE, text.data(), text.size());
        if (!on) continue;
        std::string refused;
        if (security) {
          refused = refusal_of(listeners.take_refusals(connection_of(parts[0])));
        }
        subscribed_answers.push_back({std::move(text), std::move(refused)});
        continue;
      }
      if (security && !settle(parts[0], text, on)) continue;
      tell(std::move(text), on, events);
    }
  }

  void settle_listeners(std::vector<Event>& events) {
    for (std::string& silent : listeners.settle(Listeners::Clock::now())) tell(std::move(silent), false, events);
  }

  void tell(std::string topic, bool on, std::vector<Event>& events) {
    if (on) {
      topics.insert(topic);
    } else {
      topics.erase(topic);
    }
    events.emplace_back(SubscriptionChanged{.topic = std::move(topic), .on = on});
  }

  /// Puts a subscription in force where it is granted. True: that changes whether the topic is heard.
  bool settle(const Message& message, const std::string& topic, bool on) {
    auto* const received = raw(const_cast<std::byte*>(message.storage_));  // NOLINT
    const char* const user = zmq_msg_gets(received, "User-Id");
    if (!on) {
      if (user == nullptr) {
        listeners.end(topic);
        return false;
      }
      zmq_setsockopt(out.get(), ZMQ_UNSUBSCRIBE, topic.data(), topic.size());
      return listeners.leave(topic, connection_of(message));
    }
    if (user == nullptr || !listeners.takes(topic)) {
      ++counters.refused_subscriptions;
      return false;
    }
    if (!security->admits(user) || !security->may_hear(user, topic)) {
      ++counters.refused_subscriptions;
      listeners.refuse(topic, connection_of(message));
      return false;
    }
    zmq_setsockopt(out.get(), ZMQ_SUBSCRIBE, topic.data(), topic.size());
    return listeners.grant(topic, connection_of(message), user);
  }

  static std::string refusal_of(const std::vector<std::string>& topics) {
    if (topics.empty()) return {};
    return encode_error({ErrorCode::kPermissionDenied, "topic",
                         fmt::format("This key may not hear {}.", fmt::join(topics, ", ")),
                         "Have the daemon's operator give it the permission to listen.", 0, std::nullopt, "listen"});
  }

  bool send_control(const ControlPeer& peer, std::string_view bytes) {
    const bool sent = send_part(control.get(), peer.identity, ZMQ_SNDMORE) &&
                      (!peer.delimited || send_part(control.get(), {}, ZMQ_SNDMORE)) && send_part(control.get(), bytes, 0);
    if (!sent) ++counters.unsent_replies;
    return sent;
  }

  bool publish(std::string_view topic, std::string_view bytes) {
    return send_part(out.get(), topic, ZMQ_SNDMORE) && send_part(out.get(), bytes, 0);
  }

  void send_waiting() {
    for (const SubscribedAnswer& answer : std::exchange(subscribed_answers, {})) publish(answer.topic, answer.bytes);
    std::vector<Post> waiting;
    {
      const std::lock_guard lock(post_mutex);
      waiting.swap(posts);
    }
    for (const Post& post : waiting) {
      if (post.peer) {
        send_control(*post.peer, post.bytes);
      } else {
        publish(post.topic, post.bytes);
      }
    }
  }

  void signal() const {
    const std::uint64_t one = 1;
    // The counter is full only when a wake-up waits already.
    [[maybe_unused]] const ssize_t written = ::write(wake_fd, &one, sizeof(one));
  }
};

namespace {

/// Why these endpoints may not be served to whoever reaches them. Nothing: they may.
std::optional<std::string> exposed(const Sockets::Options& options) {
  for (const Publisher& publisher : options.connect)
    if (options.security && publisher.public_key.empty())
      return fmt::format(
          "--connect {}: with keys a publisher must prove its own; write {}#NAME, as `rustle keys list` shows it.",
          publisher.endpoint, publisher.endpoint);
  if (options.insecure) return std::nullopt;
  for (const auto& [endpoint, flag] : {std::pair<const std::string&, const char*>{options.control, "--control"},
                                       {options.stream, "--stream"},
                                       {options.out, "--out"}}) {
    if (endpoint.empty() || is_local(endpoint)) continue;
    if (!options.security)
      return fmt::format(
          "{} {}: whoever reaches it could use the daemon. Have keys asked for with --keys FOLDER (`rustle keys new server` "
          "makes the first), bind tcp://127.0.0.1:{}, or say --insecure.",
          flag, endpoint, port_of(endpoint) == "*" ? "PORT" : port_of(endpoint));
  }
  return std::nullopt;
}

}  // namespace

Sockets::Sockets(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
Sockets::~Sockets() = default;

tl::expected<std::unique_ptr<Sockets>, std::string> Sockets::open(const Options& options) {
  auto impl = std::make_unique<Impl>();
  const auto out_of_resources = [] {
    return tl::unexpected(
        fmt::format("ZeroMQ cannot make its sockets: {}; raise the limit of open files (ulimit -n).", zmq_strerror(errno)));
  };
  void* context = impl->context.handle;
  if (context == nullptr) return out_of_resources();
  zmq_ctx_set(context, ZMQ_IO_THREADS, kIoThreads);
  zmq_ctx_set(context, ZMQ_MAX_SOCKETS, kMaxSockets);
  zmq_ctx_set(context, ZMQ_BLOCKY, 0);

  impl->wake_fd = ::eventfd(0, EFD_NONBLOCK | EFD_CLOEXEC);
  impl->control = Socket(context, ZMQ_ROUTER);
  impl->stream = Socket(context, ZMQ_SUB);
  impl->out = Socket(context, ZMQ_XPUB);
  if (impl->wake_fd < 0 ||
      !impl->control.configure(static_cast<std::int64_t>(options.control_bytes), kControlQueueMessages,
                               kControlQueueMessages) ||
      !impl->stream.configure(static_cast<std::int64_t>(options.message_bytes), 1, options.stream_queue_messages) ||
      !impl->out.configure(kSubscriptionBytes, options.out_queue_messages, 0) || !impl->out.trust_listeners() ||
      !impl->control.set(ZMQ_ROUTER_MANDATORY, 1) || !impl->out.set(ZMQ_XPUB_VERBOSE, 0) ||
      !impl->out.set(ZMQ_XPUB_NODROP, 0) || zmq_setsockopt(impl->stream.get(), ZMQ_SUBSCRIBE, "", 0) != 0)
    return out_of_resources();

  if (auto wrong = exposed(options)) return tl::unexpected(std::move(*wrong));
  if (options.security) {
    impl->security = options.security;
    impl->authenticator = std::make_unique<Authenticator>(context, options.security->admits);
    if (!impl->authenticator->runs() || !impl->control.serve_keys(*options.security) ||
        !impl->stream.serve_keys(*options.security) || !impl->out.serve_keys(*options.security) ||
        !impl->out.set(ZMQ_XPUB_MANUAL, 1))
      return tl::unexpected(fmt::format(
          "ZeroMQ cannot use the daemon's keys: {}; make a new pair with `rustle keys new server`.", zmq_strerror(errno)));
  }
  auto bound = impl->control.bind(options.control, "--control");
  if (!bound) return tl::unexpected(std::move(bound.error()));
  impl->control_endpoint = std::move(*bound);
  if (!options.stream.empty()) {
    bound = impl->stream.bind(options.stream, "--stream");
    if (!bound) return tl::unexpected(std::move(bound.error()));
    impl->stream_endpoint = std::move(*bound);
  }
  bound = impl->out.bind(options.out, "--out");
  if (!bound) return tl::unexpected(std::move(bound.error()));
  impl->out_endpoint = std::move(*bound);
  for (const Publisher& publisher : options.connect) {
    const auto checked = check_connect_endpoint(publisher.endpoint, "--connect");
    if (!checked) return tl::unexpected(checked.error());
    Socket socket(context, ZMQ_SUB);
    const bool plain = publisher.public_key.empty();
    if (!socket.configure(static_cast<std::int64_t>(options.message_bytes), 1, options.stream_queue_messages) ||
        zmq_setsockopt(socket.get(), ZMQ_SUBSCRIBE, "", 0) != 0)
      return out_of_resources();
    if (!plain && (!options.security || !socket.pin(*options.security, publisher.public_key)))
      return tl::unexpected(fmt::format("--connect {}: {} is no key of a publisher; name one that `rustle keys list` shows.",
                                        publisher.endpoint, publisher.public_key));
    if (auto connected = socket.connect(*checked); !connected) return tl::unexpected(std::move(connected.error()));
    impl->publishers.push_back({std::move(socket), publisher.public_key});
  }
  return std::unique_ptr<Sockets>(new Sockets(std::move(impl)));
}

const std::string& Sockets::control_endpoint() const {
  return impl_->control_endpoint;
}
const std::string& Sockets::stream_endpoint() const {
  return impl_->stream_endpoint;
}
const std::string& Sockets::out_endpoint() const {
  return impl_->out_endpoint;
}

void Sockets::poll(std::chrono::milliseconds timeout, std::vector<Event>& events) {
  impl_->send_waiting();
  std::vector<zmq_pollitem_t> items{{impl_->control.get(), 0, ZMQ_POLLIN, 0},
                                    {impl_->stream.get(), 0, ZMQ_POLLIN, 0},
                                    {impl_->out.get(), 0, ZMQ_POLLIN, 0},
                                    {nullptr, impl_->wake_fd, ZMQ_POLLIN, 0}};
  const std::size_t first_publisher = items.size();
  for (const auto& publisher : impl_->publishers) items.push_back({publisher.socket.get(), 0, ZMQ_POLLIN, 0});
  if (zmq_poll(items.data(), static_cast<int>(items.size()), static_cast<long>(timeout.count())) < 0) return;
  if (items[3].revents != 0) {
    std::uint64_t count = 0;
    [[maybe_unused]] const ssize_t got = ::read(impl_->wake_fd, &count, sizeof(count));
    impl_->send_waiting();
  }
  if (items[2].revents != 0) impl_->read_subscriptions(events);
  impl_->settle_listeners(events);
  if (items[0].revents != 0) impl_->read_control(events);
  if (items[1].revents != 0) impl_->read_stream(impl_->stream, nullptr, events);
  for (std::size_t k = 0; k < impl_->publishers.size(); ++k) {
    const auto& publisher = impl_->publishers[k];
    if (items[first_publisher + k].revents != 0) impl_->read_stream(publisher.socket, &publisher.user, events);
  }
}

void Sockets::cut_listeners() {
  if (!impl_->security) return;
  impl_->listeners.cut_unless([security = &*impl_->security](const std::string& user, const std::string& topic) {
    return security->admits(user) && security->may_hear(user, topic);
  });
}

bool Sockets::send_control(const ControlPeer& peer, std::string_view bytes) {
  return impl_->send_control(peer, bytes);
}
bool Sockets::publish(std::string_view topic, std::string_view bytes) {
  return impl_->publish(topic, bytes);
}

bool Sockets::has_listener(std::string_view topic) const {
  for (const std::string& prefix : impl_->topics)
    if (topic.starts_with(prefix)) return true;
  return false;
}

std::vector<std::string> Sockets::subscriptions() const {
  return {impl_->topics.begin(), impl_->topics.end()};
}

void Sockets::post(std::string topic, std::string bytes) {
  {
    const std::lock_guard lock(impl_->post_mutex);
    impl_->posts.push_back({.peer = {}, .topic = std::move(topic), .bytes = std::move(bytes)});
  }
  impl_->signal();
}

void Sockets::post_control(ControlPeer peer, std::string bytes) {
  {
    const std::lock_guard lock(impl_->post_mutex);
    impl_->posts.push_back({.peer = std::move(peer), .topic = {}, .bytes = std::move(bytes)});
  }
  impl_->signal();
}

void Sockets::wake() {
  impl_->signal();
}

Sockets::Counters Sockets::counters() const {
  Counters counters = impl_->counters;
  if (impl_->authenticator) counters.refused_connections = impl_->authenticator->counters().refused;
  return counters;
}

}  // namespace rustle::wire
