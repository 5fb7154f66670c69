#include "client_sdk/cpp/subscription.h"

#include <algorithm>
#include <iterator>
#include <utility>

namespace rustle::client::internal {
namespace {

constexpr std::chrono::milliseconds kLookEvery{50};

}  // namespace

Subscription::Subscription(std::shared_ptr<Link> link, std::unique_ptr<ConnectionMonitor> monitor, Socket socket,
                           std::string endpoint, bool reconnect)
    : link_(std::move(link)),
      monitor_(std::move(monitor)),
      socket_(std::move(socket)),
      endpoint_(std::move(endpoint)),
      reconnect_(reconnect) {}

tl::expected<std::shared_ptr<Subscription>, Error> Subscription::open(std::shared_ptr<Link> link, const std::string& topic,
                                                                      const Options& options) {
  const std::string endpoint = link->out_endpoint();
  if (endpoint.empty())
    return tl::unexpected(local_error("unreachable", "The daemon names no endpoint to listen at.", "Give Endpoints::out."));
  auto monitor = std::make_unique<ConnectionMonitor>();
  auto socket = Socket::connect(link->context(), Socket::Role::kListener, endpoint, {.send = 0, .receive = options.queue},
                                monitor.get());
  if (!socket) return tl::unexpected(std::move(socket.error()));
  const std::chrono::milliseconds timeout = link->timeout();
  auto made =
      std::make_shared<Subscription>(std::move(link), std::move(monitor), std::move(*socket), endpoint, options.reconnect);
  made->socket_.subscribe(topic);
  std::vector<std::vector<std::string>> early;
  if (auto granted = made->socket_.wait_subscribed(timeout, early); !granted) {
    Error& error = granted.error();
    if (error.code_name == "timeout")
      error.message = "The daemon did not confirm the subscription at " + endpoint + " in time.";
    return tl::unexpected(std::move(error));
  }
  made->early_.assign(std::make_move_iterator(early.begin()), std::make_move_iterator(early.end()));
  return made;
}

std::optional<std::string> Subscription::next(Clock::time_point deadline) {
  for (;;) {
    {
      const std::lock_guard lock(mutex_);
      std::vector<std::string> parts;
      if (!early_.empty()) {
        parts = std::move(early_.front());
        early_.pop_front();
      } else {
        parts = socket_.receive();
      }
      if (parts.size() == 2) return std::move(parts[1]);
      if (!parts.empty()) continue;
    }
    if (!check()) return std::nullopt;
    follow();
    const auto left = std::chrono::ceil<std::chrono::milliseconds>(deadline - Clock::now());
    if (left.count() <= 0) return std::nullopt;
    const std::lock_guard lock(mutex_);
    socket_.wait(std::min(left, kLookEvery));
  }
}

tl::expected<void, Error> Subscription::check() const {
  if (reconnect_) return {};
  return link_->check();
}

bool Subscription::is_heard() {
  const bool connected = monitor_->look().connected;
  // ZeroMQ subscribes again, at a daemon that came back, only when the socket is used.
  if (const std::unique_lock lock(mutex_, std::try_to_lock); lock.owns_lock()) socket_.attend();
  return connected;
}

void Subscription::follow() {
  const std::string now = link_->out_endpoint();
  if (now.empty() || now == endpoint_) return;
  const std::lock_guard lock(mutex_);
  socket_.follow(endpoint_, now);
  endpoint_ = now;
}

}  // namespace rustle::client::internal
