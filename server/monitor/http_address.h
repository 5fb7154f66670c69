#pragma once

#include <cstdint>
#include <string>
#include <string_view>

#include <tl/expected.hpp>

namespace rustle::monitor {

struct HttpAddress {
  std::string host;        ///< "127.0.0.1" or "::1"
  std::uint16_t port = 0;  ///< 0: the system chooses

  std::string text() const;  ///< "127.0.0.1:7393", "[::1]:7393"
};

/// "127.0.0.1:7393", "localhost:7393", "[::1]:*" ("*": the system chooses). Only this machine is served, since nobody who
/// connects is asked for a key. `setting` such as "network.http" is named in the error. Pure.
[[nodiscard]] tl::expected<HttpAddress, std::string> parse_http_address(std::string_view text, std::string_view setting);

}  // namespace rustle::monitor
