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
  /// Errors: "invalid" (endpoint), "unreachable" (nobody answers), protocol_version.
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
  /// Returns all gains in force.
  [[nodiscard]] tl::expected<std::vector<Gain>, Error> set_gains(const std::string& session_id,
                                                                 const std::vector<Gain>& gains) const;
  [[nodiscard]] tl::expected<PackInfo, Error> change_pack(const std::string& session_id, std::uint32_t sheet_id,
                                                          const std::string& material,
                                                          const std::string& touched_surface) const;
  /// An empty name reloads all.
  [[nodiscard]] tl::expected<PackInfo, Error> reload_pack(const std::string& name) const;
  /// Returns the file's name; empty: chosen by the daemon.
  [[nodiscard]] tl::expected<std::string, Error> start_recording(const std::string& session_id,
                                                                 const std::string& file_name) const;
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
