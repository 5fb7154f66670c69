#pragma once

#include <functional>
#include <optional>
#include <string>
#include <string_view>

namespace rustle::wire {

/// Who may do what on the daemon's sockets. A user is the Z85 text of a public key, whose secret the other side has proved
/// to hold: CURVE checks that, the functions here say which keys are welcome.
struct Security {
  std::string public_key, secret_key;  ///< the daemon's, Z85
  /// Whether this key may connect at all; asked anew for every message. [any thread]
  std::function<bool(const std::string& user)> admits;
  /// Whether a subscription to this topic, which is a prefix of what is published, is granted. [network thread]
  std::function<bool(const std::string& user, std::string_view topic)> may_hear;
};

/// A publisher that the daemon connects to.
struct Publisher {
  std::string endpoint;
  std::string public_key;  ///< pinned, Z85: nobody else is heard there, and what it sends is this user's; empty: plain
};

/// The one domain of the daemon's sockets, as ZAP names it.
inline constexpr const char* kZapDomain = "rustle";

}  // namespace rustle::wire
