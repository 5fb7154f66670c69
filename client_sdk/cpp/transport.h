#pragma once

#include <chrono>
#include <cstdint>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include <tl/expected.hpp>

#include "client_sdk/cpp/types.h"
#include "rustle/v1/session.pb.h"

/// ZeroMQ under the SDK. Not for applications.
namespace rustle::client::internal {

inline constexpr std::uint32_t kProtocolVersion = 1;
inline constexpr std::int64_t kMessageBytes = std::int64_t{64} << 20;  ///< what a daemon takes, and what is taken from it

using Clock = std::chrono::steady_clock;

Error local_error(std::string code_name, std::string message, std::string remedy, std::string field = {});
Error from_wire(const v1::Error& error);
ServerInfo from_wire(const v1::Welcome& welcome);
v1::ControlRequest hello();
/// Error: "malformed" (another answer), "protocol_version".
tl::expected<ServerInfo, Error> read_welcome(const v1::ControlReply& reply);
PackInfo from_wire(const v1::PackInfo& pack);
Statistics from_wire(const v1::Statistics& statistics);
ServerStatistics from_wire(const v1::ServerStatistics& statistics);
Gain from_wire(const v1::Gain& gain);
void to_wire(const Gain& gain, v1::Gain* out);
std::string_view kind_name(SoundKind kind);
SoundKind kind_from_name(std::string_view name);

/// An endpoint as the daemon bound it, seen from here: of one that is bound to all addresses, at the host of `control`.
/// Pure.
std::string reachable(const std::string& bound, const std::string& control);
/// What the daemon answers where a subscription is refused: a serialized Error; empty: it is granted.
tl::expected<void, Error> read_subscribed(const std::string& answer);

/// Different for every call on this machine.
std::string nonce();

/// A ZeroMQ context, shared by everything that came of one connection, and the keys of all its sockets.
class Context {
 public:
  explicit Context(std::optional<Keys> keys);
  ~Context();
  Context(const Context&) = delete;
  Context& operator=(const Context&) = delete;
  void* get() const { return handle_; }
  const std::optional<Keys>& keys() const { return keys_; }

 private:
  void* handle_;
  const std::optional<Keys> keys_;
};

/// Whether a socket is connected, by its monitor. Any thread.
class ConnectionMonitor {
 public:
  struct State {
    std::uint64_t breaks = 0;  ///< so far
    bool connected = false;
    bool key_refused = false;   ///< the daemon admits no such key, as far as the newest attempt says
    Clock::time_point since{};  ///< of the newest change
  };

  ConnectionMonitor() = default;
  ~ConnectionMonitor();
  ConnectionMonitor(const ConnectionMonitor&) = delete;
  ConnectionMonitor& operator=(const ConnectionMonitor&) = delete;

  /// Once, before the socket connects. False: no resources.
  bool watch(std::shared_ptr<Context> context, void* socket);
  State look();

 private:
  std::mutex mutex_;
  std::shared_ptr<Context> context_;
  void* events_ = nullptr;
  State state_;
};

/// A socket with every option set on purpose (transport.cpp). One thread at a time.
class Socket {
 public:
  enum class Role { kControl, kStream, kListener };
  struct Queues {
    int send = 1024;
    int receive = 1024;  ///< 0: no limit
  };

  [[nodiscard]] static tl::expected<Socket, Error> connect(std::shared_ptr<Context> context, Role role,
                                                           const std::string& endpoint, const Queues& queues,
                                                           ConnectionMonitor* monitor = nullptr);
  Socket(Socket&& other) noexcept;
  Socket& operator=(Socket&& other) noexcept;
  ~Socket();

  /// Waits until a message can be received.
  bool wait(std::chrono::milliseconds timeout) const;
  /// One message's parts; empty when none waits.
  std::vector<std::string> receive() const;
  /// The same, waiting for it; empty when none came by then.
  std::vector<std::string> receive_until(Clock::time_point deadline) const;
  /// Milliseconds 0: at once or not at all. False when there was no room in time.
  bool send(std::string_view first, const google::protobuf::MessageLite& second, std::chrono::milliseconds timeout) const;
  bool send(const google::protobuf::MessageLite& only, std::chrono::milliseconds timeout) const;
  void subscribe(std::string_view topic) const;
  void unsubscribe(std::string_view topic) const;
  /// Closing drops what is still queued.
  void forget_unsent() const;
  /// Goes from one endpoint to another.
  void follow(const std::string& from, const std::string& to) const;
  /// Does what other threads have left to this socket, such as subscribing at a daemon that came back.
  void attend() const;

  /// Listener: waits until the daemon has all subscriptions made so far; what else arrives meanwhile is appended to `early`.
  /// Errors: "timeout", and the daemon's where it grants a subscription to others only.
  [[nodiscard]] tl::expected<void, Error> wait_subscribed(std::chrono::milliseconds timeout,
                                                          std::vector<std::vector<std::string>>& early) const;

 private:
  Socket(std::shared_ptr<Context> context, void* handle) : context_(std::move(context)), handle_(handle) {}

  std::shared_ptr<Context> context_;
  void* handle_ = nullptr;
};

/// A control connection.
class Link {
 public:
  Link(std::shared_ptr<Context> context, Socket control, std::unique_ptr<ConnectionMonitor> monitor, Endpoints endpoints,
       std::chrono::milliseconds timeout);

  /// Asks and waits for the answer with the same id. An answer that is an error comes back as one. Any thread.
  tl::expected<v1::ControlReply, Error> ask(v1::ControlRequest& request);
  /// At once. Error: the daemon was there, and has been gone for longer than a connection takes to come back. Any thread.
  tl::expected<void, Error> check() const;
  /// Any thread.
  ConnectionMonitor::State connection() const { return monitor_->look(); }
  /// Asks without waiting. Any thread.
  void tell(v1::ControlRequest& request);

  const std::shared_ptr<Context>& context() const { return context_; }
  const std::string& control_endpoint() const { return endpoints_.control; }
  std::chrono::milliseconds timeout() const { return timeout_; }
  /// What the newest welcome said. Any thread.
  ServerInfo server() const;
  void set_server(ServerInfo server);
  /// The caller's choice, or the daemon's. Any thread.
  std::string stream_endpoint() const;
  std::string out_endpoint() const;

 private:
  std::shared_ptr<Context> context_;
  const std::unique_ptr<ConnectionMonitor> monitor_;
  std::mutex mutex_;
  Socket control_;
  const Endpoints endpoints_;
  const std::chrono::milliseconds timeout_;
  std::uint64_t next_request_ = 1;
  mutable std::mutex server_mutex_;
  ServerInfo server_{};
};

}  // namespace rustle::client::internal
