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
#include <zmq.h>

#include "server/wire/endpoint.h"
#include "server/wire/topics.h"

namespace rustle::wire {
namespace {

static_assert(sizeof(zmq_msg_t) == 64 && alignof(zmq_msg_t) <= alignof(void*));

zmq_msg_t* raw(std::byte* storage) {
  return static_cast<zmq_msg_t*>(static_cast<void*>(storage));
}

/// libzmq's defaults that bite: no limit on sizes, LINGER for ever, 30 s for a handshake, no heartbeats, 1023 sockets.
constexpr int kIoThreads = 1;
constexpr int kMaxSockets = 16;
constexpr int kLingerMs = 500;
constexpr int kHandshakeMs = 2'000;
constexpr int kHeartbeatMs = 200;
constexpr int kHeartbeatTimeoutMs = 600;
constexpr int kBacklog = 256;
constexpr int kReconnectMs = 100;
constexpr int kReconnectMaxMs = 1'000;
constexpr int kControlQueueMessages = 256;
constexpr std::int64_t kSubscriptionBytes = 1024;
constexpr int kBatch = 256;
constexpr std::size_t kBatchBytes = std::size_t{64} << 20;  ///< of the stream: a batch ends with the message that exceeds it

class Socket {
 public:
  Socket() = default;
  Socket(void* context, int type) : handle_(zmq_socket(context, type)) {}
  ~Socket() {
    if (handle_ != nullptr) zmq_close(handle_);
  }
  Socket(Socket&& other) noexcept : handle_(std::exchange(other.handle_, nullptr)) {}
  Socket& operator=(Socket&& other) noexcept {
    std::swap(handle_, other.handle_);
    return *this;
  }

  void* get() const { return handle_; }
  bool set(int option, int value) { return zmq_setsockopt(handle_, option, &value, sizeof(value)) == 0; }
  bool set64(int option, std::int64_t value) { return zmq_setsockopt(handle_, option, &value, sizeof(value)) == 0; }

  bool configure(std::int64_t message_bytes, int send_queue, int receive_queue) {
    return handle_ != nullptr && set(ZMQ_LINGER, kLingerMs) && set64(ZMQ_MAXMSGSIZE, message_bytes) &&
           set(ZMQ_SNDHWM, send_queue) && set(ZMQ_RCVHWM, receive_queue) && set(ZMQ_HANDSHAKE_IVL, kHandshakeMs) &&
           set(ZMQ_HEARTBEAT_IVL, kHeartbeatMs) && set(ZMQ_HEARTBEAT_TIMEOUT, kHeartbeatTimeoutMs) &&
           set(ZMQ_HEARTBEAT_TTL, kHeartbeatTimeoutMs) && set(ZMQ_BACKLOG, kBacklog) &&
           set(ZMQ_RECONNECT_IVL, kReconnectMs) && set(ZMQ_RECONNECT_IVL_MAX, kReconnectMaxMs);
  }

  tl::expected<std::string, std::string> bind(std::string_view endpoint, std::string_view flag) {
    const auto checked = check_bind_endpoint(endpoint, flag);
    if (!checked) return checked;
    if (ipc_in_use(*checked))
      return tl::unexpected(fmt::format("{} {}: another program serves this path; end it, or choose another path with {}.",
                                        flag, endpoint, flag));
    set(ZMQ_IPV6, checked->find('[') != std::string::npos ? 1 : 0);
    if (zmq_bind(handle_, checked->c_str()) != 0) {
      const int problem = errno;
      if (problem == EADDRINUSE)
        return tl::unexpected(
            fmt::format("{} {}: port {} is in use, perhaps by another rustled; end it, or choose another port with {} "
                        "tcp://127.0.0.1:PORT.",
                        flag, endpoint, port_of(*checked), flag));
      return tl::unexpected(fmt::format("{} {}: cannot be bound: {}; choose another endpoint with {}.", flag, endpoint,
                                        zmq_strerror(problem), flag));
    }
    char bound[256];
    std::size_t size = sizeof(bound);
    if (zmq_getsockopt(handle_, ZMQ_LAST_ENDPOINT, bound, &size) != 0) return *checked;
    return std::string(bound);
  }

 private:
  void* handle_ = nullptr;
};

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
  Socket control, stream, out;
  std::string control_endpoint, stream_endpoint, out_endpoint;
  int wake_fd = -1;

  std::mutex post_mutex;
  std::vector<Post> posts;

  std::set<std::string, std::less<>> topics;
  std::vector<std::string> subscribed_answers;
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

  void read_control(std::vector<Event>& events) {
    std::vector<Message> parts;
    std::size_t count = 0;
    for (int i = 0; i < kBatch && receive(control.get(), parts, count); ++i) {
      const bool delimited = count == 3 && parts[1].bytes().empty();
      if (count != 2 && !delimited) {
        ++counters.malformed_messages;
        continue;
      }
      events.emplace_back(ControlRequestReceived{.peer = {.identity = text_of(parts[0]), .delimited = delimited},
                                                 .bytes = std::move(parts[count - 1])});
    }
  }

  void read_stream(std::vector<Event>& events) {
    std::vector<Message> parts;
    std::size_t count = 0, bytes = 0;
    for (int i = 0; i < kBatch && bytes < kBatchBytes && receive(stream.get(), parts, count); ++i) {
      if (count > 2) {
        ++counters.malformed_messages;
        continue;
      }
      bytes += parts.back().bytes().size();
      events.emplace_back(
          StreamReceived{.topic = count == 2 ? text_of(parts[0]) : std::string(), .bytes = std::move(parts[count - 1])});
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
        if (on) subscribed_answers.push_back(std::move(text));
        continue;
      }
      if (on) {
        topics.insert(text);
      } else {
        topics.erase(text);
      }
      events.emplace_back(SubscriptionChanged{.topic = std::move(text), .on = on});
    }
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
    for (const std::string& topic : std::exchange(subscribed_answers, {})) publish(topic, {});
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
      !impl->out.configure(kSubscriptionBytes, options.out_queue_messages, 0) ||
      !impl->control.set(ZMQ_ROUTER_MANDATORY, 1) || !impl->out.set(ZMQ_XPUB_VERBOSE, 0) ||
      !impl->out.set(ZMQ_XPUB_NODROP, 0) || zmq_setsockopt(impl->stream.get(), ZMQ_SUBSCRIBE, "", 0) != 0)
    return out_of_resources();

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
  for (const std::string& publisher : options.connect) {
    const auto checked = check_connect_endpoint(publisher, "--connect");
    if (!checked) return tl::unexpected(checked.error());
    impl->stream.set(ZMQ_IPV6, checked->find('[') != std::string::npos ? 1 : 0);
    if (zmq_connect(impl->stream.get(), checked->c_str()) != 0)
      return tl::unexpected(
          fmt::format("--connect {}: {}; write tcp://HOST:PORT or ipc://PATH.", publisher, zmq_strerror(errno)));
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
  zmq_pollitem_t items[] = {{impl_->control.get(), 0, ZMQ_POLLIN, 0},
                            {impl_->stream.get(), 0, ZMQ_POLLIN, 0},
                            {impl_->out.get(), 0, ZMQ_POLLIN, 0},
                            {nullptr, impl_->wake_fd, ZMQ_POLLIN, 0}};
  if (zmq_poll(items, 4, static_cast<long>(timeout.count())) < 0) return;
  if (items[3].revents != 0) {
    std::uint64_t count = 0;
    [[maybe_unused]] const ssize_t got = ::read(impl_->wake_fd, &count, sizeof(count));
    impl_->send_waiting();
  }
  if (items[2].revents != 0) impl_->read_subscriptions(events);
  if (items[0].revents != 0) impl_->read_control(events);
  if (items[1].revents != 0) impl_->read_stream(events);
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

const Sockets::Counters& Sockets::counters() const {
  return impl_->counters;
}

}  // namespace rustle::wire
