#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <tl/expected.hpp>

#include "client_sdk/cpp/connection.h"
#include "client_sdk/cpp/pcm_reader.h"
#include "client_sdk/cpp/types.h"

namespace rustle::client {

enum class Sent {
  kQueued,   ///< on its way
  kDropped,  ///< live clock only: the queue was full; counted
};
using SendResult = tl::expected<Sent, Error>;

/// How raw() treats a message that was made elsewhere, such as one of a capture.
struct RawOptions {
  bool keep_sequence = false;  ///< else numbered as this session's next, and stamped with this sender's clock
  bool wait = true;            ///< false: dropped where frame() of the live clock would drop it
};

/// A simulator's session with the daemon. One thread at a time.
///
///   auto connection = Connection::connect();
///   auto session = Session::attach(*connection, {.name = "flag", .clock = Clock::kSimulation, .sheets = {{.id = 1}}});
///   session->add_topology({.id = 1, .vertex_count = vertices, .triangles = triangles});
///   for (double t = 0; t < 10; t += 1 / 60.0) session->frame(1, 1, t, simulate(t));
///   session->end();
///
/// SIMULATION clock: every message waits until the daemon's window has room (FlowCredit), at most send_timeout.
/// LIVE clock: frame(), tear_tips(), listener() and advance() never wait; when the queue to the daemon is full, the message
/// is dropped and counted. Sheets, topologies, scenes and the end wait for room, at most send_timeout.
/// Refused messages come back as notices: see poll_notices(). A daemon that goes away is an "unreachable" error within two
/// seconds; a session that the daemon ended ("idle", or a daemon started anew) refuses whatever is sent after.
class Session {
 public:
  /// Returns when the daemon's subscription to this session has arrived and the session's credits and notices are heard:
  /// nothing is lost at the start.
  /// Errors: the daemon's, "timeout", "invalid" (the daemon takes no streams: started with --connect only).
  [[nodiscard]] static tl::expected<Session, Error> attach(const Connection& connection, const SessionOptions& options);

  Session(Session&&) noexcept;
  Session& operator=(Session&&) noexcept;
  /// Detaches where detach() was not called; what was sent is rendered.
  ~Session();

  const std::string& id() const;
  /// As in force: rate, block and so on settled by the daemon.
  const SessionOptions& options() const;

  SendResult add_sheet(const SheetOptions& sheet);
  SendResult add_topology(const Topology& topology);
  /// positions: [V,3] of the topology, which must have been added.
  SendResult frame(std::uint32_t sheet_id, std::uint64_t topology_id, double time_s, std::span<const float> positions,
                   const FrameExtras& extras = {});
  SendResult scene(const SceneUpdate& update);
  SendResult listener(const Listener& listener);
  SendResult tear_tips(std::uint32_t sheet_id, double time_s, std::span<const TearTip> tips);
  /// Sound up to this time may be rendered, whatever is still to come.
  SendResult advance(double time_s);
  /// The last message; absent: the newest time sent.
  SendResult end(std::optional<double> time_s = {});
  /// A serialized rustle.v1.StreamMessage; its session id is replaced by this session's.
  SendResult raw(std::span<const std::byte> stream_message, const RawOptions& options = {});

  /// Subscribes and returns when that is in force: what is sent afterwards is heard whole.
  [[nodiscard]] tl::expected<PcmReader, Error> listen(const ListenOptions& options = {}) const;

  [[nodiscard]] tl::expected<Statistics, Error> statistics() const;
  [[nodiscard]] tl::expected<std::vector<Gain>, Error> set_gains(const std::vector<Gain>& gains) const;

  /// What the daemon said about this session's messages since the last call, oldest first; at most 1024 are kept.
  [[nodiscard]] std::vector<Notice> poll_notices();

  /// Waits until everything sent was acknowledged. SIMULATION clock only; on the live clock it returns at once.
  [[nodiscard]] tl::expected<void, Error> drain(std::chrono::milliseconds timeout);

  /// Ends the session at the daemon; returns its last figures. With `discard` what was not yet rendered is dropped.
  [[nodiscard]] tl::expected<Statistics, Error> detach(bool discard = false);

  void set_send_timeout(std::chrono::milliseconds timeout);  ///< 10 s unless set
  std::uint64_t sent_messages() const;
  std::uint64_t dropped_messages() const;       ///< live clock
  std::uint64_t acknowledged_sequence() const;  ///< simulation clock
  std::uint64_t next_sequence() const;

 private:
  struct Impl;
  explicit Session(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace rustle::client
