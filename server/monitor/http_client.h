#pragma once

#include <chrono>
#include <string>
#include <string_view>

#include <tl/expected.hpp>

#include "server/monitor/http_address.h"

namespace rustle::monitor {

struct HttpReply {
  int status = 0;
  std::string body;
};

struct HttpQuestion {
  std::string verb = "GET";
  std::string target{};  ///< "/figures"
  std::string json{};    ///< the body; empty: none
};

/// Asks whoever serves HTTP at `address`. Waits, `timeout` at most; any thread.
/// Error: what went wrong, such as "Connection refused".
[[nodiscard]] tl::expected<HttpReply, std::string> http_ask(const HttpAddress& address, const HttpQuestion& question,
                                                            std::chrono::milliseconds timeout);

/// Asks a daemon for a path such as "/figures". Waits; any thread.
/// Error: a sentence that names the address and what to do.
[[nodiscard]] tl::expected<HttpReply, std::string> http_get(const HttpAddress& address, std::string_view target,
                                                            std::chrono::milliseconds timeout);

/// A text as it may stand in a target's query.
[[nodiscard]] std::string in_query(std::string_view text);

}  // namespace rustle::monitor
