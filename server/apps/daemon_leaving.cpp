#include <fmt/format.h>

#include <algorithm>
#include <utility>

#include "server/apps/daemon.h"
#include "server/apps/wording.h"

/// How sessions leave a daemon: by a detach, at their stream's end, or for want of news.
namespace rustle::apps {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;

constexpr milliseconds kDetachWait{2000};
constexpr seconds kFinishedKept{30};
constexpr seconds kIdleKept{300};
constexpr seconds kGoneKept{10};  // a live session whose client has gone without a word, and did not come back

}  // namespace

void Daemon::say_goodbye(Guest& leaving) {
  const auto now = clock_->now();
  std::erase_if(leaving.goodbyes, [&](const Goodbye& goodbye) {
    const bool waited = now - goodbye.since >= kDetachWait;
    if (!leaving.detached) {
      if (!goodbye.discard && leaving.last_sequence < goodbye.last_sequence && !waited) return false;
      if (goodbye.discard) {
        end_at_once(leaving);
      } else {
        leaving.session->end();
        scheduler_->wake_analysis(leaving.session);
        leaving.detached = true;
      }
    }
    const bool accounted = !leaving.session->waiting() && leaving.finished;
    if (!accounted && !waited) return false;
    sockets_->send_control(goodbye.peer, wire::encode_reply(goodbye.request_id, wire::Detached{statistics(leaving)}));
    return true;
  });
}

void Daemon::end_at_once(Guest& ended) {
  ended.session->discard();
  ended.session->end();
  scheduler_->wake_analysis(ended.session);
  ended.detached = true;
  if (std::exchange(ended.finished, true)) return;
  ended.pcm.publish_end();
}

void Daemon::let_go() {
  const auto now = clock_->now();
  if (const auto lost = strangers_.forget_before(now - kIdleKept); lost > 0) {
    complain("publisher",
             {wire::ErrorCode::kUnknownSession,
              "stream",
              fmt::format("{} of publishers that never described a sheet are forgotten.", counted(lost, "message")),
              "Announce the session, or describe its sheets, every second.",
              0,
              std::nullopt,
              {}});
  }
  for (auto entry = guests_.begin(); entry != guests_.end();) {
    Guest& kept = *entry->second;
    const bool live = kept.session->options().clock == session::Clock::kLive;
    const bool gone = live && kept.client_left && now - std::max(*kept.client_left, kept.last_heard) > kGoneKept;
    const auto limit = gone ? kGoneKept : kIdleKept;
    if (!kept.finished && !kept.detached && now - kept.last_heard > limit) end_idle(kept, limit);
    if (kept.finished && kept.goodbyes.empty() && (kept.detached || now - kept.finished_at > kFinishedKept) &&
        recording_is_over(kept)) {
      see_off(kept);
      entry = guests_.erase(entry);
    } else {
      ++entry;
    }
  }
}

void Daemon::end_idle(Guest& idle, std::chrono::seconds after) {
  notify(idle, {wire::ErrorCode::kIdle,
                "stream",
                fmt::format("The session \"{}\" has ended: nothing came for {} s.", idle.session->id(), after.count()),
                "Attach again; while a simulation pauses, send a frame or an advance now and then.",
                0,
                std::nullopt,
                {}});
  idle.session->end();
  scheduler_->wake_analysis(idle.session);
  idle.detached = true;
}

}  // namespace rustle::apps
