#include "server/wire/socket.h"

#include <cerrno>
#include <utility>

#include <fmt/format.h>
#include <zmq.h>

#include "server/wire/endpoint.h"

namespace rustle::wire {
namespace {

constexpr int kLingerMs = 500;
constexpr int kHeartbeatMs = 200;
constexpr int kHeartbeatTimeoutMs = 600;
constexpr int kReconnectMs = 100;
constexpr int kReconnectMaxMs = 1'000;
constexpr int kZapEnforceDomain = 93;  // ZMQ_ZAP_ENFORCE_DOMAIN, which the library knows and Debian's header leaves out

}  // namespace

Socket::Socket(void* context, int type) : handle_(zmq_socket(context, type)) {}
Socket::~Socket() {
  if (handle_ != nullptr) zmq_close(handle_);
}
Socket::Socket(Socket&& other) noexcept : handle_(std::exchange(other.handle_, nullptr)) {}
Socket& Socket::operator=(Socket&& other) noexcept {
  std::swap(handle_, other.handle_);
  return *this;
}

bool Socket::set(int option, int value) {
  return zmq_setsockopt(handle_, option, &value, sizeof(value)) == 0;
}
bool Socket::set64(int option, std::int64_t value) {
  return zmq_setsockopt(handle_, option, &value, sizeof(value)) == 0;
}
bool Socket::set_text(int option, const std::string& value) {
  return zmq_setsockopt(handle_, option, value.c_str(), value.size() + 1) == 0;
}

bool Socket::configure(std::int64_t message_bytes, int send_queue, int receive_queue) {
  return handle_ != nullptr && set(ZMQ_LINGER, kLingerMs) && set64(ZMQ_MAXMSGSIZE, message_bytes) &&
         set(ZMQ_SNDHWM, send_queue) && set(ZMQ_RCVHWM, receive_queue) && set(ZMQ_HANDSHAKE_IVL, kHandshakeMs) &&
         set(ZMQ_HEARTBEAT_IVL, kHeartbeatMs) && set(ZMQ_HEARTBEAT_TIMEOUT, kHeartbeatTimeoutMs) &&
         set(ZMQ_HEARTBEAT_TTL, kHeartbeatTimeoutMs) && set(ZMQ_BACKLOG, kBacklog) && set(ZMQ_RECONNECT_IVL, kReconnectMs) &&
         set(ZMQ_RECONNECT_IVL_MAX, kReconnectMaxMs);
}

bool Socket::trust_listeners() {
  return set(ZMQ_HEARTBEAT_IVL, 0) && set(ZMQ_TCP_KEEPALIVE, 1);
}

bool Socket::serve_keys(const Security& security) {
  return zmq_setsockopt(handle_, ZMQ_ZAP_DOMAIN, kZapDomain, std::string_view(kZapDomain).size()) == 0 &&
         set(kZapEnforceDomain, 1) && set(ZMQ_CURVE_SERVER, 1) && set_text(ZMQ_CURVE_SECRETKEY, security.secret_key);
}

bool Socket::pin(const Security& security, const std::string& server_key) {
  return set(ZMQ_CURVE_SERVER, 0) && set_text(ZMQ_CURVE_SERVERKEY, server_key) &&
         set_text(ZMQ_CURVE_PUBLICKEY, security.public_key) && set_text(ZMQ_CURVE_SECRETKEY, security.secret_key);
}

tl::expected<std::string, std::string> Socket::bind(std::string_view endpoint, std::string_view flag) {
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

tl::expected<void, std::string> Socket::connect(const std::string& endpoint) {
  set(ZMQ_IPV6, endpoint.find('[') != std::string::npos ? 1 : 0);
  if (zmq_connect(handle_, endpoint.c_str()) == 0) return {};
  return tl::unexpected(
      fmt::format("--connect {}: {}; write tcp://HOST:PORT or ipc://PATH.", endpoint, zmq_strerror(errno)));
}

}  // namespace rustle::wire
