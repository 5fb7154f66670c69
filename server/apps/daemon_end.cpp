#include <spdlog/spdlog.h>

#include <algorithm>
#include <chrono>
#include <variant>

#include "server/apps/daemon.h"
#include "server/apps/wording.h"

namespace rustle::apps {

wire::Error Daemon::ending() {
  return {wire::ErrorCode::kOverloaded,
          "attach",
          "The daemon is ending.",
          "Attach to another one, or when it has been started again.",
          0,
          std::nullopt,
          {}};
}

void Daemon::tell_of_end(const std::string& id, Guest& told) {
  const wire::Notice notice{
      .level = wire::NoticeLevel::kInfo,
      .code = "ending",
      .field = {},
      .message = "The daemon is ending: what it was sent still sounds, what is sent from now on is lost.",
      .remedy = "Attach to another daemon, or to this one when it has been started again.",
      .sequence = 0,
      .count = 1};
  publish_notice(id, notice, ++told.out_sequence[wire::notices_topic(id)]);
}

void Daemon::drain(const std::function<void()>& between) {
  const auto busy = [](const auto& entry) { return !entry.second->finished || !entry.second->goodbyes.empty(); };
  draining_ = true;
  if (between) between();
  const auto sounding = static_cast<std::uint64_t>(std::count_if(guests_.begin(), guests_.end(), busy));
  if (sounding > 0) spdlog::info("ending: {} to finish", counted(sounding, "session"));
  for (auto& [id, guest] : guests_) {
    if (!guest->finished) tell_of_end(id, *guest);
    guest->session->end();
    scheduler_->wake_analysis(guest->session);
  }
  // The system's clock: a bound on real time, whatever the sessions go by.
  const auto until = std::chrono::steady_clock::now() + kDrain;
  std::vector<wire::Event> events;
  while (std::chrono::steady_clock::now() < until && std::any_of(guests_.begin(), guests_.end(), busy)) {
    if (between) between();
    events.clear();
    sockets_->poll(std::chrono::milliseconds(20), events);
    for (auto& event : events) {
      // The stream has ended: what comes now is as if nobody were there, so that senders look for the next daemon.
      if (auto* request = std::get_if<wire::ControlRequestReceived>(&event)) handle(*request);
      if (auto* change = std::get_if<wire::SubscriptionChanged>(&event)) handle(*change);
    }
    for (auto& [id, guest] : guests_) serve(id, *guest);
    serve_page();
  }
  for (auto& [id, guest] : guests_) {
    if (guest->finished) continue;
    spdlog::warn("session {} is cut off: it did not end within {} s", id, kDrain.count());
    guest->pcm.publish_end();
  }
}

}  // namespace rustle::apps
