#pragma once

#include <atomic>
#include <mutex>
#include <string>
#include <utility>

#include "server/monitor/web_socket.h"
#include "server/page/outbox.h"

namespace rustle::page {

/// A viewer's outbox with the line that empties it. Any thread.
class Outlet {
 public:
  Outbox box;
  std::atomic<int> asked{0};  ///< requests that are not answered yet

  /// Something was put into the box.
  void wake() const {
    const std::lock_guard lock(mutex_);
    if (line_.wake) line_.wake();
  }
  void close(const std::string& reason) const {
    const std::lock_guard lock(mutex_);
    if (line_.close) line_.close(reason);
  }
  void connect(monitor::WebSocketEnd::Line line) {
    const std::lock_guard lock(mutex_);
    line_ = std::move(line);
  }
  /// A text that is not lost; who lets hundreds of them wait is cut off.
  void say(std::string text) {
    if (box.add_text(std::move(text))) {
      wake();
    } else {
      close("asks without reading the answers");
    }
  }

 private:
  mutable std::mutex mutex_;
  monitor::WebSocketEnd::Line line_;
};

}  // namespace rustle::page
