// Renders live and simulated sessions of every kind under a watch that stops the program when the render path allocates,
// locks or calls the system.
#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "server/synthesis/nonblocking_scope.h"
#include "tests/realtime/stream.h"
#include "tests/realtime/watch.h"

namespace {

using namespace rustle;

constexpr std::int64_t kBlock = 128;
constexpr double kStep_s = 128.0 / 48000;

std::mutex g_mutex;
std::unique_ptr<int> g_number;

struct Violation {
  const char* name;
  void (*commit)();
};
constexpr Violation kViolations[] = {
    {"allocation", [] { g_number = std::make_unique<int>(1); }},
    {"free", [] { g_number.reset(); }},
    {"lock", [] { std::lock_guard lock(g_mutex); }},
    {"system-call", [] { static_cast<void>(::open("/dev/null", O_RDONLY)); }},
};

/// What must have been heard for the watch to have seen it all.
struct Seen {
  std::uint64_t crumpling = 0, friction = 0, stolen = 0, merged = 0, input_gaps = 0, frames = 0;
};

int missing(const char* what) {
  fmt::print(stderr, "no {} among what was rendered: the watch proves nothing about it\n", what);
  return 1;
}

int watch(std::int64_t blocks, const Violation* violation) {
  const auto packs = std::make_shared<pack::PackLibrary>();
  realtime::TurnedClock clock;
  std::vector<std::unique_ptr<realtime::Stream>> streams;
  for (const auto& scenario : realtime::all_scenarios())
    streams.push_back(std::make_unique<realtime::Stream>(scenario, packs, clock));
  g_number = std::make_unique<int>(0);
  const realtime::Watch watching = realtime::watch_this_thread();
  const bool on_terminal = isatty(STDERR_FILENO) != 0;
  if (!watching.sees_system_calls)
    fmt::print("system calls are not watched: this kernel does not hand them over (Linux 5.11 does)\n");

  std::int64_t samples = 0;
  for (std::int64_t step = 1; samples < blocks * kBlock; ++step) {
    const double time_s = static_cast<double>(step) * kStep_s;
    clock.turn_to(time_s);
    samples = 0;
    for (const auto& stream : streams) {
      stream->feed(time_s);
      if (violation != nullptr && stream->live()) clock.inside = violation->commit;
      stream->render();
      stream->drain();
      samples += stream->samples();
    }
    if (on_terminal && step % 1000 == 0)
      fmt::print(stderr, "\r{:3.0f} %",
                 std::min(100.0, 100.0 * static_cast<double>(samples) / static_cast<double>(blocks * kBlock)));
  }
  if (on_terminal) fmt::print(stderr, "\r");

  Seen seen;
  for (const auto& stream : streams) {
    const auto figures = stream->counters();
    seen.crumpling += figures.crumpling_events;
    seen.friction += figures.friction_episodes;
    seen.stolen += figures.render.voices_stolen;
    seen.merged += figures.plan.voices_merged;
    seen.input_gaps += figures.input_gaps.gaps;
    seen.frames += figures.frames_analysed;
    fmt::print(
        "{:<28}{:>9} blocks, {:>6} frames, {:>6} crumpling events, {:>4} friction episodes, at most {:>3} voices, {:>5} "
        "stolen, loudest {:.3f}\n",
        stream->name(), stream->samples() / kBlock, figures.frames_analysed, figures.crumpling_events,
        figures.friction_episodes, figures.render.voices_most, figures.render.voices_stolen, stream->loudest());
    if (stream->loudest() < 1e-4) return missing(fmt::format("sound of \"{}\"", stream->name()).c_str());
  }
  if (seen.crumpling == 0) return missing("crumpling");
  if (seen.friction == 0) return missing("friction");
  if (seen.stolen == 0) return missing("stolen voice");
  if (seen.merged == 0) return missing("merged voice");
  if (seen.input_gaps == 0) return missing("pause of a sender");
  fmt::print("{}: {} blocks of {} samples, no allocation, no lock{}\n", watching.name, samples / kBlock, kBlock,
             watching.sees_system_calls ? ", no system call" : "");
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app{
      "Renders under a watch that stops the program (status 43) when the render path allocates, locks or calls the system."};
  std::int64_t blocks = 10'000;
  std::string violate;
  app.add_option("--blocks", blocks, "Blocks of 128 samples, of all sessions together")
      ->check(CLI::Range(std::int64_t{10'000}, std::int64_t{1} << 40));
  std::vector<std::string> names;
  for (const auto& violation : kViolations) names.emplace_back(violation.name);
  app.add_option("--violate", violate, "Do this in the render path, to see whether it is caught")
      ->check(CLI::IsMember(names));
  app.footer("Example: render_guard --blocks 1000000");
  CLI11_PARSE(app, argc, argv);
  const Violation* violation = nullptr;
  for (const auto& each : kViolations)
    if (violate == each.name) violation = &each;
  return watch(blocks, violation);
}
