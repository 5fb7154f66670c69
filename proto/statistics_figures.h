#pragma once

#include "rustle/v1/session.pb.h"

namespace rustle::v1 {

/// Calls figure(name, &Plain::x, &Statistics::x, &Statistics::set_x) for every number of Statistics, in their order: what
/// reads, writes or prints them all goes by this list. `Plain` names its members as the message names its fields.
template <typename Plain, typename Figure>
void for_each_figure(Figure&& figure) {
#define RUSTLE_FIGURE(name) figure(#name, &Plain::name, &Statistics::name, &Statistics::set_##name)
  RUSTLE_FIGURE(messages_received);
  RUSTLE_FIGURE(frames_received);
  RUSTLE_FIGURE(frames_analysed);
  RUSTLE_FIGURE(messages_refused);
  RUSTLE_FIGURE(sequence_gaps);
  RUSTLE_FIGURE(samples_due);
  RUSTLE_FIGURE(samples_sent);
  RUSTLE_FIGURE(samples_in_gaps);
  RUSTLE_FIGURE(voices);
  RUSTLE_FIGURE(crumpling_events);
  RUSTLE_FIGURE(friction_episodes);
  RUSTLE_FIGURE(tear_events);
  RUSTLE_FIGURE(newest_time_s);
  RUSTLE_FIGURE(rendered_time_s);
  RUSTLE_FIGURE(playout_delay_s);
  RUSTLE_FIGURE(clock_drift_ppm);
  RUSTLE_FIGURE(load_level);
  RUSTLE_FIGURE(voices_most);
  RUSTLE_FIGURE(voices_stolen);
  RUSTLE_FIGURE(voices_dropped);
  RUSTLE_FIGURE(sources_dropped);
  RUSTLE_FIGURE(cues_dropped);
  RUSTLE_FIGURE(sounds_missing);
  RUSTLE_FIGURE(planes_left_out);
  RUSTLE_FIGURE(samples_limited);
  RUSTLE_FIGURE(samples_not_finite);
  RUSTLE_FIGURE(voices_merged);
  RUSTLE_FIGURE(emitter_samples_left_out);
  RUSTLE_FIGURE(frames_late);
  RUSTLE_FIGURE(time_jumps);
  RUSTLE_FIGURE(input_gaps);
  RUSTLE_FIGURE(samples_in_input_gaps);
  RUSTLE_FIGURE(pcm_gaps);
  RUSTLE_FIGURE(deadline_misses);
  RUSTLE_FIGURE(late_by_run_delay);
  RUSTLE_FIGURE(events_joined);
#undef RUSTLE_FIGURE
}

}  // namespace rustle::v1
