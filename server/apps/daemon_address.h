#pragma once

#include <string>

#include <tl/expected.hpp>

#include "client_sdk/cpp/connection.h"

namespace CLI {
class App;
}

namespace rustle::apps {

/// Which daemon a command speaks to, and by which keys.
struct DaemonAddress {
  std::string control = "tcp://127.0.0.1:7390";
  std::string keys;  ///< folder of NAME.key_secret and server.key; empty: of a daemon without keys
};

/// Adds --control and --keys (RUSTLE_KEYS). `address` must outlive the command.
void add_daemon_options(CLI::App& command, DaemonAddress& address);

/// Errors: those of read_keys() and Connection::connect().
[[nodiscard]] tl::expected<client::Connection, client::Error> connect_to(const DaemonAddress& address);

}  // namespace rustle::apps
