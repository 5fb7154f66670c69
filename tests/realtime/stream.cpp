#include "tests/realtime/stream.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <numbers>
#include <utility>

#include "client_sdk/sheets/demos.h"
#include "client_sdk/sheets/motions.h"
#include "server/spatial/hrtf_choice.h"
#include "tests/support/animated_frames.h"

namespace rustle::realtime {
namespace {

constexpr double kFrames_per_s = 60;
constexpr double kCycle_s = 3, kPauseFrom_s = 2.4;
constexpr sheet::ObstacleId kTable = 1, kStanding = 2, kMoving = 3;

std::shared_ptr<const spatial::Hrtf> head_of(const session::SessionOptions& options) {
  if (options.channels != session::ChannelLayout::kBinaural) return nullptr;
  auto head = spatial::load_hrtf(options.hrtf, options.rate_hz);
  if (!head) {
    std::fprintf(stderr, "%s\n", head.error().c_str());
    std::exit(1);
  }
  return *head;
}

std::shared_ptr<const sheets::AnimatedSheet> demo(const char* name, std::size_t triangles, std::uint64_t seed = 1) {
  return sheets::make_demo(name, triangles, seed);
}

/// Crumpled faster than any hand could: more voices than there may be.
std::shared_ptr<const sheets::AnimatedSheet> frantic(std::uint64_t seed) {
  sheets::ShakeOptions options;
  options.wave.curvature_per_m = 40;
  options.wave.wavelength_m = 0.08;
  options.wave.frequency_hz = 14 + static_cast<double>(seed);
  options.wave.start_s = 0;
  options.duration_s = 3;
  return sheets::make_shake(
      sheets::make_rectangle(sheets::MeshKind::kDelaunay, options.size.width_m, options.size.height_m, 183, seed), options);
}

scene::Obstacle wall(sheet::ObstacleId id, const scene::Pose& pose) {
  scene::Obstacle obstacle;
  obstacle.id = id;
  obstacle.reflecting = true;
  obstacle.reflection_coefficient = 0.8;
  obstacle.shape = scene::PlaneShape{};
  obstacle.pose = pose;
  return obstacle;
}

/// Solid on its far side.
scene::Pose facing_minus_x(double x_m) {
  return {scene::Vec3d(x_m, 0, 0), Eigen::Quaterniond(Eigen::AngleAxisd(-std::numbers::pi / 2, scene::Vec3d::UnitY()))};
}

}  // namespace

std::vector<Scenario> all_scenarios() {
  using session::ChannelLayout;
  using session::Clock;
  const auto options = [](Clock clock, ChannelLayout channels, std::uint32_t rate_hz, std::uint32_t block_size) {
    session::SessionOptions out;
    out.clock = clock;
    out.channels = channels;
    out.rate_hz = rate_hz;
    out.block_size = block_size;
    return out;
  };
  std::vector<Scenario> all;

  auto whole = options(Clock::kLive, ChannelLayout::kStereo, 48000, 128);
  whole.record = true;
  all.push_back({"whole, stereo, walls", whole, {demo("bend_slide_snap_shake", 1333)}, true, true});

  auto measured = options(Clock::kLive, ChannelLayout::kBinaural, 48000, 64);
  measured.hrtf = "kemar";
  all.push_back({"slide, measured head, walls", measured, {demo("slide", 446)}, true, false});

  auto modelled = options(Clock::kLive, ChannelLayout::kBinaural, 44100, 512);
  modelled.hrtf = "structural";
  all.push_back({"snap, modelled head", modelled, {demo("snap", 446)}, false, true});

  auto published = options(Clock::kLive, ChannelLayout::kMono, 96000, 256);
  published.mode = session::SynthesisMode::kPublished;
  all.push_back({"slide and bend, published", published, {demo("slide", 183), demo("bend", 183)}, true, false});

  auto long_blocks = options(Clock::kSimulation, ChannelLayout::kStereo, 48000, 1024);
  long_blocks.friction_fft_size = 4096;
  all.push_back({"slides, simulation clock", long_blocks, {demo("slide", 183), demo("slide", 446, 2)}, true, false});

  all.push_back(
      {"crowd, simulation clock", options(Clock::kSimulation, ChannelLayout::kStereo, 48000, 128), {}, true, false});
  for (std::uint64_t k = 0; k < 4; ++k) all.back().sheets.push_back(frantic(k));
  return all;
}

Stream::Stream(const Scenario& scenario, std::shared_ptr<pack::PackLibrary> packs, const TurnedClock& clock)
    : scenario_(scenario), session_(scenario.name, scenario.options, std::move(packs), clock, head_of(scenario.options)) {
  for (std::size_t k = 0; k < scenario_.sheets.size(); ++k) {
    const auto& animated = *scenario_.sheets[k];
    const auto id = static_cast<sheet::SheetId>(k + 1);
    const test_support::AnimatedFrames source(animated, id);
    auto& frames = frames_.emplace_back();
    for (double time_s = 0; time_s < animated.duration_s(); time_s += 1 / kFrames_per_s) frames.push_back(source.at(time_s));
    offer(engine::SheetDescription{
        id, animated.on_table() ? "on the table" : "held", engine::SheetKind::kPaper, "", "", {}, {}});
  }
  scene::SceneUpdate begin;
  begin.obstacles.push_back(wall(kTable, {}));
  if (scenario_.walls) {
    begin.obstacles.push_back(wall(kStanding, facing_minus_x(1.5)));
    begin.obstacles.push_back(wall(kMoving, facing_minus_x(2)));
  }
  offer(begin);
}

void Stream::offer(engine::StreamItem item) {
  if (session_.offer(std::move(item), 0, 100) != session::Offer::kTaken) {
    std::fprintf(stderr, "%s: a session does not take what it is sent\n", name().c_str());
    std::exit(1);
  }
  analyse();
}

void Stream::analyse() {
  while (session_.analyse()) {
  }
}

void Stream::move_surroundings(double time_s) {
  scene::Listener listener;
  listener.time_s = time_s;
  listener.position_m = {0.3 + 0.8 * std::cos(0.5 * time_s), -0.8 + 0.5 * std::sin(0.7 * time_s), 0.7};
  offer(listener);
  scene::SceneUpdate moved;
  moved.time_s = time_s;
  moved.poses.push_back({kMoving, facing_minus_x(2 + 0.5 * std::sin(time_s))});
  offer(moved);
}

void Stream::feed(double time_s) {
  if (wants_analysis_) analyse();
  for (; static_cast<double>(next_frame_) / kFrames_per_s <= time_s; ++next_frame_) {
    const double frame_s = static_cast<double>(next_frame_) / kFrames_per_s;
    if (scenario_.pauses && std::fmod(frame_s, kCycle_s) >= kPauseFrom_s) continue;
    if (scenario_.walls) move_surroundings(frame_s);
    for (const auto& frames : frames_) {
      const auto last = static_cast<std::int64_t>(frames.size()) - 1;
      const std::int64_t there = next_frame_ % (2 * last);
      sheet::MeshFrame frame = frames[static_cast<std::size_t>(std::min(there, 2 * last - there))];
      frame.time_s = frame_s;
      offer(std::move(frame));
    }
  }
}

void Stream::drain() {
  while (session_.take_audio(scenario_.options.block_size, block_)) {
    for (const float sample : block_.interleaved) loudest_ = std::max(loudest_, static_cast<double>(std::abs(sample)));
  }
  static_cast<void>(session_.take_outcomes());
  if (scenario_.options.record) static_cast<void>(session_.decisions().take());
}

}  // namespace rustle::realtime
