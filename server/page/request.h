#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <string_view>
#include <variant>

#include <tl/expected.hpp>

#include "server/sheet/vector.h"
#include "server/synthesis/gain.h"

namespace rustle::page {

inline constexpr std::size_t kRequestBytes = 4096;  ///< a longer one ends the connection

/// What a viewer asks of the daemon.
struct WatchRequest {
  std::optional<std::string> session;  ///< absent: none
  int frames_per_second = 30;
};
struct ListenRequest {
  std::optional<std::string> session;  ///< absent: none
};
struct GainRequest {
  std::string session;
  synthesis::Gain gain;  ///< of the session, or of one kind of its sounds
};
struct ListenerRequest {
  std::string session;
  sheet::Vec3d position_m;
};
struct KeyRequest {
  std::string secret;  ///< Z85, 40 characters
};
using Request = std::variant<WatchRequest, ListenRequest, GainRequest, ListenerRequest, KeyRequest>;

/// Reads one JSON object. Error: a sentence that names the field and what it may be. Pure.
[[nodiscard]] tl::expected<Request, std::string> parse_request(std::string_view text);

}  // namespace rustle::page
