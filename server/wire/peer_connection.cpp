#include "server/wire/peer_connection.h"

#include <fcntl.h>
#include <sys/socket.h>
#include <unistd.h>

namespace rustle::wire {

PeerConnection connection_at(int descriptor) {
  PeerConnection connection{.descriptor = descriptor};
  socklen_t size = sizeof(connection.cookie);
  if (::getsockopt(descriptor, SOL_SOCKET, SO_COOKIE, &connection.cookie, &size) != 0) connection.cookie = 0;
  return connection;
}

bool is_open(const PeerConnection& connection) {
  return connection.cookie != 0 && connection_at(connection.descriptor) == connection;
}

void cut(const PeerConnection& connection) {
  // A descriptor of our own: ZeroMQ may close its one at any time, and the next connection may be given it.
  const int own = ::fcntl(connection.descriptor, F_DUPFD_CLOEXEC, 0);
  if (own < 0) return;
  if (connection.cookie != 0 && connection_at(own).cookie == connection.cookie) ::shutdown(own, SHUT_RDWR);
  ::close(own);
}

}  // namespace rustle::wire
