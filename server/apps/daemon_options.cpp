#include "server/apps/configuration.h"

namespace rustle::apps {

DaemonOptions daemon_options(const Configuration& configuration) {
  DaemonOptions options = configuration.daemon;
  options.analysis_cpus = session::parse_cpus(configuration.analysis_affinity).value_or(std::vector<int>{});
  options.render_cpus = session::parse_cpus(configuration.render_affinity).value_or(std::vector<int>{});
  if (configuration.device == "none") return options;
  auto& playback = options.playback.emplace();
  playback.device.api = sinks::audio_api_of(configuration.audio_api).value();
  playback.device.name = configuration.device == "default" ? "" : configuration.device;
  playback.device.rate_hz = options.rate_hz;
  playback.lead_s = configuration.device_buffer_ms / 1000;
  playback.device.ring_s = 2 * playback.lead_s + 0.1;
  return options;
}

}  // namespace rustle::apps
