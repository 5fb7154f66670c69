#include <fmt/format.h>
#include <spdlog/spdlog.h>
#include <sys/resource.h>

#include <atomic>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <new>
#include <optional>

#include "server/apps/command_lines.h"
#include "server/apps/configuration.h"
#include "server/apps/daemon.h"
#include "server/apps/daemon_page.h"
#include "server/apps/log.h"
#include "server/apps/wording.h"
#include "server/fleet/sidecar.h"
#include "server/monitor/health.h"
#include "server/monitor/monitor.h"
#include "server/monitor/served_host.h"
#include "server/monitor/service_manager.h"
#include "server/page/page.h"

namespace {

using rustle::apps::Configuration;
using rustle::apps::Settings;

std::atomic<bool> g_stop{false};
std::atomic<bool> g_reload{false};
std::atomic<bool> g_serving{false};

/// What nothing caught, in whatever thread, or before main(): a sentence and a status instead of an abort.
[[noreturn]] void end_with_a_sentence() {
  const char* what = "ended for no known reason";
  try {
    if (const auto thrown = std::current_exception()) std::rethrow_exception(thrown);
  } catch (const std::bad_alloc&) {
    what = "out of memory";
  } catch (const std::exception& error) {
    what = error.what();
  } catch (...) {
  }
  std::fprintf(stderr, "rustled: %s\n", what);
  std::_Exit(rustle::apps::kFailed);
}

/// In force before anything else of the program is initialized.
[[gnu::init_priority(101)]] const struct Ending {
  Ending() { std::set_terminate(end_with_a_sentence); }
} g_ending;

/// While packs and heads are still being read there is nothing to finish.
void end(int) {
  if (!g_serving.load()) std::_Exit(rustle::apps::kDone);
  g_stop.store(true);
}

/// As many descriptors as the system grants: every connection is one, and ZeroMQ ends the program where an ipc connection
/// finds none.
void raise_descriptor_limit() {
  struct rlimit limit {};
  if (::getrlimit(RLIMIT_NOFILE, &limit) != 0) return;
  limit.rlim_cur = limit.rlim_max;
  ::setrlimit(RLIMIT_NOFILE, &limit);
}

/// What was said on the command line, to be said again when the file is read anew.
struct Said {
  std::optional<std::filesystem::path> file;
  Settings::Given flags;
};

/// Prints every mistake. True: there was none.
bool accept(const std::vector<rustle::apps::SettingError>& errors) {
  for (const auto& error : errors) fmt::print(stderr, "rustled: {}\n", error.text());
  return errors.empty();
}

/// Has clients sent to the node's ports, where the fleet gives the daemon some.
void advertise(const rustle::fleet::GameServer& server, rustle::apps::Daemon& daemon) {
  using rustle::fleet::advertised;
  const auto& sockets = daemon.sockets();
  const auto control = advertised(sockets.control_endpoint(), server, "control");
  rustle::apps::Daemon::Advertised told{advertised(sockets.stream_endpoint(), server, "stream"),
                                        advertised(sockets.out_endpoint(), server, "out")};
  if (!control && !told.stream && !told.out) return;
  spdlog::info("fleet: reached at {}: control {}, stream {}, out {}", server.address,
               control.value_or(sockets.control_endpoint()), told.stream.value_or(sockets.stream_endpoint()),
               told.out.value_or(sockets.out_endpoint()));
  daemon.advertise(std::move(told));
}

/// Reads configuration and keys again; what may change while sessions sound does, the rest is named.
void reload(const Said& said, Configuration& in_force, rustle::apps::Daemon& daemon) {
  if (const auto keys = daemon.reload_keys(); !keys)
    spdlog::error("keys: {} All stay as they are.", keys.error());
  else if (!in_force.keys.empty())
    spdlog::info("keys {} read again", in_force.keys);
  Configuration next;
  Settings read = rustle::apps::settings_of(next);
  read.give(said.flags);
  if (const auto errors = read.read(said.file); !errors.empty()) {
    for (const auto& error : errors) spdlog::error("configuration: {}", error.text());
    spdlog::error("configuration: all stays as it is");
    return;
  }
  const auto changes = rustle::apps::settings_of(in_force).changes_to(read);
  for (const auto& key : changes.restart) spdlog::warn("configuration: {} takes effect when rustled starts again", key);
  for (const auto& key : changes.reloadable) spdlog::info("configuration: {} is taken over", key);
  if (changes.restart.empty() && changes.reloadable.empty()) spdlog::info("configuration: nothing has changed");
  spdlog::set_level(spdlog::level::from_str(next.log_level));
  daemon.limit_sessions(next.daemon.max_sessions);
  in_force.log_level = next.log_level;
  in_force.daemon.max_sessions = next.daemon.max_sessions;
}

int serve(Configuration configuration, const Said& said) {
  using namespace rustle;
  apps::log_to_stderr(configuration.log_level, configuration.log_format == "json");
  if (said.file) spdlog::info("configuration {}", said.file->string());
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
  std::signal(SIGINT, end);
  std::signal(SIGTERM, end);
  std::signal(SIGHUP, [](int) { g_reload.store(true); });
  raise_descriptor_limit();
  std::signal(SIGXFSZ, SIG_IGN);  // a recording that grows beyond a limit is an error of its write
  auto options = apps::daemon_options(configuration);
  if (!configuration.keys.empty()) {
    auto gate = access::Gate::open(configuration.keys);
    if (!gate) {
      fmt::print(stderr, "rustled: --keys: {}\n", gate.error());
      return apps::kFailed;
    }
    options.gate = std::move(*gate);
    spdlog::info("keys {}: who connects must prove one that is allowed there", configuration.keys);
  } else if (options.sockets.insecure) {
    spdlog::warn("--insecure: whoever reaches the endpoints may use this daemon");
  }
  std::optional<monitor::HttpAddress> http;
  if (configuration.http != "off") {
    http = monitor::parse_http_address(configuration.http, "network.http").value();
    if (const auto why = monitor::exposed(*http, options.gate != nullptr, options.sockets.insecure); !why.empty()) {
      fmt::print(stderr, "rustled: {}\n", why);
      return apps::kFailed;
    }
  }
  const std::uint32_t rate_hz = options.rate_hz;
  auto daemon = apps::Daemon::open(std::move(options), packs);
  if (!daemon) {
    fmt::print(stderr, "rustled: {}\n", daemon.error());
    return apps::kFailed;
  }
  const auto& sockets = (*daemon)->sockets();
  spdlog::info("control {}, stream {}, out {}", sockets.control_endpoint(), sockets.stream_endpoint(),
               sockets.out_endpoint());
  apps::DaemonPage host(**daemon);
  std::unique_ptr<page::Page> page;
  std::unique_ptr<monitor::Monitor> monitor;
  if (http) {
    const auto wake = [&] { (*daemon)->wake(); };
    page = std::make_unique<page::Page>(page::Page::Options{.folder = page::page_folder(),
                                                            .daemon = "rustled " RUSTLE_VERSION,
                                                            .rate_hz = rate_hz,
                                                            .channels = 2,
                                                            .viewers = configuration.viewers},
                                        wake);
    monitor::HttpServer::Paths paths;
    page->add_to(paths);
    monitor::HttpServer::Options limits;
    limits.serves = [names = configuration.http_names](std::string_view name, const monitor::HttpAddress& own) {
      return monitor::is_served(name, own, names);
    };
    auto opened = monitor::Monitor::open(*http, wake, std::move(paths), limits);
    if (!opened) {
      fmt::print(stderr, "rustled: {}\n", opened.error());
      return apps::kFailed;
    }
    monitor = std::move(*opened);
    (*daemon)->show_on(*page, host);
    spdlog::info("http {}: the page, /metrics, /healthz, /figures, /trace", monitor->address().text());
  }
  const auto sidecar_at = apps::sidecar_address(configuration.sidecar, std::getenv("AGONES_SDK_HTTP_PORT"));
  if (!sidecar_at) {
    fmt::print(stderr, "rustled: {}\n", sidecar_at.error());
    return apps::kFailed;
  }
  std::optional<fleet::Sidecar> sidecar;
  if (*sidecar_at) {
    sidecar.emplace(**sidecar_at);
    spdlog::info("fleet: the sidecar at {} is told of this daemon", (*sidecar_at)->text());
  }
  const auto figures = [&] {
    auto told = (*daemon)->figures();
    if (sidecar) told.fleet = sidecar->figures();
    return told;
  };
  const auto well = [&] {
    const auto told = (*daemon)->figures();
    return monitor::problems_of(&told).empty();
  };
  const monitor::Monitor::Source source{figures, [&](const std::string& session) { return (*daemon)->traces(session); }};
  g_serving.store(true);
  auto manager = monitor::ServiceManager::from_environment();
  manager.serves(fmt::format("serves {}", sockets.control_endpoint()));
  (*daemon)->run(g_stop, [&] {
    if (monitor) monitor->answer(source);
    if (g_reload.exchange(false)) reload(said, configuration, **daemon);
    if (g_stop.load()) manager.ends();
    manager.beat(monitor::ServiceManager::Clock::now(), well);
    if (!sidecar) return;
    sidecar->tell((*daemon)->sessions(), (*daemon)->most_sessions(), g_stop.load());
    sidecar->beat(fleet::Clock::now(), well);
    if (const auto news = sidecar->news()) advertise(*news, **daemon);
  });
  if (sidecar) sidecar->end();
  spdlog::info("ended");
  return apps::kDone;
}

int print_devices(const std::string& audio_api) {
  const auto devices = rustle::sinks::output_devices(rustle::sinks::audio_api_of(audio_api).value());
  for (const auto& device : devices) {
    fmt::print("{:<6} {}: {}, {} Hz{}\n", device.api, device.name, rustle::apps::counted(device.channels, "channel"),
               device.preferred_rate_hz, device.is_default ? ", default" : "");
  }
  if (!devices.empty()) return rustle::apps::kDone;
  fmt::print(stderr, "rustled: no audio device answers; start a sound server, or plug in a card\n");
  return rustle::apps::kFailed;
}

int run(int argc, char** argv) {
  Configuration configuration;
  Settings settings = rustle::apps::settings_of(configuration);
  Said said;
  rustle::apps::DaemonRequest request;
  const auto app = rustle::apps::rustled_command_line(request, settings);
  try {
    app->parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app->exit(error) == 0 ? rustle::apps::kDone : rustle::apps::kWrongUsage;
  }
  if (request.file.empty()) {
    said.file = rustle::apps::default_configuration_file();
  } else if (request.file != "none") {
    said.file = request.file;
  }
  said.flags = settings.given();
  if (!accept(settings.read(said.file))) return rustle::apps::kWrongUsage;
  if (request.print_configuration) {
    fmt::print("{}", settings.print());
    return rustle::apps::kDone;
  }
  if (request.list_devices) return print_devices(configuration.audio_api);
  return serve(configuration, said);
}

}  // namespace

int main(int argc, char** argv) {
  try {
    return run(argc, argv);
  } catch (const std::exception& error) {
    fmt::print(stderr, "rustled: {}\n", error.what());
    return rustle::apps::kFailed;
  }
}
