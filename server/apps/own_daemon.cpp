#include "server/apps/own_daemon.h"

#include <fmt/format.h>
#include <sched.h>
#include <signal.h>
#include <stdlib.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <chrono>
#include <cstring>
#include <filesystem>
#include <system_error>
#include <thread>
#include <utility>

namespace rustle::apps {
namespace {

constexpr std::chrono::seconds kEnds{6};  // a daemon drains for less

std::string daemon_program() {
  std::error_code failed;
  const auto own = std::filesystem::read_symlink("/proc/self/exe", failed);
  return failed ? "rustled" : (own.parent_path() / "rustled").string();
}

}  // namespace

tl::expected<OwnDaemon, std::string> OwnDaemon::start(const Options& options) {
  std::string folder = (std::filesystem::temp_directory_path() / "rustle-own-XXXXXX").string();
  if (mkdtemp(folder.data()) == nullptr)
    return tl::unexpected(std::string("no folder for the daemon's sockets could be made; set TMPDIR to one that is yours"));
  std::vector<std::string> words{daemon_program(), "--config", "none", "--device", "none", "--http", "off"};
  for (const char* name : {"control", "stream", "out"}) {
    words.push_back(fmt::format("--{}", name));
    words.push_back(fmt::format("ipc://{}/{}", folder, name));
  }
  words.insert(words.end(), {"--log-level", "error", "--max-sessions", std::to_string(options.max_sessions)});
  words.insert(words.end(), options.arguments.begin(), options.arguments.end());
  std::vector<char*> arguments;
  for (std::string& word : words) arguments.push_back(word.data());
  arguments.push_back(nullptr);
  cpu_set_t cpus;
  CPU_ZERO(&cpus);
  for (const int cpu : options.cpus) CPU_SET(static_cast<std::size_t>(cpu), &cpus);

  const pid_t process = ::fork();
  if (process == 0) {
    if (!options.cpus.empty() && ::sched_setaffinity(0, sizeof cpus, &cpus) != 0) ::_exit(126);
    ::execvp(arguments[0], arguments.data());
    ::_exit(127);
  }
  OwnDaemon daemon(folder, process);
  if (process < 0) return tl::unexpected(fmt::format("no daemon could be started: {}", std::strerror(errno)));
  // Its sockets are files: they are there once it listens.
  for (int tries = 0; tries < 500 && !std::filesystem::exists(folder + "/out"); ++tries) {
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
    if (!daemon.runs())
      return tl::unexpected(fmt::format("{} ended at once; try `{} --print-config` by hand", words[0], words[0]));
  }
  return daemon;
}

OwnDaemon::OwnDaemon(OwnDaemon&& other) noexcept
    : folder_(std::exchange(other.folder_, {})), process_(std::exchange(other.process_, -1)) {}

OwnDaemon::~OwnDaemon() {
  if (process_ > 0) {
    ::kill(process_, SIGTERM);
    const auto until = std::chrono::steady_clock::now() + kEnds;
    while (runs() && std::chrono::steady_clock::now() < until) std::this_thread::sleep_for(std::chrono::milliseconds(20));
    if (process_ > 0) {
      ::kill(process_, SIGKILL);
      ::waitpid(process_, nullptr, 0);
    }
  }
  std::error_code ignored;
  if (!folder_.empty()) std::filesystem::remove_all(folder_, ignored);
}

std::string OwnDaemon::control() const {
  return fmt::format("ipc://{}/control", folder_);
}

bool OwnDaemon::runs() {
  if (process_ <= 0) return false;
  if (::waitpid(process_, nullptr, WNOHANG) == 0) return true;
  process_ = -1;
  return false;
}

}  // namespace rustle::apps
