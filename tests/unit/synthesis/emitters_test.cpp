#include "server/synthesis/emitter_sounds.h"

#include <catch2/catch.hpp>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <map>
#include <span>

#include "server/synthesis/interpolation.h"
#include "sound_db/dsp/random.h"
#include "tests/unit/synthesis/rig.h"

namespace emitters_test {

using namespace rustle::synthesis;
using namespace rustle::synthesis::rig;
namespace spatial = rustle::spatial;
namespace dsp = rustle::dsp;

namespace {

std::vector<float> noise_unit(std::size_t samples, std::uint64_t seed) {
  dsp::Random random(seed);
  std::vector<float> unit(samples);
  for (float& x : unit) x = static_cast<float>(0.1 * random.normal());
  return unit;
}

/// One emitter's sound on the sample axis from 0 on.
struct Heard {
  Bus bus = 0;
  std::vector<float> samples;
  spatial::Vec3 position_m, normal;  ///< the newest
  SampleTime first = 0;
  int ends = 0;
  bool after_end = false;  ///< more came after it had ended
};
using Emitters = std::map<std::uint64_t, Heard>;

/// Renders the mix, mono or left, and every emitter.
std::vector<float> listen(Rig& rig, EmitterSounds& sounds, SampleTime samples, Emitters& emitters) {
  std::vector<float> mix;
  for (const SampleTime end = rig.now + samples; rig.now < end; rig.now += kQuantum) {
    rig.mixer.render(rig.now, rig.quantum, &sounds);
    mix.resize(mix.size() + kQuantum);
    for (int bus = 0; bus < rig.mixer.buses(); ++bus) {
      if (!rig.mixer.sounding(static_cast<Bus>(bus))) continue;
      const float* from = rig.quantum.data() + static_cast<std::ptrdiff_t>(bus * rig.mixer.channels() * kQuantum);
      for (std::size_t n = 0; n < kQuantum; ++n) mix[mix.size() - kQuantum + n] += from[n];
    }
    for (const EmitterSound& sound : sounds.sounds()) {
      auto [entry, fresh] = emitters.try_emplace(sound.id);
      Heard& heard = entry->second;
      if (fresh) heard.first = rig.now;
      heard.bus = sound.bus;
      heard.position_m = sound.position_m;
      heard.normal = sound.normal;
      heard.after_end |= heard.ends > 0;
      if (sound.last) {
        ++heard.ends;
        continue;
      }
      heard.samples.resize(static_cast<std::size_t>(rig.now));
      heard.samples.insert(heard.samples.end(), sound.samples.begin(), sound.samples.end());
    }
  }
  return mix;
}

/// What a listener hears of a dry sound, by the same dipole and reading between samples.
std::vector<float> spatialized(const std::vector<float>& dry, const spatial::Emitter& emitter, const spatial::Vec3& at_m,
                               std::span<const spatial::Plane> planes, std::size_t length) {
  std::array<spatial::Path, spatial::kMaxPaths> paths;
  const std::size_t count = spatial::paths(emitter, {at_m}, at_m, planes, paths);
  std::vector<float> out(length);
  const auto x = [&](std::int64_t i) {
    return i >= 0 && i < static_cast<std::int64_t>(dry.size()) ? dry[static_cast<std::size_t>(i)] : 0.0F;
  };
  for (std::size_t p = 0; p < count; ++p) {
    const auto delay = static_cast<Position>(std::nearbyint(paths[p].delay_s * 48000 * static_cast<double>(kWholeSample)));
    const auto w = weights(-delay & (kWholeSample - 1), static_cast<float>(paths[p].gain));
    for (std::size_t n = 0; n < length; ++n) {
      const std::int64_t i = static_cast<std::int64_t>(n) + (-delay >> 32);
      for (std::int64_t k = 0; k < 4; ++k) out[n] += w[static_cast<std::size_t>(k)] * x(i - 1 + k);
    }
  }
  return out;
}

float largest_difference(const std::vector<float>& a, const std::vector<float>& b) {
  REQUIRE(a.size() == b.size());
  float most = 0;
  for (std::size_t n = 0; n < a.size(); ++n) most = std::max(most, std::abs(a[n] - b[n]));
  return most;
}

float peak(const std::vector<float>& x) {
  float most = 0;
  for (const float sample : x) most = std::max(most, std::abs(sample));
  return most;
}

}  // namespace

TEST_CASE("A crumple's dry sound, spatialized anew by the dipole above its planes, is the mix") {
  PackOptions options;
  options.unit = noise_unit(7000, 3);
  spatial::Listener listener = above();
  listener.position_m = {0.4, -0.7, 1.1};
  Rig rig(options, Mode::kCorrected, spatial::Layout::kMono, 512, listener);
  const std::array<IdentifiedPlane, 2> planes{IdentifiedPlane{1, {{0, 0, 0}, {0, 0, 1}, 0.9}},
                                              IdentifiedPlane{2, {{-2, 0, 0}, {1, 0, 0}, 0.5}}};
  rig.planner.planes(planes, 0, 0, rig.cues);
  rig.hand_over();
  rig.run(9600);  // planes fade in
  auto o = rig.frame(0.2, 0.3);
  o.crumpling = {flap(1, 0.25, 0.1, {bent_resonator({0.1, 0.2, 0.3}, rustle::sheet::Vec3d(0.2, 0.3, 0.9).normalized())})};
  rig.planner.plan(o, rig.now, rig.cues);
  rig.hand_over();
  EmitterSounds sounds(rig.render_options);
  Emitters emitters;
  const SampleTime began = rig.now;
  const auto mix = listen(rig, sounds, 24000, emitters);
  REQUIRE(emitters.size() == 1);
  const auto& [id, heard] = *emitters.begin();
  CHECK(heard.bus == bus_of(0, SoundKind::kCrumpling));
  CHECK(heard.first == 12000 / kQuantum * kQuantum);
  CHECK(heard.ends == 1);
  CHECK_FALSE(heard.after_end);
  CHECK(heard.position_m == spatial::Vec3(0.1, 0.2, 0.3));
  spatial::Emitter emitter;
  emitter.position_m = heard.position_m;
  emitter.normal = heard.normal;
  const std::array<spatial::Plane, 2> walls{planes[0].plane, planes[1].plane};
  auto again = spatialized(heard.samples, emitter, listener.position_m, walls, 24000 + static_cast<std::size_t>(began));
  again.erase(again.begin(), again.begin() + began);
  CHECK(peak(mix) > 0.01F);
  CHECK(largest_difference(again, mix) < 1e-5F * peak(mix));
}

TEST_CASE("A contact's dry noise times the dipole's gain is the mix") {
  PackOptions options;
  options.gain_sigma = 0.35;
  spatial::Listener listener = above();
  listener.position_m = {0.4, -0.7, 1.1};
  for (const Mode mode : {Mode::kCorrected, Mode::kPublished}) {
    Rig rig(options, mode, spatial::Layout::kMono, 512, listener);
    const auto resonator = bent_resonator({0.1, 0.2, 0.3}, {0, 0, 1});
    rig.hold({slide(1, 0.1, {resonator})}, 1);
    rig.hand_over();
    EmitterSounds sounds(rig.render_options);
    Emitters emitters;
    const auto mix = listen(rig, sounds, 96000, emitters);
    REQUIRE(emitters.size() == 1);
    Heard& heard = emitters.begin()->second;
    CHECK(heard.bus == bus_of(0, SoundKind::kFriction));
    CHECK(heard.ends == 1);
    CHECK_FALSE(heard.after_end);
    CHECK(rms_db({heard.samples.begin() + 4800, heard.samples.begin() + 43200}) > -45);
    spatial::Emitter emitter;
    emitter.position_m = heard.position_m;
    emitter.normal = heard.normal;
    emitter.cosine_floor = 0;
    std::array<spatial::Path, spatial::kMaxPaths> paths;
    spatial::paths(emitter, {listener.position_m}, listener.position_m, {}, paths);
    heard.samples.resize(mix.size());
    for (float& x : heard.samples) x *= static_cast<float>(paths[0].gain);
    CHECK(largest_difference(heard.samples, mix) < 1e-5F * peak(mix));
  }
}

TEST_CASE("Listening to emitters changes no sample of the mix, whenever it begins and ends") {
  PackOptions options;
  options.unit = noise_unit(9000, 5);
  options.gain_sigma = 0.35;
  std::vector<float> wanted;
  for (const bool listened : {false, true}) {
    Rig rig(options, Mode::kCorrected, spatial::Layout::kStereo);
    const IdentifiedPlane table{1, {}};
    rig.planner.planes(std::span(&table, 1), 0, 0, rig.cues);
    rig.hold({slide(1, 0.1), slide(2, 0.2, {bent_resonator({0.2, 0, 0.1})})}, 1.5);
    auto o = rig.frame(0, 0.1);
    for (std::uint64_t k = 0; k < 40; ++k)
      o.crumpling.push_back(flap(k + 1, 0.03 * static_cast<double>(k), 0.1, {bent_resonator({0, 0, 0.01 * double(k)})}));
    rig.planner.plan(o, 0, rig.cues);
    rig.hand_over();
    EmitterSounds sounds(rig.render_options);
    std::vector<float> mix;
    for (; rig.now < 96000; rig.now += kQuantum) {
      const bool now = listened && (rig.now / 9600) % 2 == 1;
      rig.mixer.render(rig.now, rig.quantum, now ? &sounds : nullptr);
      for (int bus = 0; bus < rig.mixer.buses(); ++bus) {
        const auto from = rig.quantum.begin() + bus * 2 * kQuantum;
        if (rig.mixer.sounding(static_cast<Bus>(bus))) mix.insert(mix.end(), from, from + 2 * kQuantum);
      }
    }
    if (!listened) {
      wanted = mix;
    } else {
      REQUIRE(mix.size() == wanted.size());
      CHECK(std::memcmp(mix.data(), wanted.data(), mix.size() * sizeof(float)) == 0);
      CHECK(peak(mix) > 0.001F);
    }
  }
}

TEST_CASE("Slips of a contact come from the contact, and buses' gains are heard in emitters too") {
  std::vector<float> loud;
  for (const double gain_db : {0.0, -20.0}) {
    Rig rig(PackOptions{});
    rig.planner.gains({{gain_db, {}, {}, ""}}, 0, rig.cues);
    auto o = rig.frame(0, 0.2);
    for (const double speed : {0.0001, 0.0001, 0.2, 0.2}) {
      o.friction = {slide(1, speed)};
      rig.planner.plan(o, 0, rig.cues);
      o.previous_time_s = o.time_s;
      o.time_s += 0.2;
    }
    rig.hand_over();
    EmitterSounds sounds(rig.render_options);
    Emitters emitters;
    listen(rig, sounds, 30000, emitters);
    REQUIRE(emitters.size() == 1);
    CHECK(emitters.begin()->second.bus == bus_of(0, SoundKind::kFriction));
    auto& samples = emitters.begin()->second.samples;
    if (loud.empty()) {
      loud = samples;
      continue;
    }
    const std::size_t settled = 4800;
    CHECK(rms_db(samples, settled) - rms_db(loud, settled) == Approx(-20).margin(0.01));
  }
}

TEST_CASE("Emitters beyond what there is room for are left out and counted") {
  PackOptions options;
  options.unit = noise_unit(6400, 5);
  Rig rig(options);
  constexpr std::size_t kEvents = kMostEmitters + 44;
  for (std::size_t k = 0; k < kEvents; ++k) {
    CrumpleCue cue;
    cue.start = cue.onset = 64;
    cue.event = k;
    cue.unit = options.unit.data();
    cue.unit_samples = static_cast<std::uint32_t>(options.unit.size());
    cue.gain = 0.1F;
    rig.mixer.apply(cue);
  }
  EmitterSounds sounds(rig.render_options);
  Emitters emitters;
  listen(rig, sounds, 12800, emitters);
  CHECK(emitters.size() == kMostEmitters);
  for (const auto& [id, heard] : emitters) {
    CHECK(heard.ends == 1);
    CHECK(heard.samples.size() == 64 + 6400);
  }
  CHECK(sounds.take_left_out() == 44 * 6400);
}

}  // namespace emitters_test
