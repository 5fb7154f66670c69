#include "server/apps/command.h"

#include <fmt/format.h>
#include <unistd.h>

#include <chrono>
#include <csignal>
#include <cstdio>

namespace rustle::apps {

int complain(std::string_view message, ExitStatus status) {
  fmt::print(stderr, "rustle: {}\n", message);
  return status;
}

namespace {

volatile std::sig_atomic_t g_interrupted = 0;

}  // namespace

void catch_interrupts() {
  std::signal(SIGINT, [](int) { g_interrupted = 1; });
  std::signal(SIGTERM, [](int) { g_interrupted = 1; });
}

bool interrupted() {
  return g_interrupted != 0;
}

void warn(std::string_view message) {
  fmt::print(stderr, "rustle: warning: {}\n", message);
}

Progress::Progress(std::string what) : what_(std::move(what)), on_terminal_(isatty(STDERR_FILENO) != 0) {}

Progress::~Progress() {
  if (shown_) fmt::print(stderr, "\r\033[K");
}

void Progress::show(double share) {
  if (!on_terminal_) return;
  const double now_s = std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
  if (shown_ && now_s - last_shown_s_ < 0.1) return;
  last_shown_s_ = now_s;
  shown_ = true;
  fmt::print(stderr, "\r\033[K{} {:3.0f} %", what_, 100 * share);
  std::fflush(stderr);
}

}  // namespace rustle::apps
