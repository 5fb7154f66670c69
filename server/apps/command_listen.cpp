#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <charconv>
#include <chrono>
#include <cmath>
#include <memory>
#include <optional>
#include <string_view>
#include <utility>

#include "client_sdk/cpp/pcm_reader.h"
#include "server/apps/command.h"
#include "server/apps/daemon_address.h"
#include "server/apps/emitter_files.h"
#include "server/apps/session_choice.h"
#include "server/apps/wording.h"
#include "server/sinks/wav.h"

namespace rustle::apps {
namespace {

constexpr int kSecondsWithout = 5;

struct ListenArguments {
  DaemonAddress daemon;
  std::string session, output, format = "f32", stem, emitters;
  double seconds = 0;
  int blocks = 4;
};

constexpr std::pair<client::SoundKind, std::string_view> kKinds[] = {{client::SoundKind::kCrumpling, "crumpling"},
                                                                     {client::SoundKind::kFriction, "friction"},
                                                                     {client::SoundKind::kTearing, "tearing"}};

std::string_view name_of(client::SoundKind kind) {
  return std::ranges::find(kKinds, kind, &std::pair<client::SoundKind, std::string_view>::first)->second;
}

/// Where the sound goes: one file, a folder of emitters, or nowhere.
class Output {
 public:
  explicit Output(const ListenArguments& arguments)
      : arguments_(arguments), format_(arguments.format == "s16" ? sinks::WavFormat::kInt16 : sinks::WavFormat::kFloat32) {}

  tl::expected<void, std::string> write(const client::PcmBlock& block) {
    rate_hz_ = block.rate_hz;
    if (!first_sample_) first_sample_ = block.first_sample;
    end_ = std::max(end_, block.first_sample + static_cast<std::int64_t>(block.samples));
    for (const float x : block.interleaved) peak_ = std::max(peak_, std::abs(x));
    if (!arguments_.emitters.empty()) return write_emitter(block);
    return arguments_.output.empty() ? tl::expected<void, std::string>{} : write_file(block);
  }
  tl::expected<void, std::string> close() {
    if (emitters_) return emitters_->close();
    return wav_ ? wav_->close() : tl::expected<void, std::string>{};
  }
  /// Of the stream, from the first sample heard to the last.
  double seconds() const { return rate_hz_ == 0 ? 0.0 : static_cast<double>(end_ - *first_sample_) / rate_hz_; }
  float peak() const { return peak_; }
  std::uint64_t emitters() const { return emitters_ ? emitters_->count() : 0; }

 private:
  tl::expected<void, std::string> write_file(const client::PcmBlock& block) {
    if (!wav_) {
      auto created = sinks::WavWriter::create(arguments_.output, static_cast<int>(block.rate_hz),
                                              static_cast<int>(block.channels), format_);
      if (!created) return tl::unexpected(created.error());
      wav_ = std::move(*created);
    } else if (block.missing_samples != 0) {  // a gap stays as long as it was
      const std::vector<float> silence(static_cast<std::size_t>(block.missing_samples) * block.channels);
      if (auto written = wav_->write(silence); !written) return written;
    }
    return wav_->write(block.interleaved);
  }

  tl::expected<void, std::string> write_emitter(const client::PcmBlock& block) {
    if (!emitters_) {
      auto created = EmitterFiles::create(arguments_.emitters, static_cast<int>(block.rate_hz), format_);
      if (!created) return tl::unexpected(created.error());
      emitters_ = std::move(*created);
    }
    const client::EmitterState& emitter = *block.emitter;
    const auto point = [](const client::Vector3& v) { return sheet::Vec3d(v[0], v[1], v[2]); };
    return emitters_->add({.emitter = emitter.emitter_id,
                           .sheet = emitter.sheet_id,
                           .kind = name_of(emitter.kind),
                           .first_sample = block.first_sample,
                           .position_m = point(emitter.position),
                           .normal = point(emitter.normal),
                           .last = emitter.last,
                           .missing = block.missing_samples,
                           .samples = block.interleaved});
  }

  const ListenArguments& arguments_;
  sinks::WavFormat format_;
  std::optional<sinks::WavWriter> wav_;
  std::optional<EmitterFiles> emitters_;
  std::uint32_t rate_hz_ = 0;
  std::optional<std::int64_t> first_sample_;
  std::int64_t end_ = 0;
  float peak_ = 0;
};

/// SHEET/KIND
std::optional<client::StemContent> parse_stem(const std::string& text) {
  client::StemContent stem;
  const char* const end = text.data() + text.size();
  const auto [slash, problem] = std::from_chars(text.data(), end, stem.sheet_id);
  if (problem != std::errc() || slash == end || *slash != '/') return std::nullopt;
  for (const auto& [kind, name] : kKinds) {
    stem.kind = kind;
    if (std::string_view(slash + 1, end) == name) return stem;
  }
  return std::nullopt;
}

int run(const ListenArguments& arguments) {
  client::ListenOptions options;
  if (!arguments.stem.empty()) {
    const auto stem = parse_stem(arguments.stem);
    if (!stem)
      return complain("--stem takes SHEET/KIND, as in --stem 1/friction; kinds are crumpling, friction, tearing",
                      kWrongUsage);
    options.content = *stem;
  }
  if (!arguments.emitters.empty()) {
    if (!arguments.stem.empty() || !arguments.output.empty())
      return complain("--emitters takes the place of --stem and --output; run `rustle listen` twice for both", kWrongUsage);
    options.content = client::EmitterContent{};
  }
  auto connection = connect_to(arguments.daemon);
  if (!connection) return complain(client::to_string(connection.error()), kFailed);
  const auto chosen = choose_session(*connection, arguments.session);
  if (!chosen) return complain(chosen.error().message, chosen.error().status);
  const std::string& session = *chosen;
  const auto is_asked = [&](const auto& s) { return s.session_id == session; };
  options.format = arguments.format == "s16"    ? client::SampleFormat::kS16
                   : arguments.format == "opus" ? client::SampleFormat::kOpus
                                                : client::SampleFormat::kF32;
  options.blocks = arguments.blocks;
  auto reader = client::PcmReader::listen(*connection, session, options);
  if (!reader) return complain(client::to_string(reader.error()), kFailed);

  catch_interrupts();
  Output output(arguments);
  int seconds_without = 0;
  const auto began = std::chrono::steady_clock::now();
  Progress level("listening to " + session);
  while (!interrupted()) {
    auto block = reader->next(std::chrono::seconds(1));
    if (!block) {
      if (auto there = connection->check(); !there) return complain(client::to_string(there.error()), kFailed);
      // Emitters that are silent send nothing.
      const double waited_s = std::chrono::duration<double>(std::chrono::steady_clock::now() - began).count();
      if (!arguments.emitters.empty() && arguments.seconds > 0 && waited_s >= arguments.seconds) break;
      // Else silence is sent too: when nothing comes the session may be gone.
      if (++seconds_without < kSecondsWithout) continue;
      const auto sessions = connection->list_sessions();
      if (!sessions) return complain(client::to_string(sessions.error()), kFailed);
      if (std::none_of(sessions->begin(), sessions->end(), is_asked)) break;
      seconds_without = 0;
      continue;
    }
    seconds_without = 0;
    if (block->end) break;
    if (auto written = output.write(*block); !written) return complain(written.error(), kFailed);
    level.show(arguments.seconds > 0 ? output.seconds() / arguments.seconds : 0);
    if (arguments.seconds > 0 && output.seconds() >= arguments.seconds) break;
  }
  if (auto closed = output.close(); !closed) return complain(closed.error(), kFailed);
  fmt::print("{}: {:.2f} s, {}peak {}, {} missing\n", session, output.seconds(),
             arguments.emitters.empty() ? "" : counted(output.emitters(), "emitter") + ", ", level_text(output.peak()),
             counted(reader->missing_samples(), "sample"));
  return reader->missing_samples() == 0 && reader->missing_messages() == 0 ? kDone : kFailed;
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
  command->add_option("--format", arguments->format, "Sample format on the wire; of Opus floats are written")
      ->check(CLI::IsMember({"f32", "s16", "opus"}))
      ->capture_default_str();
  command->add_option("--stem", arguments->stem, "One sheet's sound of one kind, SHEET/KIND, in place of the mix");
  command->add_option("--emitters", arguments->emitters,
                      "Folder for the dry sound of every emitter: a WAV file each, and emitters.jsonl with their positions");
  command->add_option("--blocks", arguments->blocks, "Blocks in a message: fewer come sooner")
      ->check(CLI::Range(1, 4))
      ->capture_default_str();
  add_daemon_options(*command, arguments->daemon);
  command->callback([arguments, &action] { action = [arguments] { return run(*arguments); }; });
}

}  // namespace rustle::apps
