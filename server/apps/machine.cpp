#include "server/apps/machine.h"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <netinet/in.h>
#include <pthread.h>
#include <sched.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <charconv>
#include <chrono>
#include <cstdlib>
#include <cstring>
#include <map>
#include <optional>
#include <thread>
#include <utility>

#include "server/apps/configuration.h"
#include "server/apps/wording.h"
#include "server/fleet/game_server.h"
#include "server/monitor/http_address.h"
#include "server/monitor/http_client.h"
#include "server/sinks/audio_device.h"
#include "server/spatial/hrtf_choice.h"
#include "server/wire/endpoint.h"
#include "sound_db/pack/library.h"

namespace rustle::apps {
namespace {

constexpr std::size_t kLockedBytes = std::size_t{64} << 20;  // rings, voices and packs of some twenty sessions
constexpr std::size_t kDescriptorsAtRest = 64;
constexpr std::size_t kDescriptorsPerSession = 4;  // its simulator's three connections and a listener

/// The configuration as rustled would read it, mistakes left out.
Configuration configured() {
  Configuration configuration;
  Settings settings = settings_of(configuration);
  static_cast<void>(settings.read(default_configuration_file()));
  return configuration;
}

/// Why a port of this machine cannot be bound, by errno; 0: it can.
int bind_error(std::uint16_t port) {
  const int probe = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
  if (probe < 0) return errno;
  const int reuse = 1;
  ::setsockopt(probe, SOL_SOCKET, SO_REUSEADDR, &reuse, sizeof reuse);
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(port);
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  const int failed = ::bind(probe, reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0 ? 0 : errno;
  ::close(probe);
  return failed;
}

std::string mebibytes(rlim_t bytes) {
  return bytes == RLIM_INFINITY ? "no limit" : fmt::format("{} MiB", bytes >> 20);
}

}  // namespace

std::string to_string(Grade grade) {
  switch (grade) {
    case Grade::kGranted:
      return "granted";
    case Grade::kLimited:
      return "limited";
    case Grade::kMissing:
      break;
  }
  return "missing";
}

MachineCheck check_configuration() {
  const auto file = default_configuration_file();
  Configuration configuration;
  Settings settings = settings_of(configuration);
  const auto errors = settings.read(file);
  const std::string name = file ? file->string() : "no file; defaults";
  if (errors.empty()) return {"configuration", Grade::kGranted, name, ""};
  return {"configuration", Grade::kMissing, fmt::format("{}: {}", name, counted(errors.size(), "mistake")),
          fmt::format("{}", errors.front().text())};
}

MachineCheck check_packs() {
  const pack::PackLibrary packs;
  std::vector<std::string> folders;
  for (const auto& folder : packs.search_folders()) folders.push_back(folder.string());
  if (packs.entries().empty()) {
    return {"sound packs", Grade::kMissing, fmt::format("none in {}", fmt::join(folders, ", ")),
            "make one with `rustle pack generate`, or name its folder in RUSTLE_PACK_PATH"};
  }
  const std::string found = fmt::format("{}", fmt::join(packs.materials(), ", "));
  const auto broken = packs.broken();
  if (broken.empty()) return {"sound packs", Grade::kGranted, found, ""};
  return {"sound packs", Grade::kLimited, fmt::format("{}; {} cannot be read", found, counted(broken.size(), "pack")),
          broken.front().text()};
}

MachineCheck check_ports() {
  const Configuration configuration = configured();
  const auto& sockets = configuration.daemon.sockets;
  std::vector<std::string> named, taken;
  for (const auto& endpoint : {sockets.control, sockets.stream, sockets.out}) {
    if (endpoint.empty()) continue;
    named.push_back(endpoint);
    std::uint16_t port = 0;
    if (endpoint.starts_with("ipc://")) {
      if (wire::ipc_in_use(endpoint)) taken.push_back(endpoint);
      continue;
    }
    const auto digits = wire::port_of(endpoint);
    std::from_chars(digits.data(), digits.data() + digits.size(), port);
    if (port == 0) continue;
    if (const int failed = bind_error(port); failed != 0)
      taken.push_back(fmt::format("{}: {}", endpoint, std::strerror(failed)));
  }
  if (const auto http = monitor::parse_http_address(configuration.http, "network.http"); http && http->port != 0) {
    named.push_back("http " + http->text());
    if (const int failed = bind_error(http->port); failed != 0)
      taken.push_back(fmt::format("http {}: {}", http->text(), std::strerror(failed)));
  }
  if (taken.empty()) return {"endpoints", Grade::kGranted, fmt::format("{} are free", fmt::join(named, ", ")), ""};
  return {"endpoints", Grade::kMissing, fmt::format("{}", fmt::join(taken, "; ")),
          "if it is no rustled that runs already, choose others with --control, --stream, --out and --http"};
}

MachineCheck check_audio() {
  const auto devices = sinks::output_devices(sinks::AudioApi::kAny);
  if (devices.empty()) {
    return {"audio devices", Grade::kLimited, "no device or sound server answers",
            "start a sound server or plug in a card to hear live sessions here; PCM is streamed without"};
  }
  std::vector<std::string> names;
  for (const auto& device : devices)
    names.push_back(fmt::format("{}: {}{}", device.api, device.name, device.is_default ? " (default)" : ""));
  return {"audio devices", Grade::kGranted, fmt::format("{}", fmt::join(names, ", ")), ""};
}

MachineCheck check_heads() {
  if (const auto kemar = spatial::kemar_file(); !kemar.empty())
    return {"measured head", Grade::kGranted, fmt::format("kemar, {}", kemar), ""};
  return {"measured head", Grade::kLimited, "none: binaural sound uses the structural head",
          "install libmysofa1, which brings KEMAR, or name a SOFA file with --hrtf"};
}

MachineCheck check_processor() {
  cpu_set_t allowed;
  CPU_ZERO(&allowed);
  const int cores = sched_getaffinity(0, sizeof allowed, &allowed) == 0 ? CPU_COUNT(&allowed) : 1;
  std::string lanes = "SSE2";
  __builtin_cpu_init();
  if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma")) lanes = "AVX2, FMA";
  if (__builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512vl")) lanes = "AVX-512";
  MachineCheck check{"processor", Grade::kGranted,
                     fmt::format("{}, {}", counted(static_cast<std::uint64_t>(cores), "core"), lanes), ""};
  if (lanes == "SSE2") {
    check.grade = Grade::kLimited;
    check.remedy = "analysis and synthesis take two to four times as long as with AVX2: expect fewer sheets";
  } else if (cores < 2) {
    check.grade = Grade::kLimited;
    check.remedy = "give rustled two cores, that analysis does not delay sound";
  }
  return check;
}

MachineCheck check_scheduling() {
  using std::chrono::steady_clock;
  constexpr int kWakes = 200;
  std::vector<double> late_ms;
  late_ms.reserve(kWakes);
  for (int k = 0; k < kWakes; ++k) {
    const auto due = steady_clock::now() + std::chrono::milliseconds(1);
    std::this_thread::sleep_until(due);
    late_ms.push_back(std::chrono::duration<double, std::milli>(steady_clock::now() - due).count());
  }
  std::sort(late_ms.begin(), late_ms.end());
  const double most = late_ms.back();
  MachineCheck check{
      "scheduling", Grade::kGranted,
      fmt::format("of {} wakes the median was {:.2f} ms late, the latest {:.1f} ms", kWakes, late_ms[kWakes / 2], most), ""};
  if (most > 10) {
    check.grade = Grade::kLimited;
    check.remedy = "other work holds the cores, or the machine is virtual: give sessions a playout delay beyond it";
  }
  return check;
}

MachineCheck check_realtime_priority() {
  int failed = 0;
  std::thread([&failed] {
    sched_param wanted{};
    wanted.sched_priority = sched_get_priority_min(SCHED_FIFO);
    failed = pthread_setschedparam(pthread_self(), SCHED_FIFO, &wanted);
  }).join();
  rlimit limit{};
  getrlimit(RLIMIT_RTPRIO, &limit);
  if (failed == 0) return {"real-time priority", Grade::kGranted, "SCHED_FIFO may be used", ""};
  return {"real-time priority", Grade::kLimited,
          fmt::format("refused ({}), the limit is {}", std::strerror(failed), limit.rlim_cur),
          "add \"@audio - rtprio 20\" to /etc/security/limits.d/rustle.conf and join that group, or LimitRTPRIO=20 to the "
          "systemd unit; without it busy machines delay sound"};
}

MachineCheck check_memory_lock() {
  rlimit limit{};
  getrlimit(RLIMIT_MEMLOCK, &limit);
  void* pages = mmap(nullptr, kLockedBytes, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
  const bool locked = pages != MAP_FAILED && mlock(pages, kLockedBytes) == 0;
  if (pages != MAP_FAILED) munmap(pages, kLockedBytes);
  if (locked)
    return {"memory lock", Grade::kGranted,
            fmt::format("{} MiB can be locked, the limit is {}", kLockedBytes >> 20, mebibytes(limit.rlim_cur)), ""};
  return {
      "memory lock", Grade::kLimited, fmt::format("limit {}", mebibytes(limit.rlim_cur)),
      "add \"@audio - memlock unlimited\" to /etc/security/limits.d/rustle.conf, or LimitMEMLOCK=infinity to the systemd "
      "unit; without it a machine short of memory may page sound out"};
}

MachineCheck check_descriptors(std::size_t sessions) {
  rlimit limit{};
  getrlimit(RLIMIT_NOFILE, &limit);
  const std::size_t needed = kDescriptorsAtRest + kDescriptorsPerSession * sessions;
  const std::string found =
      fmt::format("{} of at most {}; {} sessions want {}", limit.rlim_cur, limit.rlim_max, sessions, needed);
  if (limit.rlim_cur >= needed) return {"descriptors", Grade::kGranted, found, ""};
  return {"descriptors", Grade::kLimited, found,
          limit.rlim_max >= needed
              ? fmt::format("`ulimit -n {}` before rustled, or LimitNOFILE={} in the systemd unit", needed, needed)
              : "raise nofile in /etc/security/limits.d, or LimitNOFILE in the systemd unit; or lower --max-sessions"};
}

std::optional<MachineCheck> check_fleet() {
  const auto address = sidecar_address(configured().sidecar, std::getenv("AGONES_SDK_HTTP_PORT"));
  if (!address)
    return MachineCheck{"fleet", Grade::kMissing, address.error(), "correct it, or leave the fleet with --sidecar off"};
  if (!*address) return std::nullopt;
  const auto reply = monitor::http_ask(**address, {.target = "/gameserver"}, std::chrono::seconds(1));
  const auto server = reply && reply->status == 200 ? fleet::parse_game_server(reply->body) : std::nullopt;
  if (server) return MachineCheck{"fleet", Grade::kGranted, fmt::format("{} is {}", server->name, server->state), ""};
  return MachineCheck{
      "fleet", Grade::kLimited,
      fmt::format("no sidecar at {}: {}", (*address)->text(), reply ? "it tells of no game server" : reply.error()),
      "rustled waits for it; see in the pod why Agones' container has not started, or say --sidecar off"};
}

std::vector<MachineCheck> check_machine() {
  std::vector<MachineCheck> checks{check_configuration(), check_packs(),
                                   check_ports(),         check_audio(),
                                   check_heads(),         check_processor(),
                                   check_scheduling(),    check_realtime_priority(),
                                   check_memory_lock(),   check_descriptors(configured().daemon.max_sessions)};
  if (auto fleet = check_fleet()) checks.push_back(std::move(*fleet));
  return checks;
}

}  // namespace rustle::apps
