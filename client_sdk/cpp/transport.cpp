#include "client_sdk/cpp/transport.h"

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <cstring>
#include <utility>

#include <zmq.h>

#include "proto/statistics_figures.h"

namespace rustle::client {

namespace {

std::string sentence(const std::string& code, const std::string& field, const std::string& message,
                     const std::string& remedy) {
  std::string text = code;
  if (!field.empty()) text += " in " + field;
  text += ": " + message;
  if (!remedy.empty()) text += " " + remedy;
  return text;
}

}  // namespace

std::string to_string(const Error& error) {
  return sentence(error.code_name, error.field, error.message, error.remedy);
}

std::string to_string(const Notice& notice) {
  const std::string text = sentence(notice.code, notice.field, notice.message, notice.remedy);
  return notice.count > 1 ? text + " (" + std::to_string(notice.count) + " times)" : text;
}

ErrorKind kind_of(const Error& error) {
  if (error.code == v1::ERROR_CODE_UNKNOWN_SESSION || error.code_name == "idle" || error.code_name == "unknown_session")
    return ErrorKind::kSessionLost;
  if (error.code != 0) return ErrorKind::kRefused;
  if (error.code_name == "invalid") return ErrorKind::kInvalidArgument;
  if (error.code_name == "unreachable") return ErrorKind::kUnreachable;
  if (error.code_name == "timeout") return ErrorKind::kTimedOut;
  if (error.code_name == "closed") return ErrorKind::kClosed;
  return ErrorKind::kOther;
}

std::vector<Figure> figures(const Statistics& statistics) {
  std::vector<Figure> out;
  v1::for_each_figure<Statistics>([&](const char* name, auto member, auto, auto) {
    out.push_back({name, statistics.*member});
  });
  return out;
}

namespace internal {
namespace {

constexpr const char* kClientName = "rustle C++ SDK 0.1.0";
constexpr int kLingerMs = 500;
constexpr int kHandshakeMs = 2'000;
constexpr int kHeartbeatMs = 200;
constexpr int kHeartbeatTimeoutMs = 600;
constexpr int kReconnectMs = 50;
constexpr int kReconnectMaxMs = 200;
constexpr std::chrono::milliseconds kComesBackWithin{600};  ///< a broken connection, as kReconnectMaxMs allows
constexpr std::chrono::milliseconds kLinkEvery{50};
constexpr int kMaxSockets = 512;  ///< of one connection: its sessions and readers

std::string lower_code(int code) {
  const std::string name = v1::ErrorCode_Name(static_cast<v1::ErrorCode>(code));
  constexpr std::string_view kPrefix = "ERROR_CODE_";
  std::string out = name.starts_with(kPrefix) ? name.substr(kPrefix.size()) : "error";
  for (char& c : out)
    if (c >= 'A' && c <= 'Z') c = static_cast<char>(c - 'A' + 'a');
  return out;
}

int type_of(Socket::Role role) {
  switch (role) {
    case Socket::Role::kControl:
      return ZMQ_DEALER;
    case Socket::Role::kStream:
      return ZMQ_XPUB;
    case Socket::Role::kListener:
      return ZMQ_SUB;
  }
  return ZMQ_DEALER;
}

bool set(void* socket, int option, int value) {
  return zmq_setsockopt(socket, option, &value, sizeof(value)) == 0;
}

bool send_message(void* socket, const google::protobuf::MessageLite& body, int flags) {
  zmq_msg_t message;
  const std::size_t size = body.ByteSizeLong();
  if (zmq_msg_init_size(&message, size) != 0) return false;
  body.SerializeWithCachedSizesToArray(static_cast<std::uint8_t*>(zmq_msg_data(&message)));
  if (zmq_msg_send(&message, socket, flags) >= 0) return true;
  zmq_msg_close(&message);
  return false;
}

Error key_refused(const std::string& endpoint) {
  return local_error("unreachable", "The daemon at " + endpoint + " does not admit this key.",
                     "Have its operator take it in: rustle keys allow NAME.key, then reload rustled.", "endpoints.keys");
}

int milliseconds_of(std::chrono::milliseconds timeout) {
  return static_cast<int>(std::clamp<std::int64_t>(timeout.count(), 0, 1'000'000'000));
}

}  // namespace

std::string nonce() {
  static std::atomic<std::uint64_t> calls{0};
  const auto now = std::chrono::steady_clock::now().time_since_epoch().count();
  const auto place = static_cast<unsigned long long>(reinterpret_cast<std::uintptr_t>(&calls));
  return std::to_string(now) + "-" + std::to_string(place) + "-" + std::to_string(++calls);
}

Error local_error(std::string code_name, std::string message, std::string remedy, std::string field) {
  return {.code = 0,
          .code_name = std::move(code_name),
          .field = std::move(field),
          .message = std::move(message),
          .remedy = std::move(remedy)};
}

Error from_wire(const v1::Error& error) {
  return {.code = error.code(),
          .code_name = lower_code(error.code()),
          .field = error.field(),
          .message = error.message(),
          .remedy = error.remedy()};
}

std::string reachable(const std::string& bound, const std::string& control) {
  constexpr std::string_view kTcp = "tcp://";
  const std::size_t port = bound.rfind(':'), ours = control.rfind(':');
  for (const std::string_view any : {"tcp://0.0.0.0:", "tcp://[::]:"})
    if (bound.starts_with(any) && control.starts_with(kTcp) && ours > kTcp.size())
      return control.substr(0, ours) + bound.substr(port);
  return bound;
}

tl::expected<void, Error> read_subscribed(const std::string& answer) {
  v1::Error error;
  if (answer.empty() || !error.ParseFromString(answer)) return {};
  return tl::unexpected(from_wire(error));
}

ServerInfo from_wire(const v1::Welcome& welcome) {
  return {.server = welcome.server(),
          .stream_endpoint = welcome.stream_endpoint(),
          .out_endpoint = welcome.out_endpoint(),
          .rate_hz = welcome.rate_hz(),
          .block_size = welcome.block_size(),
          .sessions = welcome.sessions(),
          .most_sessions = welcome.most_sessions()};
}

v1::ControlRequest hello() {
  v1::ControlRequest request;
  request.mutable_hello()->set_protocol_version(kProtocolVersion);
  request.mutable_hello()->set_client(kClientName);
  return request;
}

tl::expected<ServerInfo, Error> read_welcome(const v1::ControlReply& reply) {
  constexpr const char* kRemedy = "Bring the older of SDK and daemon up to date.";
  if (!reply.has_welcome())
    return tl::unexpected(local_error("malformed", "The daemon's answer is of another kind than what was asked.", kRemedy));
  const std::uint32_t theirs = reply.welcome().protocol_version();
  if (theirs == kProtocolVersion) return from_wire(reply.welcome());
  Error error = local_error(
      "protocol_version",
      "The daemon speaks version " + std::to_string(theirs) + ", this SDK version " + std::to_string(kProtocolVersion) + ".",
      kRemedy);
  error.code = v1::ERROR_CODE_PROTOCOL_VERSION;
  return tl::unexpected(std::move(error));
}

PackInfo from_wire(const v1::PackInfo& pack) {
  return {.name = pack.name(),
          .material = pack.material(),
          .touched_surface = pack.touched_surface(),
          .version = pack.version(),
          .licence = pack.licence(),
          .rate_hz = pack.rate_hz(),
          .units = pack.units(),
          .spectra = pack.spectra(),
          .models = {pack.models().begin(), pack.models().end()}};
}

Statistics from_wire(const v1::Statistics& sent) {
  Statistics out;
  out.session_id = sent.session_id();
  for (const auto& [cause, count] : sent.frames_dropped()) out.frames_dropped[cause] = count;
  v1::for_each_figure<Statistics>([&](const char*, auto member, auto get, auto) { out.*member = (sent.*get)(); });
  return out;
}

ServerStatistics from_wire(const v1::ServerStatistics& sent) {
  ServerStatistics out{.uptime_s = sent.uptime_s(), .cpu_s = sent.cpu_s(), .sessions = sent.sessions()};
  for (const v1::ThreadStatistics& thread : sent.threads())
    out.threads.push_back(
        {.name = thread.name(), .count = thread.count(), .cpu_s = thread.cpu_s(), .waited_s = thread.waited_s()});
  if (!sent.has_playback()) return out;
  const v1::PlaybackStatistics& playback = sent.playback();
  out.playback = {.device = playback.device(),
                  .rate_hz = playback.rate_hz(),
                  .samples_played = playback.samples_played(),
                  .samples_missed = playback.samples_missed(),
                  .devices_opened = playback.devices_opened(),
                  .devices_lost = playback.devices_lost(),
                  .samples_in_gaps = playback.samples_in_gaps(),
                  .samples_left_out = playback.samples_left_out(),
                  .splices = playback.splices()};
  return out;
}

Gain from_wire(const v1::Gain& sent) {
  Gain gain{.gain_db = sent.gain_db(), .sheet_id = {}, .kind = {}, .material = sent.material()};
  if (sent.has_sheet_id()) gain.sheet_id = sent.sheet_id();
  switch (sent.kind()) {
    case v1::SOUND_KIND_CRUMPLING:
      gain.kind = SoundKind::kCrumpling;
      break;
    case v1::SOUND_KIND_FRICTION:
      gain.kind = SoundKind::kFriction;
      break;
    case v1::SOUND_KIND_TEARING:
      gain.kind = SoundKind::kTearing;
      break;
    default:
      break;
  }
  return gain;
}

void to_wire(const Gain& gain, v1::Gain* out) {
  out->set_gain_db(gain.gain_db);
  if (gain.sheet_id) out->set_sheet_id(*gain.sheet_id);
  if (gain.kind) switch (*gain.kind) {
      case SoundKind::kCrumpling:
        out->set_kind(v1::SOUND_KIND_CRUMPLING);
        break;
      case SoundKind::kFriction:
        out->set_kind(v1::SOUND_KIND_FRICTION);
        break;
      case SoundKind::kTearing:
        out->set_kind(v1::SOUND_KIND_TEARING);
        break;
    }
  out->set_material(gain.material);
}

std::string_view kind_name(SoundKind kind) {
  switch (kind) {
    case SoundKind::kCrumpling:
      return "crumpling";
    case SoundKind::kFriction:
      return "friction";
    case SoundKind::kTearing:
      return "tearing";
  }
  return "crumpling";
}

SoundKind kind_from_name(std::string_view name) {
  if (name == "friction") return SoundKind::kFriction;
  if (name == "tearing") return SoundKind::kTearing;
  return SoundKind::kCrumpling;
}

Context::Context(std::optional<Keys> keys) : handle_(zmq_ctx_new()), keys_(std::move(keys)) {
  if (handle_ == nullptr) return;
  zmq_ctx_set(handle_, ZMQ_MAX_SOCKETS, kMaxSockets);
  zmq_ctx_set(handle_, ZMQ_BLOCKY, 0);
}

Context::~Context() {
  if (handle_ != nullptr) zmq_ctx_term(handle_);
}

tl::expected<Socket, Error> Socket::connect(std::shared_ptr<Context> context, Role role, const std::string& endpoint,
                                            const Queues& queues, ConnectionMonitor* monitor) {
  void* handle = context->get() == nullptr ? nullptr : zmq_socket(context->get(), type_of(role));
  const auto out_of_sockets = [] {
    return tl::unexpected(local_error("unreachable",
                                      std::string("ZeroMQ cannot make a socket: ") + zmq_strerror(errno) + ".",
                                      "Raise the limit of open files, or close connections."));
  };
  if (handle == nullptr) return out_of_sockets();
  const std::optional<Keys>& keys = context->keys();
  Socket socket(std::move(context), handle);
  if (keys && (zmq_setsockopt(handle, ZMQ_CURVE_SERVERKEY, keys->server_key.c_str(), keys->server_key.size() + 1) != 0 ||
               zmq_setsockopt(handle, ZMQ_CURVE_PUBLICKEY, keys->public_key.c_str(), keys->public_key.size() + 1) != 0 ||
               zmq_setsockopt(handle, ZMQ_CURVE_SECRETKEY, keys->secret_key.c_str(), keys->secret_key.size() + 1) != 0))
    return tl::unexpected(local_error("invalid", "The keys are no CURVE keys: Z85 of 40 characters each.",
                                      "Read them with read_keys().", "endpoints.keys"));
  set(handle, ZMQ_LINGER, kLingerMs);
  zmq_setsockopt(handle, ZMQ_MAXMSGSIZE, &kMessageBytes, sizeof(kMessageBytes));
  set(handle, ZMQ_SNDHWM, queues.send);
  set(handle, ZMQ_RCVHWM, queues.receive);
  set(handle, ZMQ_HANDSHAKE_IVL, kHandshakeMs);
  // A listener whose queue is full reads no heartbeats, which would end its connection; the control connection has them.
  if (role != Role::kListener) {
    set(handle, ZMQ_HEARTBEAT_IVL, kHeartbeatMs);
    set(handle, ZMQ_HEARTBEAT_TIMEOUT, kHeartbeatTimeoutMs);
    set(handle, ZMQ_HEARTBEAT_TTL, kHeartbeatTimeoutMs);
  }
  set(handle, ZMQ_RECONNECT_IVL, kReconnectMs);
  set(handle, ZMQ_RECONNECT_IVL_MAX, kReconnectMaxMs);
  set(handle, ZMQ_IPV6, endpoint.find('[') != std::string::npos ? 1 : 0);
  // A request waits for the connection instead of reaching a daemon that starts long after its asker gave up.
  if (role == Role::kControl) set(handle, ZMQ_IMMEDIATE, 1);
  // A full queue is reported, so that the session decides between waiting and dropping.
  if (role == Role::kStream) set(handle, ZMQ_XPUB_NODROP, 1);
  if (monitor != nullptr && !monitor->watch(socket.context_, handle)) return out_of_sockets();
  if (zmq_connect(handle, endpoint.c_str()) != 0)
    return tl::unexpected(
        local_error("invalid", endpoint + ": " + zmq_strerror(errno) + ".", "Write tcp://HOST:PORT or ipc://PATH."));
  return socket;
}

ConnectionMonitor::~ConnectionMonitor() {
  if (events_ != nullptr) zmq_close(events_);
}

bool ConnectionMonitor::watch(std::shared_ptr<Context> context, void* socket) {
  const std::string endpoint = "inproc://monitor-" + nonce();
  if (zmq_socket_monitor(socket, endpoint.c_str(),
                         ZMQ_EVENT_HANDSHAKE_SUCCEEDED | ZMQ_EVENT_DISCONNECTED | ZMQ_EVENT_HANDSHAKE_FAILED_AUTH) != 0)
    return false;
  context_ = std::move(context);
  events_ = zmq_socket(context_->get(), ZMQ_PAIR);
  if (events_ == nullptr) return false;
  set(events_, ZMQ_LINGER, 0);
  return zmq_connect(events_, endpoint.c_str()) == 0;
}

ConnectionMonitor::State ConnectionMonitor::look() {
  const std::lock_guard lock(mutex_);
  for (;;) {
    // Two parts: the event's number (16 bits) and value (32 bits), then the endpoint.
    std::uint8_t event[6];
    if (zmq_recv(events_, event, sizeof(event), ZMQ_DONTWAIT) < 2) return state_;
    char endpoint[256];
    zmq_recv(events_, endpoint, sizeof(endpoint), ZMQ_DONTWAIT);
    std::uint16_t number;
    std::memcpy(&number, event, sizeof(number));
    const bool connected = number == ZMQ_EVENT_HANDSHAKE_SUCCEEDED;
    if (connected || number == ZMQ_EVENT_HANDSHAKE_FAILED_AUTH) state_.key_refused = !connected;
    if (connected == state_.connected || (!connected && number != ZMQ_EVENT_DISCONNECTED)) continue;
    if (!connected) ++state_.breaks;
    state_.connected = connected;
    state_.since = Clock::now();
  }
}

Socket::Socket(Socket&& other) noexcept
    : context_(std::move(other.context_)), handle_(std::exchange(other.handle_, nullptr)) {}

Socket& Socket::operator=(Socket&& other) noexcept {
  std::swap(context_, other.context_);
  std::swap(handle_, other.handle_);
  return *this;
}

Socket::~Socket() {
  if (handle_ != nullptr) zmq_close(handle_);
}

bool Socket::wait(std::chrono::milliseconds timeout) const {
  zmq_pollitem_t item{handle_, 0, ZMQ_POLLIN, 0};
  return zmq_poll(&item, 1, milliseconds_of(timeout)) > 0;
}

std::vector<std::string> Socket::receive() const {
  std::vector<std::string> parts;
  while (true) {
    zmq_msg_t part;
    zmq_msg_init(&part);
    if (zmq_msg_recv(&part, handle_, ZMQ_DONTWAIT) < 0) {
      zmq_msg_close(&part);
      return {};
    }
    parts.emplace_back(static_cast<const char*>(zmq_msg_data(&part)), zmq_msg_size(&part));
    const bool more = zmq_msg_more(&part) != 0;
    zmq_msg_close(&part);
    if (!more) return parts;
  }
}

std::vector<std::string> Socket::receive_until(Clock::time_point deadline) const {
  for (;;) {
    auto parts = receive();
    if (!parts.empty()) return parts;
    const auto left = std::chrono::ceil<std::chrono::milliseconds>(deadline - Clock::now());
    if (left.count() <= 0 || !wait(left)) return {};
  }
}

bool Socket::send(std::string_view first, const google::protobuf::MessageLite& second,
                  std::chrono::milliseconds timeout) const {
  const int flags = timeout.count() == 0 ? ZMQ_DONTWAIT : 0;
  set(handle_, ZMQ_SNDTIMEO, milliseconds_of(timeout));
  if (zmq_send(handle_, first.data(), first.size(), flags | ZMQ_SNDMORE) < 0) return false;
  return send_message(handle_, second, flags);
}

bool Socket::send(const google::protobuf::MessageLite& only, std::chrono::milliseconds timeout) const {
  set(handle_, ZMQ_SNDTIMEO, milliseconds_of(timeout));
  return send_message(handle_, only, timeout.count() == 0 ? ZMQ_DONTWAIT : 0);
}

void Socket::subscribe(std::string_view topic) const {
  zmq_setsockopt(handle_, ZMQ_SUBSCRIBE, topic.data(), topic.size());
}
void Socket::unsubscribe(std::string_view topic) const {
  zmq_setsockopt(handle_, ZMQ_UNSUBSCRIBE, topic.data(), topic.size());
}

void Socket::forget_unsent() const {
  set(handle_, ZMQ_LINGER, 0);
}
void Socket::follow(const std::string& from, const std::string& to) const {
  zmq_disconnect(handle_, from.c_str());
  zmq_connect(handle_, to.c_str());
}
void Socket::attend() const {
  int events = 0;
  std::size_t size = sizeof(events);
  zmq_getsockopt(handle_, ZMQ_EVENTS, &events, &size);
}

tl::expected<void, Error> Socket::wait_subscribed(std::chrono::milliseconds timeout,
                                                  std::vector<std::vector<std::string>>& early) const {
  const std::string topic = "subscribed/" + nonce();
  subscribe(topic);
  const auto deadline = internal::Clock::now() + timeout;
  tl::expected<void, Error> granted = tl::unexpected(local_error("timeout", "The daemon did not confirm the subscription.",
                                                                 "Check that the out endpoint can be reached from here."));
  for (bool seen = false; !seen;) {
    const auto left = std::chrono::ceil<std::chrono::milliseconds>(deadline - internal::Clock::now());
    if (left.count() <= 0 || !wait(left)) break;
    auto parts = receive();
    if (parts.empty()) continue;
    seen = parts.front() == topic;
    if (seen) {
      granted = read_subscribed(parts.back());
    } else {
      early.push_back(std::move(parts));
    }
  }
  unsubscribe(topic);
  return granted;
}

Link::Link(std::shared_ptr<Context> context, Socket control, std::unique_ptr<ConnectionMonitor> monitor, Endpoints endpoints,
           std::chrono::milliseconds timeout)
    : context_(std::move(context)),
      monitor_(std::move(monitor)),
      control_(std::move(control)),
      endpoints_(std::move(endpoints)),
      timeout_(timeout) {}

std::string Link::stream_endpoint() const {
  return endpoints_.stream.empty() ? reachable(server().stream_endpoint, endpoints_.control) : endpoints_.stream;
}
std::string Link::out_endpoint() const {
  return endpoints_.out.empty() ? reachable(server().out_endpoint, endpoints_.control) : endpoints_.out;
}

tl::expected<void, Error> Link::check() const {
  const auto state = monitor_->look();
  if (state.connected || state.breaks == 0 || internal::Clock::now() - state.since < kComesBackWithin) return {};
  return tl::unexpected(local_error(
      "unreachable", "The daemon at " + endpoints_.control + " is gone: its connection broke and does not come back.",
      "See why rustled ended, start it again, and attach anew."));
}

tl::expected<v1::ControlReply, Error> Link::ask(v1::ControlRequest& request) {
  const std::lock_guard lock(mutex_);
  request.set_request_id(next_request_++);
  const auto deadline = internal::Clock::now() + timeout_;
  const auto no_answer = [this] {
    if (connection().key_refused) return tl::unexpected(key_refused(endpoints_.control));
    return tl::unexpected(local_error(
        "unreachable", "No answer from " + endpoints_.control + " within " + std::to_string(timeout_.count()) + " ms.",
        "Start rustled, or give the control endpoint it prints when it starts."));
  };
  const auto left = [&deadline] { return std::chrono::ceil<std::chrono::milliseconds>(deadline - internal::Clock::now()); };
  while (!control_.send(request, std::clamp(left(), std::chrono::milliseconds(0), kLinkEvery))) {
    if (left().count() <= 0) return no_answer();
    if (auto there = check(); !there) return tl::unexpected(std::move(there.error()));
  }
  const std::uint64_t breaks = connection().breaks;
  while (true) {
    if (left().count() <= 0) return no_answer();
    if (!control_.wait(std::min(left(), kLinkEvery))) {
      if (auto there = check(); !there) return tl::unexpected(std::move(there.error()));
      if (connection().breaks != breaks)
        return tl::unexpected(local_error("unreachable",
                                          "The connection to " + endpoints_.control + " broke before the answer came.",
                                          "Ask again; if rustled has ended, start it again and attach anew."));
      continue;
    }
    const auto parts = control_.receive();
    v1::ControlReply reply;
    if (parts.size() != 1 || !reply.ParseFromString(parts.front()) || reply.request_id() != request.request_id()) continue;
    if (reply.has_error()) return tl::unexpected(from_wire(reply.error()));
    return reply;
  }
}

ServerInfo Link::server() const {
  const std::lock_guard lock(server_mutex_);
  return server_;
}

void Link::set_server(ServerInfo server) {
  const std::lock_guard lock(server_mutex_);
  server_ = std::move(server);
}

void Link::tell(v1::ControlRequest& request) {
  const std::lock_guard lock(mutex_);
  request.set_request_id(next_request_++);
  control_.send(request, std::chrono::milliseconds(0));
}

}  // namespace internal
}  // namespace rustle::client
