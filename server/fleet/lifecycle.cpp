#include "server/fleet/lifecycle.h"

#include <algorithm>
#include <utility>

namespace rustle::fleet {
namespace {

constexpr std::size_t index_of(Ask ask) {
  return static_cast<std::size_t>(ask);
}

/// Agones has not been told yet that it is ready.
bool before_ready(const std::string& state) {
  return state == "PortAllocation" || state == "Creating" || state == "Starting" || state == "Scheduled";
}

/// Agones is done with it; nothing that it is told changes that.
bool given_up(const std::string& state) {
  return state == "Shutdown" || state == "Unhealthy" || state == "Error";
}

}  // namespace

const char* name_of(Ask ask) {
  switch (ask) {
    case Ask::kGameServer:
      return "gameserver";
    case Ask::kCounter:
      return "counter";
    case Ask::kReady:
      return "ready";
    case Ask::kAllocate:
      return "allocate";
    case Ask::kHealth:
      return "health";
    case Ask::kShutdown:
      break;
  }
  return "shutdown";
}

std::optional<Ask> Lifecycle::wanted_state(const DaemonState& daemon, Instant now) const {
  if (!looked_ || daemon.ending || given_up(server_.state)) return std::nullopt;
  if (!ready_told_) return Ask::kReady;
  if (daemon.sessions > 0 && server_.state != "Allocated") return Ask::kAllocate;
  if (empty_since_ && now - *empty_since_ >= kEmptyFor) return Ask::kReady;
  return std::nullopt;
}

std::optional<Instant> Lifecycle::due(Ask ask, const DaemonState& daemon, Instant now) const {
  switch (ask) {
    case Ask::kShutdown:
      return daemon.ended && !shut_down_ ? std::optional(now) : std::nullopt;
    case Ask::kHealth:
      if (daemon.ended || !daemon.well_at || now - *daemon.well_at > kWellFor) return std::nullopt;
      return health_at_;
    case Ask::kGameServer:
      return daemon.ended ? std::nullopt : std::optional(look_at_);
    case Ask::kCounter:
      if (daemon.ended || !looked_) return std::nullopt;
      return counted_ == Counted{daemon.sessions, daemon.capacity} ? count_at_ : now;
    case Ask::kReady:
    case Ask::kAllocate:
      break;
  }
  if (daemon.ended) return std::nullopt;
  if (wanted_state(daemon, now) == ask) return now;
  if (ask == Ask::kReady && empty_since_ && !daemon.ending) return *empty_since_ + kEmptyFor;
  return std::nullopt;
}

Lifecycle::Step Lifecycle::next(const DaemonState& daemon, Instant now) {
  const bool empty = daemon.sessions == 0 && server_.state == "Allocated";
  empty_since_ = empty ? empty_since_.value_or(now) : std::optional<Instant>();
  if (!daemon.serving) return {std::nullopt, now + kTellAgain};
  // One that ends has no time to wait until a sidecar may be back.
  if (now < retry_at_ && !daemon.ended) return {std::nullopt, retry_at_};
  Step step{std::nullopt, now + kTellAgain};
  for (const Ask ask : {Ask::kShutdown, Ask::kHealth, Ask::kGameServer, Ask::kCounter, Ask::kReady, Ask::kAllocate}) {
    const auto when = due(ask, daemon, now);
    if (!when) continue;
    const Instant at = std::max(*when, not_before_[index_of(ask)]);
    if (at <= now) return {ask, now};
    step.again_at = std::min(step.again_at, at);
  }
  return step;
}

void Lifecycle::done(Ask ask, const DaemonState& told, Instant now) {
  reachable_ = true;
  pause_ = {};
  switch (ask) {
    case Ask::kGameServer:
      break;
    case Ask::kCounter:
      counted_ = Counted{told.sessions, told.capacity};
      count_at_ = now + kTellAgain;
      break;
    case Ask::kReady:
      // Agones takes a while to show it.
      ready_told_ = true;
      server_.state = "Ready";
      empty_since_.reset();
      break;
    case Ask::kAllocate:
      server_.state = "Allocated";
      break;
    case Ask::kHealth:
      health_at_ = now + kHealthEvery;
      break;
    case Ask::kShutdown:
      shut_down_ = true;
      break;
  }
}

void Lifecycle::read(GameServer server, Instant now) {
  reachable_ = looked_ = true;
  pause_ = {};
  server_ = std::move(server);
  look_at_ = now + (server_.ports.empty() ? kPortsAwaited : kTellAgain);
  // A sidecar that fell before it had passed it on.
  if (before_ready(server_.state)) ready_told_ = false;
}

void Lifecycle::refused(Ask ask, Instant now) {
  reachable_ = true;
  pause_ = {};
  not_before_[index_of(ask)] = now + kAfterRefusal;
  if (ask == Ask::kGameServer) looked_ = true;
}

void Lifecycle::unreachable(Instant now) {
  reachable_ = looked_ = false;
  pause_ = std::clamp(2 * pause_, kFirstPause, kLongestPause);
  retry_at_ = now + pause_;
  look_at_ = health_at_ = now;
  counted_.reset();
}

}  // namespace rustle::fleet
