#include "server/monitor/metrics.h"

#include <prometheus/metric_family.h>
#include <prometheus/text_serializer.h>

#include <algorithm>
#include <limits>
#include <utility>
#include <vector>

namespace rustle::monitor {
namespace {

using prometheus::ClientMetric;
using prometheus::MetricType;
using Labels = std::vector<ClientMetric::Label>;

class Families {
 public:
  void begin(const char* name, const char* help, MetricType type) { all_.push_back({name, help, type, {}}); }

  void value(double value, Labels labels = {}) {
    ClientMetric metric;
    metric.label = std::move(labels);
    if (all_.back().type == MetricType::Counter) {
      metric.counter.value = value;
    } else {
      metric.gauge.value = value;
    }
    all_.back().metric.push_back(std::move(metric));
  }
  void value(std::uint64_t count, Labels labels = {}) { value(static_cast<double>(count), std::move(labels)); }

  void counter(const char* name, const char* help, double sum) {
    begin(name, help, MetricType::Counter);
    value(sum);
  }
  void counter(const char* name, const char* help, std::uint64_t count) { counter(name, help, static_cast<double>(count)); }
  void gauge(const char* name, const char* help, double now) {
    begin(name, help, MetricType::Gauge);
    value(now);
  }

  void histogram(const session::DurationHistogram::Counts& counts, Labels labels = {}) {
    constexpr auto& kUpTo_s = session::DurationHistogram::kUpTo_s;
    ClientMetric metric;
    metric.label = std::move(labels);
    auto& out = metric.histogram;
    std::uint64_t sum = 0;
    for (std::size_t k = 0; k < counts.in_range.size(); ++k) {
      sum += counts.in_range[k];
      out.bucket.push_back({sum, k < kUpTo_s.size() ? kUpTo_s[k] : std::numeric_limits<double>::infinity()});
    }
    out.sample_count = sum;
    out.sample_sum = counts.sum_s;
    all_.back().metric.push_back(std::move(metric));
  }

  std::string text() const { return prometheus::TextSerializer().prometheus::Serializer::Serialize(all_); }

 private:
  std::vector<prometheus::MetricFamily> all_;
};

void add_process(Families& out, const DaemonFigures& daemon, const ProcessFigures& process) {
  out.begin("rustle_build_info", "1; the labels tell which rustled this is", MetricType::Gauge);
  out.value(1.0, {{"version", daemon.version}});
  out.gauge("rustle_up_seconds", "Since rustled was started", daemon.up_s);
  out.counter("process_cpu_seconds_total", "Processor time of all threads", process.cpu_s);
  out.gauge("process_resident_memory_bytes", "Memory in use", process.resident_bytes);
  out.gauge("process_open_fds", "Open file descriptors", static_cast<double>(process.open_files));
  out.begin("rustle_thread_cpu_seconds_total", "Processor time of the threads of one name", MetricType::Counter);
  for (const auto& [name, threads] : process.threads) out.value(threads.running_s, {{"thread", name}});
  out.begin("rustle_thread_run_delay_seconds_total", "Time that these threads could have run and waited for a processor",
            MetricType::Counter);
  for (const auto& [name, threads] : process.threads) out.value(threads.waiting_s, {{"thread", name}});
}

void add_sessions(Families& out, const DaemonFigures& daemon, const Totals& all) {
  const auto count = [&](bool live) {
    return static_cast<double>(std::count_if(daemon.sessions.begin(), daemon.sessions.end(),
                                             [&](const auto& session) { return session.live == live; }));
  };
  out.begin("rustle_sessions", "Sessions that are there", MetricType::Gauge);
  out.value(count(true), {{"clock", "live"}});
  out.value(count(false), {{"clock", "simulation"}});
  out.gauge("rustle_sessions_limit", "As many as there may be", static_cast<double>(daemon.sessions_most));
  out.counter("rustle_sessions_total", "Sessions that ever were", all.sessions);
  std::uint64_t waiting = 0, voices = 0;
  std::uint32_t level = 0;
  for (const auto& session : daemon.sessions) {
    waiting += session.frames_waiting;
    voices += session.statistics.voices;
    level = std::max(level, session.statistics.load_level);
  }
  out.gauge("rustle_frames_waiting", "Frames received and neither analysed nor dropped yet", static_cast<double>(waiting));
  out.gauge("rustle_voices", "Units and friction sources that sound now", static_cast<double>(voices));
  if (daemon.page) {
    out.gauge("rustle_page_viewers", "Browsers that look at the page", static_cast<double>(daemon.page->viewers));
    out.counter("rustle_page_viewers_refused_total", "Browsers turned away, as too many looked",
                daemon.page->viewers_refused);
    out.counter("rustle_page_frames_taken_total", "Frames that analysis handed over to be shown", daemon.page->frames_taken);
    out.counter("rustle_page_messages_lost_total", "Messages that browsers read too slowly for, of those that are gone",
                daemon.page->messages_lost);
  }
  out.gauge("rustle_load_level", "The highest load level in force in any session; 0 is full quality",
            static_cast<double>(level));
}

void add_input(Families& out, const DaemonFigures& daemon, const Totals& all) {
  const wire::Statistics& sums = all.statistics;
  out.counter("rustle_messages_received_total", "Stream messages", sums.messages_received);
  out.counter("rustle_messages_refused_total", "Stream messages answered with an error", sums.messages_refused);
  out.counter("rustle_messages_malformed_total", "Messages with too many or too few parts", daemon.malformed_messages);
  out.counter("rustle_replies_unsent_total", "Replies whose asker was gone or did not read", daemon.unsent_replies);
  out.counter("rustle_sequence_gaps_total", "Stream messages that did not come", sums.sequence_gaps);
  out.counter("rustle_frames_received_total", "Mesh frames: analysed, dropped and waiting ones", sums.frames_received);
  out.counter("rustle_frames_analysed_total", "Mesh frames analysed", sums.frames_analysed);
  out.begin("rustle_frames_dropped_total", "Mesh frames never analysed, by cause", MetricType::Counter);
  for (const auto& [cause, frames] : sums.frames_dropped) out.value(frames, {{"cause", cause}});
  out.counter("rustle_frames_late_total", "Frames of live sessions analysed after they were due", sums.frames_late);
  out.counter("rustle_time_jumps_total", "Times that simulation time was placed anew in live sessions", sums.time_jumps);
  out.counter("rustle_input_gaps_total", "Stretches of sound due before anything was heard of them", sums.input_gaps);
  out.counter("rustle_input_gap_seconds_total", "Sound in these stretches", all.gaps.input_s);
}

void add_sound(Families& out, const Totals& all) {
  const wire::Statistics& sums = all.statistics;
  out.begin("rustle_events_total", "What sounded", MetricType::Counter);
  out.value(sums.crumpling_events, {{"kind", "crumpling"}});
  out.value(sums.friction_episodes, {{"kind", "friction"}});
  out.value(sums.tear_events, {{"kind", "tearing"}});
  out.counter("rustle_voices_stolen_total", "Voices faded early to make room for a louder one", sums.voices_stolen);
  out.counter("rustle_voices_merged_total", "Voices of dense bursts, merged into one that sounds for them",
              sums.voices_merged);
  out.begin("rustle_sounds_dropped_total", "What was not begun or not heard, by what it was", MetricType::Counter);
  out.value(sums.voices_dropped, {{"what", "voice"}});
  out.value(sums.sources_dropped, {{"what", "friction source"}});
  out.value(sums.cues_dropped, {{"what", "cue"}});
  out.value(sums.sounds_missing, {{"what", "not in the pack"}});
  out.value(sums.planes_left_out, {{"what", "reflecting plane"}});
  out.counter("rustle_samples_due_total", "Samples that the sessions' clocks have called for", sums.samples_due);
  out.counter("rustle_samples_sent_total", "Samples rendered while somebody listened", sums.samples_sent);
  out.counter("rustle_samples_limited_total", "Samples turned down by the limiter", sums.samples_limited);
  out.counter("rustle_samples_not_finite_total", "Samples replaced by silence", sums.samples_not_finite);
  out.counter("rustle_emitter_samples_left_out_total", "Samples of emitters' dry sound that found no room",
              sums.emitter_samples_left_out);
  out.counter("rustle_pcm_gaps_total", "Stretches of PCM that the out socket did not take", sums.pcm_gaps);
  out.counter("rustle_pcm_gap_seconds_total", "Sound in these stretches", all.gaps.pcm_s);
  out.begin("rustle_deadlines_missed_total",
            "Blocks of live sessions rendered late by more than a PCM message: by the render thread's own processor time, "
            "or because "
            "it waited for a processor",
            MetricType::Counter);
  out.value(sums.deadline_misses, {{"cause", "cpu"}});
  out.value(sums.late_by_run_delay, {{"cause", "run_delay"}});
}

void add_stages(Families& out, const StageCounts& stages) {
  out.begin("rustle_stage_seconds",
            "Of frames: decode from receipt, wait for analysis, analysis, hand_over to rendering. render: each time that a "
            "session's sound was made",
            MetricType::Histogram);
  out.histogram(stages.decode, {{"stage", "decode"}});
  out.histogram(stages.wait, {{"stage", "wait"}});
  out.histogram(stages.analysis, {{"stage", "analysis"}});
  out.histogram(stages.hand_over, {{"stage", "hand_over"}});
  out.histogram(stages.render, {{"stage", "render"}});
  out.begin("rustle_frame_to_sound_seconds",
            "Of live sessions: a frame's receipt to its first sample sent, beyond the playout delay", MetricType::Histogram);
  out.histogram(stages.sound);
}

void add_playback(Families& out, const sinks::PlaybackFigures& played) {
  out.gauge("rustle_playback_device_open", "1 while a device plays, 0 while sound goes nowhere",
            played.device.empty() ? 0 : 1);
  out.counter("rustle_playback_devices_lost_total", "Devices that stopped answering", played.devices_lost);
  const auto seconds = [&](std::uint64_t samples) {
    return played.rate_hz > 0 ? static_cast<double>(samples) / played.rate_hz : 0.0;
  };
  out.counter("rustle_playback_seconds_total", "Sound handed to devices", seconds(played.frames_played));
  out.counter("rustle_playback_missed_seconds_total", "Silence played because sound came late",
              seconds(played.frames_missed));
  out.counter("rustle_playback_gap_seconds_total", "Silence where a session had no sound",
              seconds(played.mix.samples_in_gaps));
}

void add_fleet(Families& out, const FleetFigures& fleet) {
  out.gauge("rustle_fleet_sidecar_up", "1 while the sidecar answers", fleet.reachable ? 1 : 0);
  out.begin("rustle_fleet_state", "1; the labels tell what the fleet makes of this daemon", MetricType::Gauge);
  out.value(1.0, {{"game_server", fleet.game_server}, {"state", fleet.state}});
  out.begin("rustle_fleet_requests_total", "What the sidecar was asked, by what came of it", MetricType::Counter);
  for (const auto& [what, times] : fleet.asked) out.value(times, {{"request", what.first}, {"outcome", what.second}});
}

/// A figure of every session, by its id.
template <typename Figure>
void by_session(Families& out, const DaemonFigures& daemon, const char* name, const char* help, MetricType type,
                Figure&& figure) {
  out.begin(name, help, type);
  for (const auto& session : daemon.sessions)
    out.value(static_cast<double>(figure(session)), {{"session", session.statistics.session_id}});
}

void add_each_session(Families& out, const DaemonFigures& daemon) {
  const auto counter = [&](const char* name, const char* help, std::uint64_t wire::Statistics::*count) {
    by_session(out, daemon, name, help, MetricType::Counter, [&](const auto& session) { return session.statistics.*count; });
  };
  const auto gauge = [&](const char* name, const char* help, auto&& figure) {
    by_session(out, daemon, name, help, MetricType::Gauge, figure);
  };
  using S = wire::Statistics;
  counter("rustle_session_frames_received_total", "Mesh frames received", &S::frames_received);
  counter("rustle_session_frames_analysed_total", "Mesh frames analysed", &S::frames_analysed);
  out.begin("rustle_session_frames_dropped_total", "Mesh frames never analysed, by cause", MetricType::Counter);
  for (const auto& session : daemon.sessions) {
    for (const auto& [cause, frames] : session.statistics.frames_dropped)
      out.value(frames, {{"session", session.statistics.session_id}, {"cause", cause}});
  }
  gauge("rustle_session_frames_waiting", "Frames neither analysed nor dropped yet",
        [](const auto& session) { return session.frames_waiting; });
  counter("rustle_session_input_gaps_total", "Stretches of sound due before anything was heard of them", &S::input_gaps);
  counter("rustle_session_pcm_gaps_total", "Stretches of PCM that the out socket did not take", &S::pcm_gaps);
  out.begin("rustle_session_deadlines_missed_total", "Blocks rendered late by more than a PCM message, by cause",
            MetricType::Counter);
  for (const auto& session : daemon.sessions) {
    const std::string& id = session.statistics.session_id;
    out.value(session.statistics.deadline_misses, {{"session", id}, {"cause", "cpu"}});
    out.value(session.statistics.late_by_run_delay, {{"session", id}, {"cause", "run_delay"}});
  }
  gauge("rustle_session_voices", "Units and friction sources that sound now",
        [](const auto& session) { return session.statistics.voices; });
  gauge("rustle_session_playout_delay_seconds", "Playout delay in force",
        [](const auto& session) { return session.statistics.playout_delay_s; });
  gauge("rustle_session_clock_drift_ppm", "How much faster the sender's time runs than the daemon's",
        [](const auto& session) { return session.statistics.clock_drift_ppm; });
  gauge("rustle_session_load_level", "Load level in force; 0 is full quality",
        [](const auto& session) { return session.statistics.load_level; });
}

}  // namespace

std::string metrics_text(const DaemonFigures& daemon, const ProcessFigures& process) {
  const Totals all = daemon.totals();
  Families out;
  add_process(out, daemon, process);
  add_sessions(out, daemon, all);
  add_input(out, daemon, all);
  add_sound(out, all);
  add_stages(out, all.stages);
  if (daemon.playback) add_playback(out, *daemon.playback);
  if (daemon.fleet) add_fleet(out, *daemon.fleet);
  add_each_session(out, daemon);
  return out.text();
}

}  // namespace rustle::monitor
