#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <tl/expected.hpp>

#include "client_sdk/cpp/connection.h"
#include "client_sdk/cpp/observation_reader.h"
#include "client_sdk/cpp/pcm_reader.h"
#include "client_sdk/cpp/types.h"

namespace rustle::client {

enum class Sent {
  kQueued,   ///< on its way
  kDropped,  ///< live clock only: the queue was full, or the daemon is away; counted
};
using SendResult = tl::expected<Sent, Error>;

struct AttachOptions {
  /// What becomes of the session when the daemon goes away (see Session); absent: as its clock has it.
  std::optional<bool> reconnect{};
  /// Called with every notice, by the session's own calls and in their thread; poll_notices() has them too.
  std::function<void(const Notice&)> on_notice{};
};

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
/// SIMULATION clock: every message waits until the daemon's window has room (FlowCredit), at most send_timeout; nothing is
/// dropped.
/// LIVE clock: frame(), tear_tips(), listener() and advance() never wait; when the queue to the daemon is full, the message
/// is dropped and counted. Sheets, topologies, scenes and the end wait for room, at most send_timeout.
/// Refused messages come back as notices: see poll_notices().
///
/// A daemon that goes away
///   reconnect = false  is an "unreachable" error within two seconds; one that was started anew does not know the session:
///                      "unknown_session".
///   reconnect = true   is waited for. Whatever is sent to the daemon that came back goes on under the same session id: the
///                      session attaches again and sends its gains, sheets, topologies, scene and listener first.
///                      LIVE: nothing waits and nothing is an error meanwhile; frames are dropped and counted. There is no
///                      thread behind it: the calls themselves do the work, so it goes on as long as they come. What the new
///                      daemon refuses for good, such as a material it does not have, is the error of every later call.
///                      SIMULATION: calls wait, at most send_timeout. What the old daemon had acknowledged is not sent
///                      again, what it had not acknowledged is; the new sound begins at the newest acknowledged time. What
///                      had been acknowledged and not yet heard, and the motion's history, died with the old daemon: the
///                      sound has one gap there (PcmBlock::restarted) and is no longer the same, bit for bit, as without the
///                      restart.
/// Unless told otherwise LIVE sessions reconnect and SIMULATION sessions, which promise the same samples, do not. Readers
/// that the session opened do as the session does. A session that the daemon ended because nothing came ("idle") attaches
/// again where it reconnects; one that somebody else detached is refused whatever it sends.
class Session {
 public:
  /// Returns when the daemon's subscription to this session has arrived and the session's credits and notices are heard:
  /// nothing is lost at the start.
  /// Errors: the daemon's, "timeout", "invalid" (the daemon takes no streams: started with --connect only).
  [[nodiscard]] static tl::expected<Session, Error> attach(const Connection& connection, const SessionOptions& options,
                                                           const AttachOptions& how = {});

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
  /// What the daemon sees in the session's frames, from now on.
  [[nodiscard]] tl::expected<ObservationReader, Error> observe() const;

  [[nodiscard]] tl::expected<Statistics, Error> statistics() const;
  /// As Connection's; told again to a daemon that comes back.
  [[nodiscard]] tl::expected<std::vector<Gain>, Error> set_gains(const std::vector<Gain>& gains) const;
  [[nodiscard]] tl::expected<PackInfo, Error> change_pack(std::uint32_t sheet_id, const std::string& material,
                                                          const std::string& touched_surface = {}) const;

  /// Records from now on, in a file of the daemon's recording folder: a plain name, or empty for one that the daemon
  /// chooses. Returns the name. What sounds already, and the motion so far, is not in it: a session that is to be recorded
  /// whole is attached with SessionOptions::record. Ends with the session; a daemon that starts anew does not go on with it.
  [[nodiscard]] tl::expected<std::string, Error> start_recording(const std::string& file_name = {});
  /// Returns when the file is closed.
  [[nodiscard]] tl::expected<RecordingInfo, Error> stop_recording();
  /// Where the session is recorded; empty: nowhere, as far as was heard.
  const std::string& recording_file_name() const;
  /// Everything up to this message that was recorded is on the daemon's disk, as far as was heard.
  std::uint64_t stored_sequence() const;

  /// What the daemon said about this session's messages since the last call, oldest first; at most 1024 are kept.
  [[nodiscard]] std::vector<Notice> poll_notices();

  /// Waits until everything sent was acknowledged. SIMULATION clock only; on the live clock it returns at once.
  [[nodiscard]] tl::expected<void, Error> drain(std::chrono::milliseconds timeout);

  /// Ends the session at the daemon; returns its last figures. With `discard` what was not yet rendered is dropped.
  [[nodiscard]] tl::expected<Statistics, Error> detach(bool discard = false);

  /// Leaves without a word, as a process that dies: the daemon finds out by itself. Afterwards nothing but destruction.
  void abandon() noexcept;

  void set_send_timeout(std::chrono::milliseconds timeout);     ///< 10 s unless set
  std::uint32_t vertex_count(std::uint64_t topology_id) const;  ///< of a topology that was added; 0: it was not
  std::uint64_t sent_messages() const;
  std::uint64_t dropped_messages() const;       ///< live clock: because the queue was full, or the daemon away
  std::uint64_t acknowledged_sequence() const;  ///< simulation clock
  std::uint64_t next_sequence() const;
  bool connected() const;            ///< false while the daemon is away and waited for
  std::uint64_t reattached() const;  ///< how often it attached again, to a daemon that came back without it

 private:
  struct Impl;
  explicit Session(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace rustle::client
