#pragma once

#include <cstdint>
#include <string>
#include <string_view>

#include <tl/expected.hpp>

namespace rustle::monitor {

struct HttpAddress {
  std::string host;        ///< "127.0.0.1" or "::1", never a name
  std::uint16_t port = 0;  ///< 0: the system chooses

  std::string text() const;  ///< "127.0.0.1:7393", "[::1]:7393"
  /// Only this machine reaches it.
  bool is_local() const;
};

/// "127.0.0.1:7393", "localhost:7393", "[::1]:*" ("*": the system chooses), "0.0.0.0:7393". `setting` such as "network.http"
/// is named in the error. Pure.
[[nodiscard]] tl::expected<HttpAddress, std::string> parse_http_address(std::string_view text, std::string_view setting);

/// Why this may not be served to whoever reaches it; empty: it may. `keys`: they are in force; `insecure`: the operator
/// wants it. Pure.
[[nodiscard]] std::string exposed(const HttpAddress& address, bool keys, bool insecure);

}  // namespace rustle::monitor
