#include "server/synthesis/stick_slip.h"

#include <catch2/catch.hpp>

#include <algorithm>
#include <functional>

#include "sound_db/dsp/statistics.h"
#include "tests/unit/synthesis/rig.h"

namespace stick_slip_test {

using namespace rustle::synthesis;
using namespace rustle::synthesis::rig;

namespace {

/// A sheet that rests for half a second, or is not there yet, and then slides at 0.1 m/s.
std::vector<float> setting_off(bool rests, std::uint64_t contact = 1, Mode mode = Mode::kCorrected) {
  Rig rig({}, mode);
  double before = 0;
  for (int frame = 0; frame <= 120; ++frame) {
    const double time = frame / 60.0;
    auto o = rig.frame(before, time);
    if (frame > 30) {
      o.friction = {slide(contact, 0.1)};
    } else if (rests) {
      o.friction = {slide(contact, 0.0005)};
    }
    rig.planner.plan(o, 0, rig.cues);
    before = time;
  }
  rig.hand_over();
  return rig.run(96000)[0];
}

constexpr std::size_t kSetsOff = 24000;

double db_of(const std::vector<float>& x, std::size_t from, std::size_t count) {
  return rustle::dsp::rms_dbfs(std::span(x).subspan(from, count));
}

}  // namespace

TEST_CASE("A sheet that stuck comes loose in slips; then it slides as if it had never stuck") {
  const auto stuck = setting_off(true), arrived = setting_off(false);
  CHECK(db_of(stuck, kSetsOff, 1200) > db_of(arrived, kSetsOff, 1200) + 3);
  std::vector<float> slipping(stuck.size());
  std::transform(stuck.begin(), stuck.end(), arrived.begin(), slipping.begin(), std::minus<>());
  CHECK(rustle::dsp::kurtosis(std::span(slipping).subspan(kSetsOff, 2880)) > 6);
  constexpr std::size_t kAfter = kSetsOff + 4800;
  CHECK(db_of(slipping, kAfter, 60000) < db_of(arrived, kAfter, 60000) - 40);
  CHECK(stuck == setting_off(true));
}

TEST_CASE("Stick-slip is none of the published formulas, and no sheet that slides already has it") {
  CHECK(db_of(setting_off(true, 1, Mode::kPublished), kSetsOff, 1200) ==
        Approx(db_of(setting_off(false, 1, Mode::kPublished), kSetsOff, 1200)).margin(1.5));
  Rig rig;
  rig.hold({slide(1, 0.1)}, 1);
  CHECK(std::none_of(rig.cues.begin(), rig.cues.end(),
                     [](const Cue& cue) { return std::holds_alternative<CrumpleCue>(cue); }));
}

TEST_CASE("A contact slips once each time it comes loose, however its speed trembles") {
  Rig rig;
  double before = 0;
  int slipped = 0;
  for (int frame = 0; frame < 60; ++frame) {
    const double time = frame / 60.0;
    auto o = rig.frame(before, time);
    const double speeds[] = {0.0, 0.004, 0.006, 0.004, 0.1};
    o.friction = {slide(1, frame < 50 ? speeds[frame % 5] : 0.1)};
    rig.cues.clear();
    rig.planner.plan(o, 0, rig.cues);
    slipped += std::any_of(rig.cues.begin(), rig.cues.end(),
                           [](const Cue& cue) { return std::holds_alternative<CrumpleCue>(cue); });
    before = time;
  }
  CHECK(slipped == 10);
}

TEST_CASE("Slips get weaker and end within their time, and others come from another seed") {
  const auto some = slips(5, 48000), same = slips(5, 48000), others = slips(6, 48000);
  CHECK(some.size() >= 4);
  CHECK(some.front().after == 0);
  for (std::size_t k = 0; k < some.size(); ++k) {
    CHECK(some[k].after == same[k].after);
    CHECK(some[k].after < 2400);
    if (k > 0) CHECK(some[k].gain < some[k - 1].gain);
    if (k > 0) CHECK(some[k].after - some[k - 1].after >= 192);
  }
  CHECK((some.size() != others.size() || some[1].after != others[1].after));
}

}  // namespace stick_slip_test
