#include <algorithm>
#include <chrono>

#include "server/apps/daemon.h"
#include "server/page/page.h"

namespace rustle::apps {

monitor::SessionFigures Daemon::figures_of(const Guest& asked) const {
  const auto seconds = [](Instant time) { return std::chrono::duration<double>(time).count(); };
  const auto& options = asked.session->options();
  monitor::SessionFigures out;
  out.statistics = statistics(asked);
  out.name = asked.name;
  out.live = options.clock == session::Clock::kLive;
  out.ended = asked.finished;
  out.rate_hz = options.rate_hz;
  out.sheets = asked.decoder.sheet_count();
  std::uint64_t settled = out.statistics.frames_analysed;
  for (const auto& [cause, frames] : out.statistics.frames_dropped) settled += frames;
  out.frames_waiting = out.statistics.frames_received - settled;
  if (out.live && !asked.finished) {
    const auto behind = static_cast<std::int64_t>(out.statistics.samples_due) - asked.session->samples_rendered();
    out.behind_s = static_cast<double>(std::max<std::int64_t>(0, behind)) / options.rate_hz;
  }
  out.analysis_stalled_s = seconds(asked.session->analysis_stalled());
  out.stages = monitor::counts_of(asked.session->stage_times());
  return out;
}

monitor::DaemonFigures Daemon::figures() const {
  const auto counters = sockets_->counters();
  monitor::DaemonFigures out;
  out.version = RUSTLE_VERSION;
  out.up_s = std::chrono::duration<double>(clock_->now() - began_).count();
  out.draining = draining_;
  out.sessions_most = max_sessions_;
  out.malformed_messages = counters.malformed_messages;
  out.unsent_replies = counters.unsent_replies;
  for (const auto& [id, guest] : guests_) out.sessions.push_back(figures_of(*guest));
  out.departed = departed_;
  if (playback_) out.playback = playback_->figures();
  if (page_ != nullptr) out.page = page_->figures();
  return out;
}

std::optional<monitor::SessionTraces> Daemon::traces(const std::string& session_id) const {
  const auto found = guests_.find(session_id);
  if (found == guests_.end()) return std::nullopt;
  const auto& traced = *found->second->session;
  return monitor::SessionTraces{session_id, traced.options().clock == session::Clock::kLive, clock_->now().count(),
                                traced.traces().newest()};
}

void Daemon::see_off(Guest& leaving) {
  scheduler_->remove(leaving.session);
  if (page_ != nullptr) page_->session_left(leaving.session->id());
  if (playback_ && leaving.played) playback_->end(*leaving.played);
  leaving.session->discard();
  auto figures = figures_of(leaving);
  // What is still being analysed will not be heard.
  if (figures.frames_waiting > 0) figures.statistics.frames_dropped["discarded"] += figures.frames_waiting;
  departed_.add(figures);
}

void Daemon::note_left(Guest& sender, const session::AudioBlock& block) {
  const auto samples = static_cast<std::int64_t>(block.interleaved.size()) / block.channels;
  sender.session->sound_left(block.first_sample + samples - static_cast<std::int64_t>(sender.pcm.mix_samples_waiting()));
}

}  // namespace rustle::apps
