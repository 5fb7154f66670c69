#include "server/apps/configuration.h"

#include <fmt/format.h>

#include <cstdlib>
#include <vector>

#include "server/monitor/http_address.h"
#include "server/monitor/served_host.h"
#include "server/wire/endpoint.h"

namespace rustle::apps {
namespace {

/// An endpoint to bind, or nothing where that is allowed.
Settings::Check bindable(std::string key, bool may_be_empty) {
  return [key = std::move(key), may_be_empty](const std::string& endpoint) -> std::string {
    if (may_be_empty && endpoint.empty()) return {};
    const auto allowed = wire::check_bind_endpoint(endpoint, key);
    return allowed ? std::string() : allowed.error();
  };
}

std::string connectable(const std::string& endpoint) {
  const auto allowed = wire::check_connect_endpoint(endpoint.substr(0, endpoint.find('#')), "network.connect");
  return allowed ? std::string() : allowed.error();
}

std::string http_address(const std::string& address) {
  if (address == "off") return {};
  const auto parsed = monitor::parse_http_address(address, "network.http");
  return parsed ? std::string() : parsed.error();
}

std::string sidecar(const std::string& address) {
  const auto parsed = sidecar_address(address, nullptr);
  return parsed ? std::string() : parsed.error();
}

std::string host_name(const std::string& name) {
  return monitor::is_host_name(name) ? std::string()
                                     : fmt::format(
                                           "network.http_names: \"{}\" is no name; write it without port, such as "
                                           "rustle.example.org",
                                           name);
}

/// A list of processors, or nothing.
Settings::Check processors(std::string key) {
  return [key = std::move(key)](const std::string& list) -> std::string {
    if (list.empty()) return {};
    const auto cpus = session::parse_cpus(list);
    return cpus ? std::string() : key + ": " + cpus.error();
  };
}

}  // namespace

Settings settings_of(Configuration& configuration) {
  Settings all("RUSTLED");
  auto& daemon = configuration.daemon;

  all.section("network", "Where simulators and listeners meet the daemon");
  all.text("network.control", "--control", daemon.sockets.control,
           "Endpoint of requests, tcp or ipc; beyond this machine only with keys", bindable("network.control", false));
  all.text("network.stream", "--stream", daemon.sockets.stream, "Endpoint of frames, tcp or ipc; \"\" for none",
           bindable("network.stream", true));
  all.text("network.out", "--out", daemon.sockets.out, "Endpoint of sound, tcp or ipc", bindable("network.out", false));
  all.texts("network.connect", "--connect", daemon.connect,
            "Subscribe to a simulator that publishes there, with keys ENDPOINT#NAME of its key; may be repeated",
            connectable);
  all.text(
      "network.keys", "--keys", configuration.keys,
      "Folder with server.key_secret and the keys that may connect, as `rustle keys` makes it; \"\" asks nobody for one");
  all.truth("network.insecure", "--insecure", daemon.sockets.insecure,
            "Without keys, let whoever reaches the endpoints use the daemon");

  all.text("network.http", "--http", configuration.http,
           "Where the page, metrics, health, figures and traces are served over HTTP; beyond this machine only with keys; "
           "\"off\" for nowhere",
           http_address);
  all.texts("network.http_names", "--http-name", configuration.http_names,
            "Name by which browsers reach that address, such as a proxy's; may be repeated. Other names are refused",
            host_name);
  all.integer("network.viewers", "--max-viewers", configuration.viewers, {1, 24},
              "Browsers that look at the page at a time");

  all.section("sessions", "How many sheets at a time, and what they are given when they do not say");
  all.integer("sessions.most", "--max-sessions", daemon.max_sessions, {1, 100000}, "Sessions at a time");
  all.reloadable();
  all.integer("sessions.analysis_workers", "--analysis-workers", daemon.analysis_workers, {1, 256},
              "Analysis threads, beside one for sessions whose frames take less than 4 ms");
  all.integer("sessions.render_workers", "--render-workers", daemon.render_workers, {1, 256},
              "Render threads, at real-time priority where the system grants it");
  all.text("sessions.analysis_affinity", "--analysis-affinity", configuration.analysis_affinity,
           "Processors that analysis threads run on, such as 0-2,5; \"\" for all", processors("sessions.analysis_affinity"));
  all.text("sessions.render_affinity", "--render-affinity", configuration.render_affinity,
           "Processors that render threads run on; \"\" for all", processors("sessions.render_affinity"));

  all.section("budget", "What a live session may use while others are there; of what is beyond, frames are dropped");
  all.real("budget.analysis", "--budget-analysis", daemon.budget.analysis_s_per_s, {0.001, 1000},
           "Seconds of an analysis thread's time in a second");
  all.real("budget.megabytes_per_s", "--budget-megabytes", daemon.budget.megabytes_per_s, {0.001, 1e6},
           "Megabytes of frames in a second");

  all.section("audio", "Sound of sessions that do not say otherwise, and the device that plays live ones");
  all.number_of("audio.rate", "--rate", daemon.rate_hz, {44100, 48000, 96000}, "Sample rate of sessions that do not say");
  all.integer("audio.block_size", "--block-size", daemon.block_size, {16, 8192},
              "Samples in a block of sessions that do not say");
  all.texts("audio.hrtf", "--hrtf", daemon.hrtfs,
            "Whose ears hear binaural sessions that do not say: structural, kemar or a SOFA file, which sessions may then "
            "name by its stem; may be repeated, the first is the default; kemar where installed");
  all.text("audio.device", "--device", configuration.device,
           "Where live sessions are also played: all or a part of a device's name, \"default\" or \"none\"");
  all.choice("audio.api", "--audio-api", configuration.audio_api, {"auto", "pulse", "jack", "alsa"},
             "How devices are spoken to");
  all.real("audio.device_buffer_ms", "--device-buffer-ms", configuration.device_buffer_ms, {5, 500},
           "Sound that waits for the device; more bridges longer stalls");

  all.section("recordings", "What sessions sent and what was decided, as captures that give the same sound again");
  all.text("recordings.folder", "--recordings", daemon.recordings,
           "Folder of recordings, made where it is not there; \"\" for none: sessions cannot be recorded");
  all.truth("recordings.all", "--record-all", daemon.record_all, "Record every session, whether it asks or not");

  all.section("fleet", "Of many daemons, looked after by Agones on Kubernetes");
  all.text("fleet.sidecar", "--sidecar", configuration.sidecar,
           "Address of the Agones sidecar, which is told that the daemon is ready, its health, how many sessions it has and "
           "its end; \"auto\": at AGONES_SDK_HTTP_PORT, where Agones sets it; \"off\" for none",
           sidecar);

  all.section("log", "What is told on standard error");
  all.choice("log.level", "--log-level", configuration.log_level, {"debug", "info", "warning", "error", "off"},
             "What is logged");
  all.reloadable();
  all.choice("log.format", "--log-format", configuration.log_format, {"text", "json"},
             "Lines for people, or one JSON object a line");
  return all;
}

tl::expected<std::optional<monitor::HttpAddress>, std::string> sidecar_address(const std::string& sidecar,
                                                                               const char* agones_sdk_http_port) {
  if (sidecar == "off") return std::nullopt;
  const bool automatic = sidecar == "auto";
  if (automatic && (agones_sdk_http_port == nullptr || *agones_sdk_http_port == '\0')) return std::nullopt;
  const std::string text = automatic ? fmt::format("127.0.0.1:{}", agones_sdk_http_port) : sidecar;
  const char* setting = automatic ? "AGONES_SDK_HTTP_PORT" : "fleet.sidecar";
  const auto address = monitor::parse_http_address(text, setting);
  if (!address || address->port == 0 || !address->is_local())
    return tl::unexpected(fmt::format(
        "{}: \"{}\" is no address of a sidecar on this machine; write 127.0.0.1:9358, \"auto\" or \"off\"", setting, text));
  return *address;
}

std::optional<std::filesystem::path> default_configuration_file() {
  if (const char* named = std::getenv("RUSTLED_CONFIG")) {
    return *named != '\0' ? std::optional<std::filesystem::path>(named) : std::nullopt;
  }
  std::vector<std::filesystem::path> places;
  if (const char* own = std::getenv("XDG_CONFIG_HOME"); own != nullptr && *own != '\0') {
    places.emplace_back(own);
  } else if (const char* home = std::getenv("HOME")) {
    places.emplace_back(std::filesystem::path(home) / ".config");
  }
  places.emplace_back("/etc");
  for (const auto& place : places) {
    std::error_code failed;
    if (auto file = place / "rustle" / "rustled.toml"; std::filesystem::exists(file, failed)) return file;
  }
  return std::nullopt;
}

}  // namespace rustle::apps
