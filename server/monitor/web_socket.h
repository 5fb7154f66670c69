#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <string_view>

namespace rustle::monitor {

struct WebSocketMessage {
  std::shared_ptr<const std::string> bytes;
  bool binary = false;  ///< else text, UTF-8
};

/// One end of a WebSocket: what the server does with it is all on the server's thread. It is asked for one message after the
/// other, as fast as the other end reads: what it does not want to send any more it need not have kept.
class WebSocketEnd {
 public:
  virtual ~WebSocketEnd() = default;

  /// The connection stands. `wake`: something may be there to send; from any thread, quick, harmless when it is gone.
  /// `close`: ends it with a reason of at most 120 bytes, from any thread.
  struct Line {
    std::function<void()> wake;
    std::function<void(std::string reason)> close;
  };
  virtual void opened(Line line) = 0;
  /// The next message; nothing: none, until `wake`.
  virtual std::optional<WebSocketMessage> next() = 0;
  /// A text, or what is none, which is binary.
  virtual void heard(std::string_view text, bool binary) = 0;
  /// It is over; nothing is called after. Also of a connection that never stood.
  virtual void left() = 0;
};

}  // namespace rustle::monitor
