#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "server/apps/daemon.h"
#include "server/apps/settings.h"
#include "server/monitor/http_address.h"

namespace rustle::apps {

/// Everything rustled can be told.
struct Configuration {
  DaemonOptions daemon;
  std::string keys;  ///< folder of keys; empty: nobody is asked for one
  std::string log_level = "info";
  std::string log_format = "text";
  std::string http = "127.0.0.1:7393";  ///< or "off"
  std::vector<std::string> http_names;  ///< by which it is reached besides its address
  std::size_t viewers = 8;              ///< of the page at a time
  std::string device = "default";       ///< of playback: all or a part of a name, "default", or "none"
  std::string audio_api = "auto";
  double device_buffer_ms = 30;
  std::string sidecar = "auto";                    ///< of a fleet: an address, "auto" or "off"
  std::string analysis_affinity, render_affinity;  ///< processors, such as "0-2,5"; empty: all
};

/// Declares every setting of `configuration`, which must outlive the result.
Settings settings_of(Configuration& configuration);

/// The daemon's options, playback among them.
DaemonOptions daemon_options(const Configuration& configuration);

/// Where the sidecar of a fleet is; absent: there is none. "auto": at AGONES_SDK_HTTP_PORT, where that is set.
/// Error: a sentence that names the variable.
[[nodiscard]] tl::expected<std::optional<monitor::HttpAddress>, std::string> sidecar_address(
    const std::string& sidecar, const char* agones_sdk_http_port);

/// The file that is read when none is named: RUSTLED_CONFIG (empty: none), $XDG_CONFIG_HOME/rustle/rustled.toml (~/.config
/// without it), /etc/rustle/rustled.toml; the first that is there.
std::optional<std::filesystem::path> default_configuration_file();

}  // namespace rustle::apps
