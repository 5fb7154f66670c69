#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include <tl/expected.hpp>

#include "server/wire/security.h"

namespace rustle::wire {

/// A received message's bytes, without a copy. Moves, and frees on destruction; any thread.
class Message {
 public:
  Message() noexcept;
  Message(Message&& other) noexcept;
  Message& operator=(Message&& other) noexcept;
  ~Message();

  std::span<const std::byte> bytes() const;

 private:
  friend class Sockets;
  alignas(void*) std::byte storage_[64];  ///< a zmq_msg_t
};

/// Who asked on the control socket: where the answer goes.
struct ControlPeer {
  std::string identity;
  bool delimited = false;  ///< a REQ socket, which wants an empty part before the answer
};

struct ControlRequestReceived {
  ControlPeer peer;
  Message bytes;
  std::string user;  ///< see Security; empty without keys
};
struct StreamReceived {
  std::string topic;  ///< empty where the publisher left it out
  Message bytes;
  std::string user;  ///< see Security; empty without keys
};
/// The first listener subscribed to this topic of the out socket, or the last one left. A subscription is a prefix: "" or
/// "SESSION/" stand for everything that begins so.
struct SubscriptionChanged {
  std::string topic;
  bool on = false;
};
using Event = std::variant<ControlRequestReceived, StreamReceived, SubscriptionChanged>;

/// The daemon's three sockets:
///   control  ROUTER, bound    requests in, replies out
///   stream   SUB, bound, and one more connected to each publisher; takes everything
///   out      XPUB, bound      topic by topic to who subscribed; a slow listener loses its own messages only
/// Every option whose default of libzmq would bite is set in socket.cpp, once. No method throws.
///
/// With keys (Options::security) everybody who connects proves one (CURVE) and is asked about (ZAP), every message carries
/// its user, whatever routing id or topic it bears, and subscriptions are put in force one by one where they are granted
/// (XPUB_MANUAL). Nothing of a user that is not admitted any more becomes an event, and its connection is cut.
///
/// Listeners learn that their subscriptions are in force: see kSubscribedPrefix in topics.h. The answer leaves at the
/// beginning of the poll() after the one that returned the events before it, so what those events asked for is done.
class Sockets {
 public:
  struct Options {
    std::string control = "tcp://127.0.0.1:7390";
    std::string stream = "tcp://127.0.0.1:7391";  ///< empty: nothing is bound for the stream
    std::string out = "tcp://127.0.0.1:7392";
    std::vector<Publisher> connect;                     ///< to subscribe to
    std::size_t message_bytes = std::size_t{64} << 20;  ///< a larger one costs its sender the connection
    std::size_t control_bytes = std::size_t{1} << 20;
    int stream_queue_messages = 1024;  ///< per publisher
    int out_queue_messages = 8192;     ///< per listener; at 48 kHz and four blocks of 128 a message, 87 s
    std::optional<Security> security;  ///< absent: nobody is asked who it is
    bool insecure = false;             ///< without keys, others than this machine may be served
  };

  /// Error: a sentence that names the endpoint, the flag ("--control", "--stream", "--out", "--connect") and the remedy.
  /// Without keys only loopback and ipc are bound, unless `insecure`.
  [[nodiscard]] static tl::expected<std::unique_ptr<Sockets>, std::string> open(const Options& options);

  ~Sockets();
  Sockets(const Sockets&) = delete;
  Sockets& operator=(const Sockets&) = delete;

  /// The endpoints in force, with the ports the system chose. Any thread.
  const std::string& control_endpoint() const;
  const std::string& stream_endpoint() const;  ///< empty: not bound
  const std::string& out_endpoint() const;

  /// Sends what was posted, waits until something arrives, is posted, wake() is called or the timeout passes, and appends
  /// what arrived to `events`: at most 256 of each socket, and 64 MiB of the stream, in each socket's order. [network
  /// thread]
  void poll(std::chrono::milliseconds timeout, std::vector<Event>& events);

  /// False where the asker has gone or does not read. [network thread]
  bool send_control(const ControlPeer& peer, std::string_view bytes);
  /// False where the socket did not take it. A listener that lags loses the message without a word here.
  /// [network thread]
  bool publish(std::string_view topic, std::string_view bytes);
  /// True where some subscription covers the topic. [network thread]
  bool has_listener(std::string_view topic) const;
  /// Subscriptions in force, in order. [network thread]
  std::vector<std::string> subscriptions() const;

  /// Asks Security again about every subscription in force, and cuts the connections of those that are not granted any more:
  /// nothing that is published from now on reaches them. [network thread]
  void cut_listeners();

  /// Hands over to the network thread, which publishes or sends in the order of the posts. [any thread]
  void post(std::string topic, std::string bytes);
  void post_control(ControlPeer peer, std::string bytes);
  /// Ends the poll() that waits, or the next one. [any thread]
  void wake();

  struct Counters {
    std::uint64_t malformed_messages = 0;  ///< with too many or too few parts
    std::uint64_t unsent_replies = 0;
    std::uint64_t refused_connections = 0;    ///< keys that are not admitted
    std::uint64_t revoked_messages = 0;       ///< of connections whose key is not admitted any more
    std::uint64_t refused_subscriptions = 0;  ///< to what the key may not hear
  };
  /// [network thread]
  Counters counters() const;

 private:
  struct Impl;
  explicit Sockets(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace rustle::wire
