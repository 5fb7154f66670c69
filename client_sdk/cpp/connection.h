#pragma once

#include <chrono>
#include <memory>
#include <string>
#include <vector>

#include <tl/expected.hpp>

#include "client_sdk/cpp/types.h"

namespace rustle::client {

namespace internal {
class Link;
}

/// The control socket of a daemon: what is asked is answered. Copies share the connection. Any thread; requests take turns.
/// By itself it comes back when the daemon does.
class Connection {
 public:
  /// Says hello and waits for the welcome. `timeout` holds for this and every later request; a daemon that goes away is
  /// noticed within two seconds.
  /// Errors: "invalid" (endpoint, keys), "unreachable" (nobody answers, or not to this key), protocol_version.
  [[nodiscard]] static tl::expected<Connection, Error> connect(
      const Endpoints& endpoints = {}, std::chrono::milliseconds timeout = std::chrono::milliseconds(5'000));

  /// As the newest daemon said: one that a session found again may be another.
  ServerInfo server() const;

  /// Whether the daemon is still there, without asking it: at once. Any thread.
  /// Error: "unreachable", soon after its connection broke and did not come back.
  [[nodiscard]] tl::expected<void, Error> check() const;
  /// Says hello again.
  [[nodiscard]] tl::expected<ServerInfo, Error> ping() const;
  [[nodiscard]] tl::expected<std::vector<PackInfo>, Error> list_packs() const;
  [[nodiscard]] tl::expected<std::vector<SessionInfo>, Error> list_sessions() const;
  [[nodiscard]] tl::expected<Statistics, Error> statistics(const std::string& session_id) const;
  /// Of the daemon itself.
  [[nodiscard]] tl::expected<ServerStatistics, Error> server_statistics() const;
  /// Changes gains while the session sounds, without a click: each takes the place of the one for the same sheet, kind and
  /// material, 0 dB takes it away, the others stay. Returns all in force; none given: only asks.
  [[nodiscard]] tl::expected<std::vector<Gain>, Error> set_gains(const std::string& session_id,
                                                                 const std::vector<Gain>& gains) const;
  /// The sheet gets another pack while it sounds: what sounds goes on as it began, what begins has the new one, friction
  /// goes over to it. Empty: as it is.
  [[nodiscard]] tl::expected<PackInfo, Error> change_pack(const std::string& session_id, std::uint32_t sheet_id,
                                                          const std::string& material,
                                                          const std::string& touched_surface = {}) const;
  /// The daemon reads packs of this name or material from disk anew, or all that are there; sessions that play them go over.
  /// Returns them. All or nothing: where one cannot be read the error names the file.
  [[nodiscard]] tl::expected<std::vector<PackInfo>, Error> reload_pack(const std::string& name = {}) const;
  /// Records a session from now on in the daemon's recording folder. Returns the file's name; empty: chosen by the daemon.
  [[nodiscard]] tl::expected<std::string, Error> start_recording(const std::string& session_id,
                                                                 const std::string& file_name) const;
  /// Returns when the file is closed; also of a session that has ended.
  [[nodiscard]] tl::expected<RecordingInfo, Error> stop_recording(const std::string& session_id) const;
  /// `discard`: what was not yet rendered is dropped. Else the session ends once the stream's message `last_sequence` has
  /// come; 0: at once.
  [[nodiscard]] tl::expected<Statistics, Error> detach(const std::string& session_id, bool discard = false,
                                                       std::uint64_t last_sequence = 0) const;

  /// For the SDK's own classes.
  const std::shared_ptr<internal::Link>& link() const { return link_; }

 private:
  explicit Connection(std::shared_ptr<internal::Link> link);
  std::shared_ptr<internal::Link> link_;
};

}  // namespace rustle::client
