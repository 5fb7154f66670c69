#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <memory>
#include <optional>

#include "client_sdk/cpp/pcm_reader.h"
#include "server/apps/command.h"
#include "server/apps/wording.h"
#include "server/sinks/wav.h"

namespace rustle::apps {
namespace {

constexpr int kSecondsWithout = 5;

struct ListenArguments {
  std::string session, control = "tcp://127.0.0.1:7390", output, format = "f32";
  double seconds = 0;
  int blocks = 4;
};

int run(const ListenArguments& arguments) {
  auto connection = client::Connection::connect({arguments.control, {}, {}});
  if (!connection) return complain(client::to_string(connection.error()), kFailed);
  std::string session = arguments.session;
  auto sessions = connection->list_sessions();
  if (!sessions) return complain(client::to_string(sessions.error()), kFailed);
  std::string names;
  for (const auto& s : *sessions) names += " " + s.session_id;
  const auto is_asked = [&](const auto& s) { return s.session_id == session; };
  if (!session.empty() && std::none_of(sessions->begin(), sessions->end(), is_asked)) {
    return complain(
        fmt::format("there is no session \"{}\"; {}", session, names.empty() ? "none is attached" : "there are:" + names),
        kWrongUsage);
  }
  if (session.empty()) {
    if (sessions->size() != 1) {
      return complain(sessions->empty() ? "no session is attached; start a simulator, or `rustle replay CAPTURE`"
                                        : "several sessions are attached, name one:" + names,
                      kWrongUsage);
    }
    session = sessions->front().session_id;
  }
  client::ListenOptions options;
  options.format = arguments.format == "s16" ? client::SampleFormat::kS16 : client::SampleFormat::kF32;
  options.blocks = arguments.blocks;
  auto reader = client::PcmReader::listen(*connection, session, options);
  if (!reader) return complain(client::to_string(reader.error()), kFailed);

  catch_interrupts();
  std::optional<sinks::WavWriter> wav;
  std::uint64_t samples = 0;
  std::uint32_t rate = 0;
  float peak = 0;
  int seconds_without = 0;
  Progress level("listening to " + session);
  while (!interrupted()) {
    auto block = reader->next(std::chrono::seconds(1));
    if (!block) {
      if (auto there = connection->check(); !there) return complain(client::to_string(there.error()), kFailed);
      // Silence is sent too: when nothing comes the session may be gone.
      if (++seconds_without < kSecondsWithout) continue;
      sessions = connection->list_sessions();
      if (!sessions) return complain(client::to_string(sessions.error()), kFailed);
      if (std::none_of(sessions->begin(), sessions->end(), is_asked)) break;
      seconds_without = 0;
      continue;
    }
    seconds_without = 0;
    if (block->end) break;
    rate = block->rate_hz;
    if (!wav && !arguments.output.empty()) {
      auto created =
          sinks::WavWriter::create(arguments.output, static_cast<int>(rate), static_cast<int>(block->channels),
                                   arguments.format == "s16" ? sinks::WavFormat::kInt16 : sinks::WavFormat::kFloat32);
      if (!created) return complain(created.error(), kFailed);
      wav = std::move(*created);
    }
    if (wav) {
      // A gap stays as long as it was.
      if (samples != 0 && block->missing_samples != 0) {
        const std::vector<float> silence(static_cast<std::size_t>(block->missing_samples) * block->channels);
        if (auto written = wav->write(silence); !written) return complain(written.error(), kFailed);
      }
      if (auto written = wav->write(block->interleaved); !written) return complain(written.error(), kFailed);
    }
    for (const float x : block->interleaved) peak = std::max(peak, std::abs(x));
    samples += block->samples;
    const double heard_s = static_cast<double>(samples) / rate;
    level.show(arguments.seconds > 0 ? heard_s / arguments.seconds : 0);
    if (arguments.seconds > 0 && heard_s >= arguments.seconds) break;
  }
  if (wav) {
    if (auto closed = wav->close(); !closed) return complain(closed.error(), kFailed);
  }
  fmt::print("{}: {:.2f} s, peak {}, {} missing\n", session, rate == 0 ? 0.0 : static_cast<double>(samples) / rate,
             level_text(peak), counted(reader->missing_samples(), "sample"));
  return reader->missing_samples() == 0 ? kDone : kFailed;
}

}  // namespace

void add_listen(CLI::App& app, Action& action) {
  auto arguments = std::make_shared<ListenArguments>();
  auto* command = app.add_subcommand("listen", "Receive a session's sound from a daemon");
  command->footer("Example: rustle listen flag -o flag.wav --seconds 10");
  command->add_option("SESSION", arguments->session, "The session; the only one there is when absent");
  command->add_option("-o,--output", arguments->output, "WAV file to write; without it only the level is told");
  command->add_option("--seconds", arguments->seconds, "Stop after that much sound; at the stream's end otherwise")
      ->check(CLI::PositiveNumber);
  command->add_option("--format", arguments->format, "Sample format")
      ->check(CLI::IsMember({"f32", "s16"}))
      ->capture_default_str();
  command->add_option("--blocks", arguments->blocks, "Blocks in a message: fewer come sooner")
      ->check(CLI::Range(1, 4))
      ->capture_default_str();
  command->add_option("--control", arguments->control, "The daemon's control endpoint")->capture_default_str();
  command->callback([arguments, &action] { action = [arguments] { return run(*arguments); }; });
}

}  // namespace rustle::apps
