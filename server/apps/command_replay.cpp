#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <filesystem>
#include <limits>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>
#include <thread>
#include <variant>
#include <vector>

#include "client_sdk/capture/capture_reader.h"
#include "client_sdk/capture/retime.h"
#include "client_sdk/cpp/session.h"
#include "server/apps/capture_source.h"
#include "server/apps/command.h"
#include "server/apps/daemon_address.h"
#include "server/apps/wording.h"
#include "server/session/settled_options.h"
#include "server/sinks/wav.h"
#include "server/wire/stream_envelope.h"

namespace rustle::apps {
namespace {

using SteadyTime = std::chrono::steady_clock::time_point;
using Body = wire::StreamEnvelope::Body;

constexpr std::chrono::milliseconds kLastNotices{100};  // on their way when a live session has ended

struct ReplayArguments {
  DaemonAddress daemon;
  std::string capture, clock = "live", material, wav, session, channels, hrtf;
  std::optional<std::uint64_t> seed;
  std::optional<double> from_s, to_s;
  double speed = 1;
  int loops = 1;
  bool json = false;
};

/// One message of the capture, ready to be sent.
struct ReplayMessage {
  std::string bytes;
  Body body;
  std::optional<double> time_s;  ///< simulation time
  std::optional<std::uint32_t> sheet;
  double due_s;  ///< seconds after the first message of the selection, at speed 1
};

struct Selection {
  session::SessionOptions options;
  bool announced = false;
  std::string name;
  std::vector<ReplayMessage> messages;
  double first_frame_s = 0;
  double length_s = 0;  ///< from the first frame to one frame past the last: where a loop begins again
  std::string damage;
};

tl::expected<Selection, std::string> read_selection(const ReplayArguments& arguments) {
  auto reader = capture::CaptureReader::open(arguments.capture);
  if (!reader) return tl::unexpected(reader.error());
  Selection selection;
  const double from = arguments.from_s.value_or(-std::numeric_limits<double>::infinity());
  const double to = arguments.to_s.value_or(std::numeric_limits<double>::infinity());
  std::optional<std::uint64_t> first_ns;
  std::optional<double> first_time, first_frame, last_frame, previous_frame;
  while (auto record = reader->next()) {
    if (record->kind != capture::Kind::kStreamMessage) continue;
    auto envelope = wire::StreamEnvelope::parse(std::as_bytes(std::span(record->bytes)), session_of(record->topic));
    if (!envelope) continue;
    if (selection.name.empty()) selection.name = envelope->session_id();
    if (envelope->session_id() != selection.name) continue;
    if (envelope->body() == Body::kAnnouncement) {
      if (auto announced = envelope->announcement(); announced && !selection.announced) {
        selection.options = announced->options;
        selection.announced = true;
      }
      continue;
    }
    const auto time = envelope->time_s();
    if (!first_time) first_time = time;
    const bool frame = envelope->body() == Body::kFrame;
    const bool timed_out = time && *time > to;
    if (timed_out ||
        (time && *time < from && (frame || envelope->body() == Body::kTearTips || envelope->body() == Body::kAdvance)))
      continue;
    if (frame && !first_ns) first_ns = record->log_time_ns;
    const double due =
        first_ns && record->log_time_ns > *first_ns ? static_cast<double>(record->log_time_ns - *first_ns) * 1e-9 : 0;
    selection.messages.push_back({std::move(record->bytes), envelope->body(), time, envelope->sheet_id(), due});
    if (frame) {
      if (!first_frame) first_frame = time;
      previous_frame = last_frame;
      last_frame = time;
    }
  }
  if (!first_frame)
    return tl::unexpected(
        fmt::format("{}: no frames between --from and --to; `rustle inspect` shows what there is", arguments.capture));
  selection.length_s = *last_frame - *first_frame + (previous_frame ? *last_frame - *previous_frame : 1.0 / 60);
  if (arguments.from_s) {
    selection.options.time_origin_s = *first_frame;
  } else if (!selection.announced) {
    selection.options.time_origin_s = *first_time;
  }
  selection.first_frame_s = *first_frame;
  if (!reader->recovery().complete) selection.damage = reader->recovery().what;
  return selection;
}

client::SessionOptions attach_options(const ReplayArguments& arguments, const Selection& selection) {
  const bool simulation = arguments.clock == "simulation";
  const session::SessionOptions said = simulation ? session::replayed(selection.options) : selection.options;
  client::SessionOptions options;
  options.name = arguments.session.empty() ? selection.name : arguments.session;
  options.clock = simulation ? client::Clock::kSimulation : client::Clock::kLive;
  options.time_origin_s = said.time_origin_s;
  options.metres_per_unit = said.metres_per_unit;
  options.up_axis = said.up_axis == session::UpAxis::kY ? client::UpAxis::kY : client::UpAxis::kZ;
  options.seed = arguments.seed.value_or(said.seed);
  options.mode = said.mode == session::SynthesisMode::kPublished ? client::SynthesisMode::kPublished
                                                                 : client::SynthesisMode::kCorrected;
  options.rate_hz = said.rate_hz;
  options.block_size = said.block_size;
  switch (said.channels) {
    case session::ChannelLayout::kMono:
      options.channels = client::Channels::kMono;
      break;
    case session::ChannelLayout::kStereo:
      options.channels = client::Channels::kStereo;
      break;
    case session::ChannelLayout::kBinaural:
      options.channels = client::Channels::kBinaural;
      break;
  }
  if (arguments.channels == "mono") options.channels = client::Channels::kMono;
  if (arguments.channels == "stereo") options.channels = client::Channels::kStereo;
  if (arguments.channels == "binaural") options.channels = client::Channels::kBinaural;
  options.hrtf = arguments.hrtf.empty() ? said.hrtf : arguments.hrtf;
  options.friction_fft_size = said.friction_fft_size;
  options.most_voices = said.most_voices;
  options.default_material = arguments.material.empty() ? said.default_material : arguments.material;
  if (simulation) options.playout_delay_s = said.playout_delay_s;
  return options;
}

/// Writes what the daemon sends back until the stream ends.
class WavReturn {
 public:
  WavReturn(client::Connection connection, client::PcmReader reader, std::string file)
      : connection_(std::move(connection)), reader_(std::move(reader)), file_(std::move(file)), thread_([this] { run(); }) {}
  ~WavReturn() {
    stop_.store(true);
    if (thread_.joinable()) thread_.join();
  }
  /// Waits for the end of the stream. Error: what could not be written or did not come.
  tl::expected<void, std::string> finish() {
    thread_.join();
    if (!failure_.empty()) return tl::unexpected(failure_);
    return {};
  }

 private:
  void run() {
    std::optional<sinks::WavWriter> wav;
    int idle = 0;
    while (!stop_.load()) {
      auto block = reader_.next(std::chrono::milliseconds(100));
      if (!block) {
        if (auto there = connection_.check(); !there) {
          failure_ = client::to_string(there.error());
          break;
        }
        if (++idle > 300) {
          failure_ = "no sound came from the daemon for 30 s; look at its log";
          break;
        }
        continue;
      }
      idle = 0;
      if (block->end) break;
      if (block->missing_samples != 0 && failure_.empty())
        failure_ = fmt::format("{}: {} lost on the way", file_, counted(block->missing_samples, "sample"));
      if (!wav) {
        auto created = sinks::WavWriter::create(file_, static_cast<int>(block->rate_hz), static_cast<int>(block->channels),
                                                sinks::WavFormat::kFloat32);
        if (!created) {
          failure_ = created.error();
          break;
        }
        wav = std::move(*created);
      }
      if (auto written = wav->write(block->interleaved); !written) {
        failure_ = written.error();
        break;
      }
    }
    if (wav) {
      if (auto closed = wav->close(); !closed) failure_ = closed.error();
    }
  }

  client::Connection connection_;
  client::PcmReader reader_;
  std::string file_;
  std::string failure_;
  std::atomic<bool> stop_{false};
  std::thread thread_;
};

double median(std::vector<double> values) {
  if (values.empty()) return 0;
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

int run(const ReplayArguments& arguments) {
  if (!std::filesystem::exists(arguments.capture)) {
    return complain(fmt::format("{}: there is no such file; make a capture with `rustle import`", arguments.capture),
                    kWrongUsage);
  }
  auto selection = read_selection(arguments);
  if (!selection) return complain(selection.error(), kFailed);
  const bool live = arguments.clock == "live";

  auto connection = connect_to(arguments.daemon);
  if (!connection) return complain(client::to_string(connection.error()) + " Start one with `rustled`.", kFailed);
  // A replay that lost a part would be no replay.
  auto session =
      client::Session::attach(*connection, attach_options(arguments, *selection), {.reconnect = false, .on_notice = {}});
  if (!session)
    return complain(client::to_string(session.error()),
                    session.error().code_name == "unknown_material" ? kWrongUsage : kFailed);
  std::optional<WavReturn> wav;
  if (!arguments.wav.empty()) {
    auto reader = session->listen();
    if (!reader) return complain(client::to_string(reader.error()), kFailed);
    wav.emplace(*connection, std::move(*reader), arguments.wav);
  }

  catch_interrupts();
  const SteadyTime start = std::chrono::steady_clock::now() + std::chrono::milliseconds(20);
  std::vector<double> late_s;
  std::uint64_t frames = 0;
  bool ended = false;
  std::map<std::string, std::pair<std::uint64_t, std::string>> complaints;
  std::string failure;
  Progress progress("replaying " + session->id());
  for (int loop = 0; (arguments.loops == 0 || loop < arguments.loops) && !interrupted() && failure.empty(); ++loop) {
    const bool last_loop = arguments.loops != 0 && loop + 1 == arguments.loops;
    std::set<std::uint32_t> begun;  // sheets that have shown a frame in this loop
    std::size_t sent_messages = 0;
    for (const auto& message : selection->messages) {
      if (interrupted()) break;
      if (message.body == Body::kEnd && !(last_loop && !arguments.to_s)) continue;
      if (loop > 0 && message.time_s && *message.time_s < selection->first_frame_s) continue;  // the scene as it was already
      const bool frame = message.body == Body::kFrame;
      if (live && message.due_s >= 0 && message.body != Body::kSheet && message.body != Body::kTopology) {
        const double due_s = (message.due_s + loop * selection->length_s) / arguments.speed;
        const auto due = start + std::chrono::duration_cast<SteadyTime::duration>(std::chrono::duration<double>(due_s));
        std::this_thread::sleep_until(due);
        if (frame) late_s.push_back(std::abs(std::chrono::duration<double>(std::chrono::steady_clock::now() - due).count()));
      }
      const std::string* bytes = &message.bytes;
      std::string moved;
      if (loop > 0) {
        moved = capture::retimed(message.bytes, loop * selection->length_s,
                                 frame && message.sheet && begun.insert(*message.sheet).second);
        bytes = &moved;
      }
      auto sent = session->raw(std::as_bytes(std::span(*bytes)));
      if (!sent) {
        failure = client::to_string(sent.error());
        break;
      }
      ended |= message.body == Body::kEnd;
      if (frame) ++frames;
      progress.show(static_cast<double>(++sent_messages) / static_cast<double>(selection->messages.size()));
    }
  }
  if (failure.empty() && !ended) {
    if (auto sent = session->end(); !sent) failure = client::to_string(sent.error());
  }
  if (failure.empty() && !live) {
    if (auto drained = session->drain(std::chrono::seconds(60)); !drained) failure = client::to_string(drained.error());
  }
  if (failure.empty() && wav) {
    if (auto finished = wav->finish(); !finished) failure = finished.error();
  }
  auto statistics = session->detach(false);
  if (!failure.empty()) return complain(failure, kFailed);
  if (!statistics) return complain(client::to_string(statistics.error()), kFailed);
  if (live) std::this_thread::sleep_for(kLastNotices);
  for (const auto& notice : session->poll_notices()) {
    auto& [count, text] = complaints[notice.code];
    count += notice.count;
    if (text.empty()) text = fmt::format("{}: {} {}", notice.field, notice.message, notice.remedy);
  }
  if (arguments.json) {
    nlohmann::ordered_json figures{{"session", session->id()},
                                   {"frames", frames},
                                   {"dropped_here", session->dropped_messages()},
                                   {"median_timing_error_s", median(late_s)},
                                   {"frames_dropped", statistics->frames_dropped}};
    for (const auto& figure : client::figures(*statistics))
      std::visit([&](const auto value) { figures[figure.name] = value; }, figure.value);
    fmt::print("{}\n", figures.dump());
  } else {
    fmt::print("{}: {} sent", session->id(), counted(frames, "frame"));
    if (live) fmt::print(", median timing error {:.2f} ms", 1e3 * median(late_s));
    fmt::print("; {} analysed, {}, {}, {}; {}\n", statistics->frames_analysed,
               counted(statistics->crumpling_events, "crumpling event"),
               counted(statistics->friction_episodes, "friction episode"), counted(statistics->tear_events, "tear"),
               to_string(losses_of(*statistics)));
  }
  std::vector<std::string> notices;
  for (const auto& [code, complaint] : complaints)
    notices.push_back(fmt::format("{} refused {}, first {}", code, counted(complaint.first, "time"), complaint.second));
  if (!selection->damage.empty()) notices.push_back(selection->damage);
  return done_with(notices);
}

}  // namespace

void add_replay(CLI::App& app, Action& action) {
  auto arguments = std::make_shared<ReplayArguments>();
  auto* command = app.add_subcommand("replay", "Stream a capture to a daemon as its simulator did");
  command->footer(
      "Example: rustle replay crumple.mcap --clock live --loop 0\n"
      "--clock live sends at the recorded times; --clock simulation as fast as the daemon takes it, and what comes back\n"
      "(--wav) is what `rustle render` gives, sample for sample.");
  command->add_option("CAPTURE", arguments->capture, "The capture (.mcap)")->required();
  command->add_option("--clock", arguments->clock, "Whose clock paces the session")
      ->check(CLI::IsMember({"live", "simulation"}))
      ->capture_default_str();
  command->add_option("--speed", arguments->speed, "Times as fast as recorded (live)")
      ->check(CLI::Range(0.01, 100.0))
      ->capture_default_str();
  command->add_option("--loop", arguments->loops, "How many times; 0 until interrupted")
      ->check(CLI::Range(0, 1000000))
      ->capture_default_str();
  command->add_option("--from", arguments->from_s, "Simulation time to begin at, in s");
  command->add_option("--to", arguments->to_s, "Simulation time to stop at, in s");
  command->add_option("--material", arguments->material, "Material of sheets that name none");
  command->add_option("--seed", arguments->seed, "Seed of everything random");
  command
      ->add_option("--channels", arguments->channels,
                   "mono, stereo, or binaural for headphones; the capture's own when absent, else stereo")
      ->check(CLI::IsMember({"mono", "stereo", "binaural"}));
  command->add_option("--hrtf", arguments->hrtf,
                      "Whose ears hear binaural sound: structural, kemar or another name that the daemon offers");
  command->add_option("--session", arguments->session, "Session name; the capture's when absent");
  command->add_option("--wav", arguments->wav, "WAV file for the sound that comes back");
  add_daemon_options(*command, arguments->daemon);
  command->add_flag("--json", arguments->json, "Print figures as JSON");
  command->callback([arguments, &action] { action = [arguments] { return run(*arguments); }; });
}

}  // namespace rustle::apps
