#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <string_view>

namespace rustle::fleet {

/// What Agones knows of the daemon it runs: the GameServer of the sidecar's /gameserver.
struct GameServer {
  std::string name;
  std::string state;                           ///< "Scheduled", "Ready", "Allocated", "Shutdown" ...
  std::string address;                         ///< of the node; empty: not known yet
  std::map<std::string, std::uint16_t> ports;  ///< the node's, by name: "control", "stream", "out"

  bool operator==(const GameServer&) const = default;
};

/// As the sidecar tells it, in JSON. Absent: it is none. Ports without a name, or that are no ports, are left out. Pure.
[[nodiscard]] std::optional<GameServer> parse_game_server(std::string_view json);

/// Where a socket bound to `endpoint` is reached from outside its pod, through the node's port of this name. Bound to all
/// addresses it stays so: a client takes the host by which it reached the control endpoint. Absent: there is no such port,
/// or the endpoint is not of TCP. Pure.
[[nodiscard]] std::optional<std::string> advertised(const std::string& endpoint, const GameServer& server,
                                                    const std::string& port);

}  // namespace rustle::fleet
