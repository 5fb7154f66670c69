#include <fmt/format.h>
#include <spdlog/sinks/stdout_color_sinks.h>
#include <spdlog/spdlog.h>

#include <CLI/CLI.hpp>
#include <atomic>
#include <csignal>
#include <exception>

#include "server/apps/command.h"
#include "server/apps/daemon.h"
#include "server/apps/wording.h"
#include "server/wire/endpoint.h"

namespace {

std::atomic<bool> g_stop{false};

int serve(rustle::apps::DaemonOptions options, const std::string& log_level) {
  using namespace rustle;
  spdlog::set_default_logger(spdlog::stderr_color_mt("rustled"));
  spdlog::set_level(spdlog::level::from_str(log_level));
  auto packs = std::make_shared<pack::PackLibrary>();
  for (const auto& broken : packs->broken()) spdlog::warn("sound pack left out: {}", broken.text());
  if (packs->entries().empty()) {
    std::string folders;
    for (const auto& folder : packs->search_folders()) folders += " " + folder.string();
    fmt::print(stderr,
               "rustled: no sound pack found; make one with `rustle pack generate`, or name its folder in RUSTLE_PACK_PATH. "
               "Looked in:{}\n",
               folders);
    return apps::kFailed;
  }
  const auto& wanted = options.sockets;
  for (const auto& [endpoint, flag] :
       {std::pair(wanted.control, "--control"), std::pair(wanted.stream, "--stream"), std::pair(wanted.out, "--out")}) {
    if (endpoint.empty()) continue;
    if (auto allowed = wire::check_bind_endpoint(endpoint, flag); !allowed) {
      fmt::print(stderr, "rustled: {}\n", allowed.error());
      return apps::kWrongUsage;
    }
  }
  for (const auto& endpoint : wanted.connect) {
    if (auto allowed = wire::check_connect_endpoint(endpoint, "--connect"); !allowed) {
      fmt::print(stderr, "rustled: {}\n", allowed.error());
      return apps::kWrongUsage;
    }
  }
  auto daemon = apps::Daemon::open(std::move(options), packs);
  if (!daemon) {
    fmt::print(stderr, "rustled: {}\n", daemon.error());
    return apps::kFailed;
  }
  const auto& sockets = (*daemon)->sockets();
  spdlog::info("control {}, stream {}, out {}", sockets.control_endpoint(), sockets.stream_endpoint(),
               sockets.out_endpoint());
  std::signal(SIGINT, [](int) { g_stop.store(true); });
  std::signal(SIGTERM, [](int) { g_stop.store(true); });
  (*daemon)->run(g_stop);
  spdlog::info("ended");
  return apps::kDone;
}

int print_devices(rustle::sinks::AudioApi api) {
  const auto devices = rustle::sinks::output_devices(api);
  for (const auto& device : devices) {
    fmt::print("{:<6} {}: {}, {} Hz{}\n", device.api, device.name, rustle::apps::counted(device.channels, "channel"),
               device.preferred_rate_hz, device.is_default ? ", default" : "");
  }
  if (!devices.empty()) return rustle::apps::kDone;
  fmt::print(stderr, "rustled: no audio device answers; start a sound server, or plug in a card\n");
  return rustle::apps::kFailed;
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app{"rustled listens to simulators and gives their deforming sheets sound.", "rustled"};
  app.set_version_flag("--version", "rustled " RUSTLE_VERSION);
  app.footer(
      "Example: rustled --connect tcp://127.0.0.1:5555\n"
      "Attach a simulator with an SDK or `rustle replay`, hear it with `rustle listen`. Ends on SIGTERM or Ctrl-C.");
  rustle::apps::DaemonOptions options;
  std::string log_level = "info";
  auto& sockets = options.sockets;
  app.add_option("--control", sockets.control, "Endpoint of requests, loopback tcp or ipc")->capture_default_str();
  app.add_option("--stream", sockets.stream, "Endpoint of frames, loopback tcp or ipc; \"\" for none")
      ->capture_default_str();
  app.add_option("--out", sockets.out, "Endpoint of sound, loopback tcp or ipc")->capture_default_str();
  app.add_option("--connect", sockets.connect, "Subscribe to a simulator that publishes there; may be repeated");
  app.add_option("--workers", options.analysis_workers, "Analysis threads")
      ->check(CLI::Range(1, 256))
      ->capture_default_str();
  app.add_option("--rate", options.rate_hz, "Sample rate of sessions that do not say")
      ->check(CLI::IsMember({44100, 48000, 96000}))
      ->capture_default_str();
  app.add_option("--block-size", options.block_size, "Samples in a block of sessions that do not say")
      ->check(CLI::Range(16, 8192))
      ->capture_default_str();
  app.add_option(
      "--hrtf", options.hrtfs,
      "Whose ears hear binaural sessions that do not say: structural, kemar or a SOFA file, which sessions may then "
      "name by its stem; may be repeated, the first is the default; kemar where installed");
  app.add_option("--max-sessions", options.max_sessions, "Sessions at a time")
      ->check(CLI::Range(1, 100000))
      ->capture_default_str();
  std::string device = "default";
  std::string audio_api = "auto";
  bool list_devices = false;
  double device_buffer_ms = 30;
  app.add_option("--device", device,
                 "Where live sessions are also played: all or a part of a device's name, \"default\" or \"none\"")
      ->capture_default_str();
  app.add_option("--audio-api", audio_api, "How devices are spoken to")
      ->check(CLI::IsMember({"auto", "pulse", "jack", "alsa"}))
      ->capture_default_str();
  app.add_option("--device-buffer-ms", device_buffer_ms, "Sound that waits for the device; more bridges longer stalls")
      ->check(CLI::Range(5.0, 500.0))
      ->capture_default_str();
  app.add_flag("--list-devices", list_devices, "Print the devices that --device may name, and end");
  app.add_option("--log-level", log_level, "What is logged on standard error")
      ->check(CLI::IsMember({"debug", "info", "warning", "error", "off"}))
      ->capture_default_str();
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? rustle::apps::kDone : rustle::apps::kWrongUsage;
  }
  try {
    const auto api = rustle::sinks::audio_api_of(audio_api).value();
    if (list_devices) return print_devices(api);
    if (device != "none") {
      options.playback.emplace();
      options.playback->device.api = api;
      options.playback->device.name = device == "default" ? "" : device;
      options.playback->device.rate_hz = options.rate_hz;
      options.playback->lead_s = device_buffer_ms / 1000;
      options.playback->device.ring_s = 2 * options.playback->lead_s + 0.1;
    }
    return serve(std::move(options), log_level);
  } catch (const std::exception& error) {
    fmt::print(stderr, "rustled: {}\n", error.what());
    return rustle::apps::kFailed;
  }
}
