#include <catch2/catch.hpp>

#include "server/synthesis/emitter_sounds.h"
#include "server/synthesis/limiter.h"
#include "tests/support/counted_allocations.h"
#include "tests/unit/synthesis/rig.h"

namespace allocation_test {

using namespace rustle::synthesis;
using namespace rustle::synthesis::rig;

TEST_CASE("Taking cues and rendering allocate nothing, stealing, overflow and emitters included") {
  PackOptions options;
  options.unit.assign(9600, 0.01F);
  options.gain_sigma = 0.35;
  Rig rig(options, Mode::kCorrected, rustle::spatial::Layout::kStereo, 16);
  const IdentifiedPlane table{1, {}};
  rig.planner.planes(std::span(&table, 1), 0, 0, rig.cues);
  for (std::uint64_t frame = 1; frame <= 30; ++frame) {
    auto o = rig.frame(static_cast<double>(frame - 1) / 60, static_cast<double>(frame) / 60);
    for (std::uint64_t k = 0; k < 150; ++k) {
      o.crumpling.push_back(flap(1000 * frame + k, o.previous_time_s, 0.01 * static_cast<double>(k + 1)));
      o.friction.push_back(slide(k + 1, 0.1 + 0.001 * static_cast<double>(frame)));
    }
    for (std::uint64_t k = 0; k < 20; ++k) {
      rustle::observation::TearEvent tear;
      tear.id = k + 1 + 7 * (frame / 10);
      tear.speed_m_per_s = frame % 3 == 0 ? 0 : 0.2;
      tear.position_m = {0.01 * static_cast<double>(frame), 0, 0.01};
      tear.resonators = {bent_resonator()};
      o.tears.push_back(tear);
    }
    rig.planner.plan(o, 0, rig.cues);
  }
  rig.planner.release(INT64_MAX, rig.cues);
  Limiter limiter(48000);
  EmitterSounds emitters(rig.render_options);
  float* channels[] = {rig.quantum.data(), rig.quantum.data() + kQuantum};
  const int allocations = rustle::test_support::allocations_of([&] {
    for (int k = 0; k < 600; ++k, rig.now += kQuantum) {
      for (const Cue& cue : rig.cues) {
        if (start_of(cue) >= rig.now && start_of(cue) < rig.now + kQuantum) rig.mixer.apply(cue);
      }
      rig.mixer.render(rig.now, rig.quantum, k % 3 == 0 ? nullptr : &emitters);
      limiter.process(channels, kQuantum);
      (void)rig.mixer.silent();
    }
    for (const Cue& cue : rig.cues) rig.mixer.apply(cue);
    rig.mixer.render(rig.now, rig.quantum);
  });
  CHECK(allocations == 0);
  CHECK(emitters.sounds().size() > 100);
  CHECK(rig.mixer.counters().voices_stolen > 0);
  CHECK(rig.mixer.counters().sources_dropped > 0);
  CHECK(rig.mixer.counters().cues_dropped > 0);
}

}  // namespace allocation_test
