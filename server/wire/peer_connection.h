#pragma once

#include <compare>
#include <cstdint>

namespace rustle::wire {

/// Somebody's tcp or ipc connection. Descriptors are used again, the kernel's cookies (SO_COOKIE) are not: the two together
/// name one connection for ever.
struct PeerConnection {
  int descriptor = -1;
  std::uint64_t cookie = 0;

  auto operator<=>(const PeerConnection&) const = default;
};

/// The connection that this descriptor stands for now. Any thread.
PeerConnection connection_at(int descriptor);
/// Any thread.
bool is_open(const PeerConnection& connection);
/// Ends it, unless it has ended: from now on nothing that is sent leaves, and nothing more comes. Another connection that
/// has the descriptor by now is not touched. Any thread.
void cut(const PeerConnection& connection);

}  // namespace rustle::wire
