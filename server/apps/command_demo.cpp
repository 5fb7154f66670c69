#include <fmt/format.h>
#include <spdlog/spdlog.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <atomic>
#include <cmath>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <sstream>
#include <thread>

#include "client_sdk/cpp/observation_reader.h"
#include "client_sdk/cpp/session.h"
#include "client_sdk/sheets/stream_demos.h"
#include "server/apps/command.h"
#include "server/apps/daemon.h"
#include "server/apps/demo_recording.h"
#include "server/apps/scratch_folder.h"
#include "server/apps/wording.h"
#include "server/report/spectrogram_picture.h"
#include "server/sinks/wav.h"

namespace rustle::apps {
namespace {

constexpr double kFramesPerSecond = 60;
constexpr double kSlidingHeard_m_per_s = 0.02;
constexpr double kFlapTold_m = 0.002;
constexpr std::uint32_t kSheet = 1;

struct DemoArguments {
  std::string what = "bend_slide_snap_shake", output = "demo", material, capture, tips = "sent";
  std::uint64_t seed = 1;
  std::size_t triangles = 1333;
};

/// Tells what is heard as it comes, and keeps it for the picture.
class Teller {
 public:
  void tell(const client::Observation& seen) {
    for (const auto& event : seen.crumpling) {
      report::EventMark mark;
      mark.id = event.event_id;
      mark.kind = report::EventKind::kCrumpling;
      mark.time_s = mark.end_s = event.time_s;
      mark.amplitude = event.amplitude_m;
      mark.area_m2 = event.area_m2;
      marks_.push_back(mark);
      if (event.continues_event_id != 0 || event.amplitude_m < kFlapTold_m) continue;
      const bool flap =
          std::any_of(event.resonators.begin(), event.resonators.end(), [](const auto& r) { return !r.constrained; });
      fmt::print("{:6.2f} s  {}  {:.3f} m over {:.0f} cm2{}\n", event.time_s, flap ? "flap" : "clac", event.amplitude_m,
                 1e4 * event.area_m2, resonator_text(event.resonators));
    }
    double speed = 0;
    std::string surface;
    for (const auto& contact : seen.friction) {
      auto& mark = episodes_[contact.event_id];
      if (mark.speeds.empty()) {
        mark.id = contact.event_id;
        mark.kind = report::EventKind::kFriction;
        mark.time_s = seen.time_s;
      }
      mark.end_s = seen.time_s;
      mark.speeds.push_back({seen.time_s, contact.speed_m_per_s});
      mark.amplitude = std::max(mark.amplitude, contact.speed_m_per_s);
      if (contact.speed_m_per_s > speed) {
        speed = contact.speed_m_per_s;
        surface = contact.touched_surface;
      }
    }
    if (speed > kSlidingHeard_m_per_s && !sliding_) {
      fmt::print("{:6.2f} s  slides over {}\n", seen.time_s, surface.empty() ? "what it touches" : surface);
      sliding_ = true;
    } else if (speed < kSlidingHeard_m_per_s / 2 && sliding_) {
      sliding_ = false;
    }
  }

  std::vector<report::EventMark> marks() const {
    std::vector<report::EventMark> all = marks_;
    for (const auto& [id, mark] : episodes_) {
      if (mark.amplitude > kSlidingHeard_m_per_s / 2) all.push_back(mark);
    }
    return all;
  }

 private:
  static std::string resonator_text(const std::vector<client::ObservedResonator>& resonators) {
    const auto largest = std::max_element(resonators.begin(), resonators.end(),
                                          [](const auto& a, const auto& b) { return a.area_m2 < b.area_m2; });
    if (largest == resonators.end() || largest->constrained) return {};
    return fmt::format(", resonator l_r {:.0f} cm, l_c {:.0f} cm", 100 * largest->ruling_length_m,
                       100 * largest->free_border_length_m);
  }

  std::vector<report::EventMark> marks_;
  std::map<std::uint64_t, report::EventMark> episodes_;
  bool sliding_ = false;
};

template <typename T>
Failure failure_of(const tl::expected<T, client::Error>& result) {
  return result ? Failure{} : Failure{client::to_string(result.error())};
}

using Demos = std::vector<std::unique_ptr<sheets::SheetStream>>;

constexpr double kBetweenDemos_s = 0.3;  // between demos

double duration_s(const Demos& demos) {
  double sum = kBetweenDemos_s * static_cast<double>(demos.size() - 1);
  for (const auto& demo : demos) sum += demo->duration_s();
  return sum;
}

/// What a demo is sent to: its session, and its capture where one is wanted.
struct Receivers {
  client::Session& session;
  DemoRecording& recording;
  bool sends_tips = true;
  std::uint64_t topologies = 0;  ///< sent so far
};

Failure send_topology(Receivers& to, const sheets::SheetMesh& mesh) {
  client::Topology topology;
  topology.id = ++to.topologies;
  topology.vertex_count = static_cast<std::uint32_t>(mesh.material_coordinates.size());
  topology.triangles = {mesh.triangles.front().data(), 3 * mesh.triangles.size()};
  topology.material_coordinates = {mesh.material_coordinates.front().data(), 2 * mesh.material_coordinates.size()};
  if (auto failed = to.recording.topology(topology)) return failed;
  return failure_of(to.session.add_topology(topology));
}

Failure send_table(Receivers& to, double time_s) {
  client::SceneUpdate scene;
  scene.time_s = time_s;
  scene.obstacles.push_back(
      {.id = 1, .name = "table", .surface_material = "wooden-table", .reflecting = true, .shape = client::Plane{}});
  if (auto failed = to.recording.scene(scene)) return failed;
  return failure_of(to.session.scene(scene));
}

/// Sends one demo's frames as a simulator would, from `start_s` on.
Failure simulate(Receivers& to, sheets::SheetStream& stream, double start_s, const std::function<void(double)>& sent) {
  const auto frames = static_cast<int>(std::ceil(stream.duration_s() * kFramesPerSecond));
  std::shared_ptr<const sheets::SheetMesh> mesh;
  for (int k = 0; k <= frames; ++k) {
    const double time_s = k / kFramesPerSecond;
    const sheets::StreamedFrame& frame = stream.frame(time_s);
    if (frame.mesh != mesh) {
      mesh = frame.mesh;
      if (auto failed = send_topology(to, *mesh)) return failed;
    }
    if (k == 0 && stream.on_table()) {
      if (auto failed = send_table(to, start_s)) return failed;
    }
    std::vector<client::TearTip> tips;
    if (to.sends_tips) {
      for (const auto& tip : frame.tear_tips) tips.push_back({tip.id, tip.position_m, tip.speed_m_per_s, tip.direction});
    }
    client::FrameExtras extras;
    extras.anchored = frame.anchored;
    extras.reset_history = frame.fresh;
    extras.tear_tips = tips;
    if (auto failed = to.recording.frame(kSheet, to.topologies, start_s + time_s, frame.xyz_m, extras)) return failed;
    if (auto failed = failure_of(to.session.frame(kSheet, to.topologies, start_s + time_s, frame.xyz_m, extras)))
      return failed;
    sent(start_s + time_s);
  }
  return {};
}

Failure simulate(Receivers to, const Demos& demos) {
  Progress progress("simulating");
  double start_s = 0;
  for (const auto& demo : demos) {
    const auto sent = [&](double time_s) { progress.show(time_s / duration_s(demos)); };
    if (auto failed = simulate(to, *demo, start_s, sent)) return failed;
    start_s += demo->duration_s() + kBetweenDemos_s;
  }
  if (auto failed = to.recording.finish()) return failed;
  return failure_of(to.session.end());
}

struct Heard {
  std::vector<float> interleaved;
  std::uint32_t rate_hz = 0, channels = 0;
};

Failure play(const DemoArguments& arguments, const Demos& demos, bool cloth, const std::string& control, Heard& heard,
             Teller& teller) {
  auto connection = client::Connection::connect({control, {}, {}});
  if (auto failed = failure_of(connection)) return failed;
  client::SessionOptions options;
  options.name = "demo";
  options.clock = client::Clock::kSimulation;
  options.seed = arguments.seed;
  options.default_material = arguments.material;
  client::SheetOptions sheet;
  sheet.id = kSheet;
  sheet.name = arguments.what;
  if (cloth) sheet.kind = client::SheetKind::kCloth;
  options.sheets.push_back(sheet);
  DemoRecording recording;
  if (!arguments.capture.empty()) {
    if (auto failed = recording.open(arguments.capture, options)) return failed;
  }
  auto session = client::Session::attach(*connection, options);
  if (auto failed = failure_of(session)) return failed;
  auto pcm = session->listen();
  if (auto failed = failure_of(pcm)) return failed;
  auto observations = client::ObservationReader::listen(*connection, session->id());
  if (auto failed = failure_of(observations)) return failed;

  std::atomic<bool> done{false};
  std::thread teller_thread([&] {
    while (!done.load()) {
      while (auto seen = observations->next(std::chrono::milliseconds(20))) teller.tell(*seen);
    }
  });
  Failure failed;
  std::thread listener_thread([&] {
    while (auto block = pcm->next(std::chrono::seconds(30))) {
      if (block->end) return;
      heard.rate_hz = block->rate_hz;
      heard.channels = block->channels;
      heard.interleaved.insert(heard.interleaved.end(), block->interleaved.begin(), block->interleaved.end());
    }
    failed = "no sound came back for 30 s";
  });
  Failure sending = simulate({*session, recording, arguments.tips == "sent"}, demos);
  if (sending) static_cast<void>(session->end());
  listener_thread.join();
  done.store(true);
  teller_thread.join();
  for (const auto& notice : session->poll_notices())
    warn(fmt::format("{}: {} {}", notice.field, notice.message, notice.remedy));
  static_cast<void>(session->detach());
  return sending ? sending : failed;
}

int run(DemoArguments arguments) {
  if (arguments.material.empty()) {
    std::stringstream first(arguments.what);
    std::string name;
    std::getline(first, name, ',');
    arguments.material = sheets::usual_material(name);
  }
  Demos demos;
  std::stringstream names(arguments.what);
  for (std::string name; std::getline(names, name, ',');) {
    demos.push_back(sheets::make_stream_demo(name, arguments.triangles, arguments.seed, arguments.material));
    if (demos.back()) continue;
    std::string known;
    for (const auto one : sheets::stream_demo_names()) known += " " + std::string(one);
    return complain(fmt::format("there is no demo \"{}\"; there are:{}", name, known), kWrongUsage);
  }
  if (demos.empty()) return complain("name a demo, as in `rustle demo snap`", kWrongUsage);
  const std::string& output = arguments.output;
  const std::string stem = output.ends_with(".wav") ? output.substr(0, output.size() - 4) : output;
  const std::string wav_name = stem + ".wav", picture_name = stem + ".png";
  if (auto conflict = output_conflict({}, {wav_name, picture_name, arguments.capture}); !conflict.empty())
    return complain(conflict, kWrongUsage);
  auto packs = std::make_shared<pack::PackLibrary>();
  if (auto found = packs->find(arguments.material); !found) return complain(found.error().text(), kWrongUsage);

  const auto pack = packs->load(arguments.material, {}, 48000);
  if (!pack) return complain(pack.error().text(), kFailed);
  const bool cloth = (*pack)->cloth != nullptr;

  const ScratchFolder folder;
  if (folder.path().empty())
    return complain("no folder for the demo's sockets could be made; set TMPDIR to one that is yours", kFailed);
  DaemonOptions options;
  options.sockets.control = "ipc://" + folder.path().string() + "/control";
  options.sockets.stream = "ipc://" + folder.path().string() + "/stream";
  options.sockets.out = "ipc://" + folder.path().string() + "/out";
  spdlog::set_level(spdlog::level::warn);
  auto daemon = Daemon::open(options, packs);
  if (!daemon) return complain(daemon.error(), kFailed);
  std::atomic<bool> stop{false};
  std::thread network([&] { (*daemon)->run(stop); });

  fmt::print("A sheet of {} attaches to the daemon, {:.1f} s of motion, {}.\n", arguments.material, duration_s(demos),
             counted(arguments.triangles, "triangle"));
  Heard heard;
  Teller teller;
  const auto failed = play(arguments, demos, cloth, options.sockets.control, heard, teller);
  stop.store(true);
  network.join();
  if (failed) return complain(*failed, kFailed);

  auto wav = sinks::WavWriter::create(wav_name, static_cast<int>(heard.rate_hz), static_cast<int>(heard.channels),
                                      sinks::WavFormat::kFloat32);
  if (!wav) return complain(wav.error(), kFailed);
  auto written = wav->write(heard.interleaved);
  if (written) written = wav->close();
  if (!written) return complain(written.error(), kFailed);
  const report::Sound sound{heard.interleaved, static_cast<int>(heard.channels), static_cast<double>(heard.rate_hz), 0};
  report::SpectrogramOptions spectrogram;
  spectrogram.title = fmt::format("rustle demo: a sheet of {}", arguments.material);
  if (auto drawn = report::write_spectrogram_png(picture_name, sound, teller.marks(), spectrogram); !drawn)
    return complain(drawn.error(), kFailed);
  float peak = 0;
  for (const float x : heard.interleaved) peak = std::max(peak, std::abs(x));
  fmt::print("{}: {:.1f} s, peak {}; {}: its spectrogram{}\n", wav_name, sound.duration_s(), level_text(peak), picture_name,
             arguments.capture.empty() ? "" : "; " + arguments.capture + ": its frames");
  return kDone;
}

}  // namespace

void add_demo(CLI::App& app, Action& action) {
  auto arguments = std::make_shared<DemoArguments>();
  auto* command =
      app.add_subcommand("demo", "Attach a built-in animated sheet to a daemon of its own and write what it sounds like");
  command->footer(
      "Example: rustle demo snap --material printer-paper -o snap --capture snap.mcap\n"
      "The capture serves the other commands: `rustle render snap.mcap -o again.wav` gives the same samples.");
  std::string names;
  for (const auto known : sheets::stream_demo_names()) names += (names.empty() ? "" : ", ") + std::string(known);
  command->add_option("WHAT", arguments->what, "One or several, separated by commas: " + names)->capture_default_str();
  command
      ->add_option("-o,--output", arguments->output,
                   "Writes OUTPUT.wav and OUTPUT.png; a name that ends with .wav is taken without")
      ->capture_default_str();
  command->add_option("--capture", arguments->capture, "Keeps the motion that is sent as a capture (.mcap)");
  command->add_option("--material", arguments->material, "The sheet's material [printer-paper; of cloth cotton]");
  command
      ->add_option("--tips", arguments->tips,
                   "Where a sheet is torn: \"sent\" with its frames, or \"found\" by the daemon in the mesh")
      ->check(CLI::IsMember({"sent", "found"}))
      ->capture_default_str();
  command->add_option("--seed", arguments->seed, "Seed of everything random")->capture_default_str();
  command->add_option("--triangles", arguments->triangles, "Of the sheet's mesh")
      ->check(CLI::Range(50, 100000))
      ->capture_default_str();
  command->callback([arguments, &action] { action = [arguments] { return run(*arguments); }; });
}

}  // namespace rustle::apps
