#include "server/apps/daemon_address.h"

#include <CLI/CLI.hpp>
#include <utility>

#include "client_sdk/cpp/certificate.h"

namespace rustle::apps {

void add_daemon_options(CLI::App& command, DaemonAddress& address) {
  command.add_option("--control", address.control, "The daemon's control endpoint")->capture_default_str();
  command
      .add_option("--keys", address.keys,
                  "Folder with your NAME.key_secret and the daemon's server.key, for a daemon that asks for keys")
      ->envname("RUSTLE_KEYS");
}

tl::expected<client::Connection, client::Error> connect_to(const DaemonAddress& address) {
  client::Endpoints endpoints{.control = address.control};
  if (!address.keys.empty()) {
    auto keys = client::read_keys(address.keys);
    if (!keys) return tl::unexpected(std::move(keys.error()));
    endpoints.keys = std::move(*keys);
  }
  return client::Connection::connect(endpoints);
}

}  // namespace rustle::apps
