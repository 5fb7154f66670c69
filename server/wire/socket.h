#pragma once

#include <cstdint>
#include <string>
#include <string_view>

#include <tl/expected.hpp>

#include "server/wire/security.h"

namespace rustle::wire {

/// One ZeroMQ socket with every option set on purpose, because libzmq's defaults bite: no limit on sizes, LINGER for ever,
/// 30 s for a handshake, no heartbeats. One thread at a time.
class Socket {
 public:
  static constexpr int kHandshakeMs = 2'000;  ///< a connection that has not said who it is by then is closed
  static constexpr int kBacklog = 256;        ///< connections that wait to be accepted

  Socket() = default;
  Socket(void* context, int type);
  ~Socket();
  Socket(Socket&& other) noexcept;
  Socket& operator=(Socket&& other) noexcept;

  void* get() const { return handle_; }
  bool set(int option, int value);

  /// False: no resources.
  bool configure(std::int64_t message_bytes, int send_queue, int receive_queue);
  /// A listener whose queue is full reads nothing, heartbeats neither, and is no less there: only its closed connection says
  /// that it is gone.
  bool trust_listeners();
  /// Whoever connects must prove a key, which ZAP is asked about.
  bool serve_keys(const Security& security);
  /// What is connected to from now on must prove `server_key`.
  bool pin(const Security& security, const std::string& server_key);

  /// The endpoint in force. Error: a sentence with flag and remedy.
  tl::expected<std::string, std::string> bind(std::string_view endpoint, std::string_view flag);
  tl::expected<void, std::string> connect(const std::string& endpoint);

 private:
  bool set64(int option, std::int64_t value);
  bool set_text(int option, const std::string& value);

  void* handle_ = nullptr;
};

}  // namespace rustle::wire
