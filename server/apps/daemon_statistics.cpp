#include "server/apps/daemon.h"
#include "server/monitor/process.h"

namespace rustle::apps {

wire::Statistics Daemon::statistics(const Guest& asked) const {
  const auto counters = asked.session->counters();
  const auto& options = asked.session->options();
  wire::Statistics out;
  out.session_id = asked.session->id();
  out.messages_received = asked.messages;
  out.frames_received = counters.frames_received;
  out.frames_analysed = counters.frames_analysed;
  out.frames_dropped = counters.frames_dropped;
  out.messages_refused = asked.refused;
  out.sequence_gaps = counters.sequence_gaps;
  out.samples_due = counters.samples_due;
  out.samples_sent = asked.pcm.samples_sent();
  out.samples_in_gaps = asked.pcm.samples_in_gaps();
  out.emitter_samples_left_out = counters.emitter_samples_left_out;
  out.voices = counters.render.voices;
  out.voices_most = counters.render.voices_most;
  out.voices_stolen = counters.render.voices_stolen;
  out.voices_dropped = counters.render.voices_dropped;
  out.sources_dropped = counters.render.sources_dropped;
  out.cues_dropped = counters.render.cues_dropped;
  out.samples_limited = counters.render.samples_limited;
  out.samples_not_finite = counters.render.samples_not_finite;
  out.voices_merged = counters.plan.voices_merged;
  out.sounds_missing = counters.plan.sounds_missing;
  out.planes_left_out = counters.plan.planes_left_out;
  out.crumpling_events = counters.crumpling_events;
  out.friction_episodes = counters.friction_episodes;
  out.tear_events = counters.tear_events;
  out.newest_time_s = counters.newest_time_s;
  out.rendered_time_s = asked.session->time_of(asked.session->samples_rendered());
  out.frames_late = counters.frames_late;
  out.time_jumps = counters.time_jumps;
  out.input_gaps = counters.input_gaps.gaps;
  out.samples_in_input_gaps = counters.input_gaps.samples;
  out.pcm_gaps = asked.pcm.gaps();
  out.deadline_misses = counters.deadline_misses;
  out.late_by_run_delay = counters.late_by_run_delay;
  out.events_joined = counters.events_joined;
  out.load_level = counters.load_level;
  out.playout_delay_s = counters.playout_delay_s;
  out.clock_drift_ppm = options.clock == session::Clock::kLive ? counters.clock_drift_ppm : asked.drift.ppm();
  return out;
}

wire::ServerStatistics Daemon::server_statistics() const {
  const auto seconds = [](Instant duration) { return std::chrono::duration<double>(duration).count(); };
  wire::ServerStatistics out;
  out.uptime_s = seconds(clock_->now() - began_);
  const auto process = monitor::process_figures();
  out.cpu_s = process.cpu_s;
  out.sessions = static_cast<std::uint32_t>(guests_.size());
  for (const auto& [name, threads] : process.threads)
    out.threads.push_back({name, threads.count, threads.running_s, threads.waiting_s});
  if (!playback_) return out;
  const auto played = playback_->figures();
  out.playback = {played.device,         played.rate_hz,      played.frames_played,       played.frames_missed,
                  played.devices_opened, played.devices_lost, played.mix.samples_in_gaps, played.mix.samples_left_out,
                  played.mix.splices};
  return out;
}

}  // namespace rustle::apps
