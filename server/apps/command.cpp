#include "server/apps/command.h"

#include <fmt/format.h>
#include <unistd.h>

#include <chrono>
#include <cmath>
#include <csignal>
#include <cstdio>
#include <filesystem>

namespace rustle::apps {

int complain(std::string_view message, ExitStatus status) {
  fmt::print(stderr, "rustle: {}\n", message);
  return status;
}

std::string level_text(double amplitude) {
  return amplitude > 0 ? fmt::format("{:.1f} dBFS", 20 * std::log10(amplitude)) : "silence";
}

std::string output_conflict(const std::vector<std::string>& inputs, const std::vector<std::string>& outputs) {
  const auto place = [](const std::string& name) {
    std::error_code unknown;
    return std::filesystem::weakly_canonical(name, unknown);
  };
  for (std::size_t k = 0; k < outputs.size(); ++k) {
    if (outputs[k].empty()) continue;
    std::error_code unknown;
    for (const auto& input : inputs) {
      if (place(input) == place(outputs[k]) || std::filesystem::equivalent(input, outputs[k], unknown)) {
        return fmt::format("{} is read and would be overwritten; write to another file", outputs[k]);
      }
    }
    for (std::size_t j = 0; j < k; ++j) {
      if (!outputs[j].empty() && place(outputs[j]) == place(outputs[k]))
        return fmt::format("{} would be written twice; name two files", outputs[k]);
    }
  }
  return {};
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

int done_with(const std::vector<std::string>& notices) {
  for (const auto& notice : notices) warn(notice);
  return notices.empty() ? kDone : kFailed;
}

Progress::Progress(std::string what) : what_(std::move(what)), on_terminal_(isatty(STDERR_FILENO) != 0) {}

Progress::~Progress() {
  if (shown_) fmt::print(stderr, "\r\033[K");
}

void Progress::show(double share) {
  if (on_terminal_) show(fmt::format("{:3.0f} %", 100 * share));
}

void Progress::show(const std::string& so_far) {
  if (!on_terminal_) return;
  const double now_s = std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
  if (shown_ && now_s - last_shown_s_ < 0.1) return;
  last_shown_s_ = now_s;
  shown_ = true;
  fmt::print(stderr, "\r\033[K{} {}", what_, so_far);
  std::fflush(stderr);
}

}  // namespace rustle::apps
