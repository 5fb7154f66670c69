#include "server/synthesis/mixer.h"

#include <catch2/catch.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <complex>
#include <cstring>
#include <limits>

#include "server/spatial/transfer.h"
#include "server/synthesis/model_registry.h"
#include "sound_db/dsp/fft.h"
#include "sound_db/dsp/random.h"
#include "sound_db/dsp/window.h"
#include "tests/unit/synthesis/rig.h"

namespace mixer_test {

using namespace rustle::synthesis;
using namespace rustle::synthesis::rig;
namespace spatial = rustle::spatial;
namespace dsp = rustle::dsp;

namespace {

bool same_bits(const std::vector<float>& a, const std::vector<float>& b) {
  return a.size() == b.size() && std::memcmp(a.data(), b.data(), a.size() * sizeof(float)) == 0;
}

std::vector<float> noise_unit(std::size_t samples, std::uint64_t seed) {
  dsp::Random random(seed);
  std::vector<float> unit(samples);
  for (float& x : unit) x = static_cast<float>(0.1 * random.normal());
  return unit;
}

std::array<IdentifiedPlane, 2> table_and_wall(double wall_x_m) {
  return {IdentifiedPlane{1, {{0, 0, -0.05}, {0, 0, 1}, 1.0}}, IdentifiedPlane{2, {{wall_x_m, 0, 0}, {1, 0, 0}, 0.8}}};
}

/// Two seconds in which listener, wall, contact and sheet move, events of both kinds, everything planned ahead.
void plan_lively_scene(Rig& rig, double up_sign = 1) {
  dsp::Random random(5);
  std::uint64_t id = 1;
  for (int frame = 1; frame <= 60; ++frame) {
    const double before = (frame - 1) / 30.0, time = frame / 30.0;
    spatial::Listener listener;
    listener.position_m = {0.3 * std::sin(time), 1 - 0.2 * time, 0.7};
    listener.forward = spatial::normalized({0.1, -1, -0.5}, {0, 1, 0});
    listener.up = up_sign * spatial::normalized({0.2 * std::cos(time), 0, 1}, {0, 0, 1});
    rig.planner.listener(listener, time, 0, rig.cues);
    rig.planner.planes(table_and_wall(-0.5 - 0.1 * time), time, 0, rig.cues);
    auto o = rig.frame(before, time);
    auto resonator = bent_resonator({0.2 * std::sin(3 * time), 0.1, 0.02}, {0.3, std::sin(time), 0.9});
    resonator.covariance_m2.setIdentity();
    resonator.covariance_m2 *= 1e-4;
    o.friction = {slide(1, 0.1 + 0.05 * std::sin(4 * time), {resonator}), slide(2, 0.05)};
    if (frame % 3 == 0)
      o.crumpling = {flap(id++, before + random.uniform() / 30, 0.05 + 0.1 * random.uniform(), {resonator})};
    rig.planner.plan(o, 0, rig.cues);
  }
}

}  // namespace

TEST_CASE("The registry has crumpling and friction of paper, tearing and cloth") {
  REQUIRE(sound_models().size() == 4);
  CHECK(sound_models()[0].kind == SoundKind::kCrumpling);
  CHECK(sound_models()[1].kind == SoundKind::kFriction);
  CHECK(sound_models()[3].name == "cloth");
}

TEST_CASE("Silence in, silence out") {
  Rig rig({}, Mode::kCorrected, spatial::Layout::kStereo);
  rig.planner.planes(table_and_wall(-1), 0, 0, rig.cues);
  rig.hand_over();
  for (const auto& channel : rig.run(48000))
    CHECK(std::all_of(channel.begin(), channel.end(), [](float x) { return x == 0; }));
  CHECK(rig.mixer.silent());
  for (int bus = 0; bus < rig.mixer.buses(); ++bus) CHECK_FALSE(rig.mixer.sounding(static_cast<Bus>(bus)));
}

TEST_CASE("When and in what order cues arrive does not change a sample, as long as they come before their time") {
  PackOptions options;
  options.unit = noise_unit(12000, 1);
  options.gain_sigma = 0.35;
  Rig ahead(options, Mode::kCorrected, spatial::Layout::kStereo), late(options, Mode::kCorrected, spatial::Layout::kStereo);
  plan_lively_scene(ahead);
  ahead.hand_over();
  const auto x = ahead.run(96000);

  plan_lively_scene(late);
  late.planner.release(INT64_MAX, late.cues);
  std::vector<Cue> waiting = late.cues;
  std::reverse(waiting.begin(), waiting.end());
  // Listener and planes of one moment keep their order.
  std::stable_sort(waiting.begin(), waiting.end(), [](const Cue& a, const Cue& b) { return a.index() < b.index(); });
  for (std::size_t i = 0, j; i < waiting.size(); i = j) {
    for (j = i; j < waiting.size() && waiting[j].index() == waiting[i].index();) ++j;
    if (waiting[i].index() >= 3)
      std::reverse(waiting.begin() + static_cast<std::ptrdiff_t>(i), waiting.begin() + static_cast<std::ptrdiff_t>(j));
  }
  std::vector<std::vector<float>> y(2);
  while (late.now < 96000) {
    const SampleTime until = late.now + kQuantum;
    for (const Cue& cue : waiting) {
      if (start_of(cue) >= late.now && start_of(cue) < until) late.mixer.apply(cue);
    }
    const auto quantum = late.run(kQuantum);
    for (std::size_t c = 0; c < 2; ++c) y[c].insert(y[c].end(), quantum[c].begin(), quantum[c].end());
  }
  CHECK(rms_db(x[0]) > -60);
  CHECK(same_bits(x[0], y[0]));
  CHECK(same_bits(x[1], y[1]));
}

TEST_CASE("Turning the listener over swaps the channels bit for bit, with two planes and everything moving") {
  PackOptions options;
  options.unit = noise_unit(12000, 2);
  options.gain_sigma = 0.35;
  spatial::Listener below = above();
  below.up = -below.up;
  Rig upright(options, Mode::kCorrected, spatial::Layout::kStereo);
  Rig turned(options, Mode::kCorrected, spatial::Layout::kStereo, 512, below);
  plan_lively_scene(upright);
  plan_lively_scene(turned, -1);
  upright.hand_over();
  turned.hand_over();
  const auto x = upright.run(96000), y = turned.run(96000);
  CHECK(rms_db(x[0]) > -60);
  CHECK_FALSE(same_bits(x[0], x[1]));
  CHECK(same_bits(x[0], y[1]));
  CHECK(same_bits(x[1], y[0]));
}

TEST_CASE("Buses keep sheets and kinds apart, and each has its gain") {
  PackOptions options;
  options.unit = noise_unit(24000, 3);
  Rig rig(options);
  rig.planner.add_sheet({2, 1, make_pack(options), {}}, 0, rig.cues);
  auto o = rig.frame(0, 0.1);
  o.crumpling = {flap(1, 0.0, 0.1)};
  rig.planner.plan(o, 0, rig.cues);
  o.sheet = 2;
  o.crumpling.clear();
  o.friction = {slide(1, 0.1)};
  rig.planner.plan(o, 0, rig.cues);
  rig.hand_over();
  rig.run(9600);
  CHECK(rig.mixer.sounding(bus_of(0, SoundKind::kCrumpling)));
  CHECK(rig.mixer.sounding(bus_of(1, SoundKind::kFriction)));
  CHECK_FALSE(rig.mixer.sounding(bus_of(0, SoundKind::kFriction)));
  CHECK_FALSE(rig.mixer.sounding(bus_of(1, SoundKind::kCrumpling)));

  Rig plain(options), turned(options);
  turned.planner.gains(
      {{-6, {}, {}, ""}, {-3, {}, SoundKind::kCrumpling, ""}, {2, 1, {}, ""}, {1, {}, {}, "test-paper"}, {9, 2, {}, ""}}, 0,
      turned.cues);
  for (Rig* r : {&plain, &turned}) {
    auto event = r->frame(0, 0.1);
    event.crumpling = {flap(1, 0.05, 0.1)};
    r->planner.plan(event, 0, r->cues);
    r->hand_over();
  }
  CHECK(rms_db(turned.run(24000)[0]) - rms_db(plain.run(24000)[0]) == Approx(-6).margin(0.001));
}

TEST_CASE("Friction by eq. 6 agrees with crumpling by eq. 5 within 0.5 dB in wide bands over random geometries") {
  constexpr std::size_t kLength = 20 * 48000;
  constexpr int kSize = 4096;
  dsp::Random random(21);
  PackOptions options;
  options.unit = noise_unit(kLength, 4);
  options.friction_db = -20;
  for (int geometry = 0; geometry < 10; ++geometry) {
    const double height_m = std::pow(10, random.uniform(-2, 0.3));
    rustle::sheet::Vec3d normal{random.normal(), random.normal(), random.normal()};
    const auto resonator = bent_resonator({0, 0, height_m}, normal.normalized());
    spatial::Listener listener = above();
    listener.position_m = {random.uniform(-2, 2), random.uniform(-2, 2), random.uniform(0.05, 2)};
    const IdentifiedPlane table{1, {}};
    Rig noise(options), units(options);
    for (Rig* rig : {&noise, &units}) {
      rig->planner.listener(listener, 0, 0, rig->cues);
      rig->planner.planes(std::span(&table, 1), 0, 0, rig->cues);
    }
    noise.hold({slide(1, 0.1, {resonator})}, 21);
    auto o = units.frame(0, 0.1);
    o.crumpling = {flap(1, 0, make_pack({})->crumpling->reference_amplitude_m(kBent), {resonator})};
    units.planner.plan(o, 0, units.cues);
    noise.hand_over();
    units.hand_over();
    const auto mean_power = [&](const std::vector<float>& x) {
      dsp::RealFft fft(kSize);
      std::vector<float> window(kSize);
      dsp::hann_window(window);
      std::vector<double> power(kSize / 2 + 1);
      for (std::size_t from = 9600; from + kSize + 9600 < kLength; from += kSize / 2) {
        for (std::size_t n = 0; n < kSize; ++n) fft.time()[n] = window[n] * x[from + n];
        fft.forward();
        for (std::size_t k = 0; k < power.size(); ++k) power[k] += std::norm(fft.spectrum()[k]);
      }
      return power;
    };
    const auto a = mean_power(noise.run(kLength)[0]), b = mean_power(units.run(kLength)[0]);
    std::vector<double> difference, level;
    for (double centre = 800; centre < 8500; centre *= std::cbrt(2.0)) {
      const auto from = static_cast<std::size_t>(centre / std::pow(2, 1.0 / 6) / 48000 * kSize);
      const auto to = static_cast<std::size_t>(centre * std::pow(2, 1.0 / 6) / 48000 * kSize);
      double pa = 0, pb = 0;
      for (std::size_t k = from; k < to; ++k) {
        pa += a[k];
        pb += b[k];
      }
      difference.push_back(10 * std::log10(pa / pb));
      level.push_back(10 * std::log10(pb));
    }
    const double loudest = *std::max_element(level.begin(), level.end());
    for (std::size_t band = 0; band < level.size(); ++band) {
      INFO("geometry " << geometry << " height " << height_m << " band " << band << " level " << level[band] - loudest);
      if (level[band] > loudest - 20) CHECK(std::abs(difference[band]) < 0.5);
    }
  }
}

TEST_CASE("An extended source has the power of its transfer function in both channels") {
  constexpr std::size_t kLength = 20 * 48000;
  constexpr int kSize = 2048;
  PackOptions options;
  options.friction_db = -20;
  Rig rig(options);
  auto resonator = bent_resonator({0, 0, 0.04});
  resonator.covariance_m2(2, 2) = 0.012 * 0.012;
  spatial::Listener listener = above();
  listener.position_m = {0, std::cos(M_PI / 6), std::sin(M_PI / 6)};
  const IdentifiedPlane table{1, {}};
  rig.planner.listener(listener, 0, 0, rig.cues);
  rig.planner.planes(std::span(&table, 1), 0, 0, rig.cues);
  rig.hold({slide(1, 0.1, {resonator})}, 21);
  rig.hand_over();
  const auto x = rig.run(kLength)[0];
  std::vector<double> power(kSize / 2 + 1);
  dsp::RealFft fft(kSize);
  std::vector<float> window(kSize);
  dsp::hann_window(window);
  int blocks = 0;
  for (std::size_t from = 9600; from + kSize < kLength; from += kSize / 2, ++blocks) {
    for (std::size_t n = 0; n < kSize; ++n) fft.time()[n] = window[n] * x[from + n];
    fft.forward();
    for (std::size_t k = 0; k < power.size(); ++k) power[k] += std::norm(fft.spectrum()[k]) / (0.375 * kSize);
  }
  spatial::Emitter emitter;
  emitter.position_m = resonator.position_m;
  emitter.covariance_m2 = resonator.covariance_m2;
  spatial::Receiver receiver;
  receiver.position_m = listener.position_m;
  std::array<spatial::Path, 2> ways;
  spatial::paths(emitter, receiver, receiver.position_m, std::span(&table.plane, 1), ways);
  for (double centre = 400; centre < 16000; centre *= std::sqrt(2.0)) {
    double heard = 0, expected = 0;
    for (auto k = static_cast<std::size_t>(centre / 48000 * kSize);
         k < static_cast<std::size_t>(1.41 * centre / 48000 * kSize); ++k) {
      heard += power[k] / blocks;
      expected += 0.01 * std::pow(spatial::magnitude(ways, static_cast<double>(k) * 48000 / kSize), 2);
    }
    CHECK(10 * std::log10(heard / expected) == Approx(0).margin(0.5));
  }
}

TEST_CASE("A listener that moves past a tone over a table does not click") {
  constexpr std::size_t kLength = 65536;
  PackOptions options;
  options.unit.resize(2 * kLength);
  for (std::size_t n = 0; n < options.unit.size(); ++n) {
    options.unit[n] = 0.1F * static_cast<float>(std::sin(2 * M_PI * 1000 * static_cast<double>(n) / 48000));
  }
  Rig rig(options, Mode::kCorrected, spatial::Layout::kStereo);
  const IdentifiedPlane table{1, {}};
  rig.planner.planes(std::span(&table, 1), 0, 0, rig.cues);
  auto o = rig.frame(0, 0.1);
  o.crumpling = {flap(1, 0, 0.1, {bent_resonator({0, 0, 0.2}, {0.8, 0, 0.6})})};
  rig.planner.plan(o, 0, rig.cues);
  for (int frame = 1; frame <= 120; ++frame) {
    const double t = frame / 60.0;
    spatial::Listener listener = above();
    listener.position_m = {1.2 * std::cos(2 * t), 1.2 * std::sin(2 * t), 0.8 + 0.3 * std::sin(5 * t)};
    listener.forward = spatial::normalized(-listener.position_m, {0, 0, -1});
    listener.up = {0, 0, 1};
    rig.planner.listener(listener, t, 0, rig.cues);
  }
  rig.hand_over();
  rig.run(9600);
  const auto x = rig.run(kLength);
  for (const auto& channel : x) {
    dsp::RealFft fft(static_cast<int>(kLength));
    std::vector<float> window(kLength);
    dsp::hann_window(window);
    for (std::size_t n = 0; n < kLength; ++n) fft.time()[n] = window[n] * channel[n];
    fft.forward();
    double inside = 0, outside = 0;
    for (std::size_t k = 0; k < fft.spectrum().size(); ++k) {
      const double f = static_cast<double>(k) * 48000 / kLength;
      (std::abs(f - 1000) < 150 ? inside : outside) += std::norm(fft.spectrum()[k]);
    }
    CHECK(10 * std::log10(outside / inside) < -60);
  }
}

TEST_CASE("A listener that jumps, a plane that comes and goes: the tone is cross-faded, not cut") {
  PackOptions options;
  options.unit.resize(96000);
  for (std::size_t n = 0; n < options.unit.size(); ++n) {
    options.unit[n] = 0.1F * static_cast<float>(std::sin(2 * M_PI * 200 * static_cast<double>(n) / 48000));
  }
  Rig rig(options);
  const IdentifiedPlane table{1, {}};
  auto o = rig.frame(0, 0.1);
  o.crumpling = {flap(1, 0, make_pack({})->crumpling->reference_amplitude_m(kBent), {bent_resonator({0, 0, 0.3})})};
  rig.planner.plan(o, 0, rig.cues);
  rig.planner.planes(std::span(&table, 1), 0.3, 0, rig.cues);
  spatial::Listener far = above();
  far.position_m = {2, 0, 1.5};
  rig.planner.listener(far, 0.6, 24000, rig.cues);
  rig.planner.planes({}, 0.9, 36000, rig.cues);
  rig.hand_over();
  const auto x = rig.run(72000)[0];
  float loudest = 0, steepest = 0;
  for (std::size_t n = 1; n < x.size(); ++n) {
    loudest = std::max(loudest, std::abs(x[n]));
    steepest = std::max(steepest, std::abs(x[n] - x[n - 1]));
  }
  CHECK(steepest < 1.3F * loudest * 2 * static_cast<float>(M_PI) * 200 / 48000);
}

TEST_CASE("Cues with extreme values leave every sample finite") {
  PackOptions options;
  options.unit = noise_unit(4800, 5);
  Rig rig(options, Mode::kCorrected, spatial::Layout::kStereo);
  const double inf = std::numeric_limits<double>::infinity(), nan = std::nan("");
  std::uint64_t id = 1;
  for (const double v : {0.0, 1e-300, 1e-9, 1.0, 1e9, 1e100, inf, nan}) {
    spatial::Listener listener = above();
    listener.position_m = {v, -v, v};
    rig.planner.listener(listener, 0.01 * static_cast<double>(id), rig.now, rig.cues);
    IdentifiedPlane plane{id, {{v, 0, 0}, {0, 0, 1}, v}};
    rig.planner.planes(std::span(&plane, 1), 0.01 * static_cast<double>(id), rig.now, rig.cues);
    auto resonator = bent_resonator({v, v, 0}, {v, 0, v});
    resonator.area_m2 = resonator.disc_radius_m = resonator.normal_spread = v;
    resonator.covariance_m2.setConstant(v);
    auto o = rig.frame(0.01 * static_cast<double>(id), 0.01 * static_cast<double>(id + 1));
    o.crumpling = {flap(id, 0.01 * static_cast<double>(id), v, {resonator}), flap(id + 100, v, 0.1, {resonator})};
    o.friction = {slide(id, v, {resonator}), slide(id + 100, 0.1, {resonator})};
    rig.planner.plan(o, rig.now, rig.cues);
    rig.hand_over();
    for (const auto& channel : rig.run(960)) {
      CHECK(std::all_of(channel.begin(), channel.end(), [](float x) { return std::isfinite(x); }));
    }
    ++id;
  }
  for (const auto& channel : rig.run(24000)) {
    CHECK(std::all_of(channel.begin(), channel.end(), [](float x) { return std::isfinite(x); }));
  }
  CHECK(rig.mixer.counters().cues_dropped > 0);
}

TEST_CASE("Cues for a bus that is not there are dropped and counted") {
  Rig rig;
  GainCue gain;
  gain.bus = 1000;
  rig.mixer.apply(gain);
  PlaneCue plane;
  plane.slot = 16;
  rig.mixer.apply(plane);
  CHECK(rig.mixer.counters().cues_dropped == 2);
}

}  // namespace mixer_test
