#include "server/monitor/figures.h"

namespace rustle::monitor {

StageCounts& StageCounts::operator+=(const StageCounts& other) {
  decode += other.decode;
  wait += other.wait;
  analysis += other.analysis;
  hand_over += other.hand_over;
  render += other.render;
  sound += other.sound;
  return *this;
}

StageCounts counts_of(const session::StageTimes& times) {
  return {times.decode.counts(),    times.wait.counts(),   times.analysis.counts(),
          times.hand_over.counts(), times.render.counts(), times.sound.counts()};
}

void Totals::add(const SessionFigures& session) {
  ++sessions;
  stages += session.stages;
  gaps.pcm_s += session.gaps().pcm_s;
  gaps.input_s += session.gaps().input_s;
  const wire::Statistics& from = session.statistics;
  for (const auto& [cause, frames] : from.frames_dropped) statistics.frames_dropped[cause] += frames;
  const auto sum = [&](std::uint64_t wire::Statistics::*count) { statistics.*count += from.*count; };
  sum(&wire::Statistics::messages_received);
  sum(&wire::Statistics::frames_received);
  sum(&wire::Statistics::frames_analysed);
  sum(&wire::Statistics::messages_refused);
  sum(&wire::Statistics::sequence_gaps);
  sum(&wire::Statistics::samples_due);
  sum(&wire::Statistics::samples_sent);
  sum(&wire::Statistics::samples_in_gaps);
  sum(&wire::Statistics::crumpling_events);
  sum(&wire::Statistics::friction_episodes);
  sum(&wire::Statistics::tear_events);
  sum(&wire::Statistics::voices_stolen);
  sum(&wire::Statistics::voices_dropped);
  sum(&wire::Statistics::sources_dropped);
  sum(&wire::Statistics::cues_dropped);
  sum(&wire::Statistics::sounds_missing);
  sum(&wire::Statistics::planes_left_out);
  sum(&wire::Statistics::samples_limited);
  sum(&wire::Statistics::samples_not_finite);
  sum(&wire::Statistics::voices_merged);
  sum(&wire::Statistics::frames_late);
  sum(&wire::Statistics::time_jumps);
  sum(&wire::Statistics::input_gaps);
  sum(&wire::Statistics::samples_in_input_gaps);
  sum(&wire::Statistics::deadline_misses);
  sum(&wire::Statistics::late_by_run_delay);
  sum(&wire::Statistics::events_joined);
  sum(&wire::Statistics::pcm_gaps);
  sum(&wire::Statistics::emitter_samples_left_out);
}

Totals DaemonFigures::totals() const {
  Totals all = departed;
  for (const SessionFigures& session : sessions) all.add(session);
  return all;
}

}  // namespace rustle::monitor
