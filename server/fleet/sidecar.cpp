#include "server/fleet/sidecar.h"

#include <fmt/format.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <utility>

#include "server/monitor/http_client.h"
#include "server/session/worker_thread.h"

namespace rustle::fleet {
namespace {

/// As the sidecar's swagger files have them; whole numbers are texts there.
monitor::HttpQuestion question_of(Ask what, const DaemonState& state) {
  switch (what) {
    case Ask::kGameServer:
      return {.target = "/gameserver"};
    case Ask::kCounter: {
      // Never beyond the capacity, which it refuses: sessions stay when the daemon is told to take fewer.
      const std::size_t capacity = std::max(state.capacity, state.sessions);
      return {.verb = "PATCH",
              .target = "/v1beta1/counters/sessions",
              .json = fmt::format(R"({{"count":"{}","capacity":"{}"}})", state.sessions, capacity)};
    }
    default:
      return {.verb = "POST", .target = fmt::format("/{}", name_of(what)), .json = "{}"};
  }
}

}  // namespace

Sidecar::Sidecar(monitor::HttpAddress address) : address_(std::move(address)), thread_([this] { run(); }) {}

Sidecar::~Sidecar() {
  {
    const std::lock_guard lock(mutex_);
    leave_ = true;
  }
  changed_.notify_all();
  thread_.join();
}

void Sidecar::tell(std::size_t sessions, std::size_t capacity, bool ending) {
  {
    const std::lock_guard lock(mutex_);
    if (state_.serving && state_.sessions == sessions && state_.capacity == capacity && state_.ending == ending) return;
    state_.serving = true;
    state_.sessions = sessions;
    state_.capacity = capacity;
    state_.ending = ending;
  }
  changed_.notify_all();
}

void Sidecar::beat(Instant now, const std::function<bool()>& well) {
  if (looked_at_ && now - *looked_at_ < kLookEvery) return;
  looked_at_ = now;
  if (!well()) return;
  const std::lock_guard lock(mutex_);
  const bool was_well = state_.well_at && now - *state_.well_at <= Lifecycle::kWellFor;
  state_.well_at = now;
  if (!was_well) changed_.notify_all();
}

std::optional<GameServer> Sidecar::news() {
  const std::lock_guard lock(mutex_);
  if (!std::exchange(has_news_, false)) return std::nullopt;
  changed_.notify_all();
  return server_;
}

void Sidecar::end() {
  std::unique_lock lock(mutex_);
  state_.ending = state_.ended = true;
  changed_.notify_all();
  if (!changed_.wait_for(lock, kShutdownWithin, [&] { return shut_down_; }))
    spdlog::warn("fleet: the sidecar at {} does not take the shutdown; Agones finds out by the missing health",
                 address_.text());
}

monitor::FleetFigures Sidecar::figures() const {
  const std::lock_guard lock(mutex_);
  return figures_;
}

void Sidecar::run() {
  session::name_this_thread("rustle-fleet");
  Lifecycle lifecycle;
  std::unique_lock lock(mutex_);
  while (!leave_) {
    const auto step = lifecycle.next(state_, Clock::now());
    if (!step.ask) {
      changed_.wait_until(lock, step.again_at);
      continue;
    }
    const DaemonState state = state_;
    lock.unlock();
    ask(lifecycle, *step.ask, state);
    lock.lock();
    if (server_ != lifecycle.server()) {
      server_ = lifecycle.server();
      has_news_ = true;
      // Nobody is sent here before the daemon knows its ports.
      changed_.wait_for(lock, kNewsTakenWithin, [&] { return !has_news_ || leave_ || state_.ended; });
    }
    if (std::exchange(shut_down_, lifecycle.shut_down()) != shut_down_) changed_.notify_all();
    // One that ends asks again and again, but not without a breath.
    if (state_.ended && !shut_down_) changed_.wait_for(lock, Lifecycle::kFirstPause, [&] { return leave_; });
  }
}

void Sidecar::ask(Lifecycle& lifecycle, Ask what, const DaemonState& state) {
  const auto reply = monitor::http_ask(address_, question_of(what, state), kAnswerWithin);
  const Instant now = Clock::now();
  if (!reply) {
    if (!std::exchange(told_away_, true))
      spdlog::warn("fleet: no sidecar at {}: {}; it is looked for again and again", address_.text(), reply.error());
    lifecycle.unreachable(now);
    note(what, "unreachable", lifecycle);
    return;
  }
  if (std::exchange(told_away_, false)) spdlog::info("fleet: the sidecar at {} answers", address_.text());
  auto server = what == Ask::kGameServer && reply->status == 200 ? parse_game_server(reply->body) : std::nullopt;
  bool& told = told_refusal_[static_cast<std::size_t>(what)];
  if (reply->status / 100 != 2 || (what == Ask::kGameServer && !server)) {
    if (!std::exchange(told, true))
      spdlog::warn("fleet: the sidecar refuses {}: {} {}{}", name_of(what), reply->status, reply->body.substr(0, 200),
                   what == Ask::kCounter ? "; the fleet's manifest must name the counter: spec.counters.sessions" : "");
    lifecycle.refused(what, now);
    note(what, "refused", lifecycle);
    return;
  }
  told = false;
  if (server) {
    if (server->state != lifecycle.server().state)
      spdlog::info("fleet: {} is {}{}{}", server->name, server->state, server->address.empty() ? "" : " at ",
                   server->address);
    lifecycle.read(std::move(*server), now);
  } else {
    if (what != Ask::kHealth && what != Ask::kCounter) spdlog::info("fleet: {} told", name_of(what));
    lifecycle.done(what, state, now);
  }
  note(what, "done", lifecycle);
}

void Sidecar::note(Ask what, const char* outcome, const Lifecycle& lifecycle) {
  const std::lock_guard lock(mutex_);
  ++figures_.asked[{name_of(what), outcome}];
  figures_.reachable = lifecycle.reachable();
  figures_.game_server = lifecycle.server().name;
  figures_.state = lifecycle.server().state;
  figures_.address = lifecycle.server().address;
  figures_.ports = lifecycle.server().ports;
}

}  // namespace rustle::fleet
