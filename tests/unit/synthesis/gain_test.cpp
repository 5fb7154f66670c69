#include "server/synthesis/gain.h"

#include <algorithm>
#include <catch2/catch.hpp>
#include <cmath>
#include <limits>
#include <numbers>

#include "sound_db/dsp/fft.h"
#include "sound_db/dsp/random.h"
#include "sound_db/dsp/window.h"
#include "tests/unit/synthesis/rig.h"

namespace gain_test {

using namespace rustle::synthesis;
using namespace rustle::synthesis::rig;
namespace dsp = rustle::dsp;

namespace {

constexpr double kSilence_db = -std::numeric_limits<double>::infinity();
constexpr double kTone_hz = 1000;

PackOptions tone(double seconds) {
  PackOptions options;
  std::vector<float>& unit = options.unit;
  unit.resize(static_cast<std::size_t>(seconds * 48000));
  for (std::size_t n = 0; n < unit.size(); ++n)
    unit[n] = 0.1F * static_cast<float>(std::sin(2 * std::numbers::pi * kTone_hz * static_cast<double>(n) / 48000));
  return options;
}

/// A rig in which a tone sounds from the beginning on.
struct Toning : Rig {
  explicit Toning(double seconds) : Rig(tone(seconds)) {
    auto o = frame(0, 0.01);
    o.crumpling = {flap(1, 0, 0.1)};
    planner.plan(o, 0, cues);
    hand_over();
  }
};

/// Power more than 150 Hz away from the tone over the tone's, in the worst third of a second in which there is one.
double spurious_db(const std::vector<float>& heard) {
  constexpr std::size_t kSize = 16384;
  dsp::RealFft fft(static_cast<int>(kSize));
  std::vector<float> window(kSize);
  dsp::hann_window(window);
  double worst = 0, loudest = 0;
  for (std::size_t from = 4800; from + kSize <= heard.size(); from += kSize / 4) {
    for (std::size_t n = 0; n < kSize; ++n) fft.time()[n] = window[n] * window[n] * heard[from + n];
    fft.forward();
    double inside = 0, outside = 0;
    for (std::size_t k = 0; k < fft.spectrum().size(); ++k) {
      const double f = static_cast<double>(k) * 48000 / static_cast<double>(kSize);
      (std::abs(f - kTone_hz) < 150 ? inside : outside) += std::norm(fft.spectrum()[k]);
    }
    worst = std::max(worst, outside);
    loudest = std::max(loudest, inside);
  }
  return 10 * std::log10(worst / loudest);
}

}  // namespace

TEST_CASE("A sound has the product of all gains that concern it") {
  const std::vector<Gain> gains{{-6, {}, {}, ""},
                                {-3, 1, {}, ""},
                                {-2, {}, SoundKind::kFriction, ""},
                                {-1, {}, {}, "kraft"},
                                {4, 2, SoundKind::kCrumpling, ""},
                                {8, 2, SoundKind::kFriction, "kraft"}};
  CHECK(gain_db_of(gains, 1, SoundKind::kFriction, "kraft") == -12);
  CHECK(gain_db_of(gains, 1, SoundKind::kCrumpling, "kraft") == -10);
  CHECK(gain_db_of(gains, 2, SoundKind::kCrumpling, "silk") == -2);
  CHECK(gain_db_of(gains, 2, SoundKind::kFriction, "kraft") == -1);
  CHECK(gain_db_of(gains, 2, SoundKind::kFriction, "silk") == -8);
  CHECK(gain_db_of({}, 2, SoundKind::kFriction, "silk") == 0);
  const std::vector<Gain> loud(5, Gain{kMostGain_db, {}, {}, ""});
  CHECK(gain_db_of(loud, 1, SoundKind::kTearing, "") == kMostGainsSum_db);
  const std::vector<Gain> mixed{{kSilence_db, {}, {}, ""}, {24, {}, {}, ""}};
  CHECK(gain_db_of(mixed, 1, SoundKind::kTearing, "") == kSilence_db);
}

TEST_CASE("A gain takes the place of the one for the same sounds, and 0 dB takes it away") {
  const std::vector<Gain> before{{-6, {}, {}, ""}, {-3, 1, {}, ""}, {2, 1, SoundKind::kFriction, ""}};
  const std::vector<Gain> changes{{-4, 1, {}, ""}, {0, {}, {}, ""}, {5, 1, {}, "kraft"}, {7, 1, {}, "kraft"}};
  CHECK(changed(before, changes) ==
        std::vector<Gain>{{-4, 1, {}, ""}, {2, 1, SoundKind::kFriction, ""}, {7, 1, {}, "kraft"}});
  CHECK(changed(before, {}) == before);
  CHECK(changed({}, std::vector<Gain>{{0, 3, {}, ""}}).empty());
}

TEST_CASE("A gain that changes is reached in 20 ms, from its sample on and not before") {
  Toning plain(1), turned(1);
  const SampleTime at = 9600 + 64, ramp = static_cast<SampleTime>(kGainRamp_s * 48000);
  turned.planner.gains({{-6, 1, SoundKind::kCrumpling, "test-paper"}}, at, turned.cues);
  turned.hand_over();
  const auto before = plain.run(24000)[0], after = turned.run(24000)[0];
  const double goal = dsp::db_to_gain(-6);
  for (std::size_t n = 0; n < before.size(); ++n) {
    const auto time = static_cast<SampleTime>(n);
    if (time <= at) REQUIRE(after[n] == before[n]);
    const double t = std::clamp(static_cast<double>(time - at) / static_cast<double>(ramp), 0.0, 1.0);
    const double wanted = 1 + (goal - 1) * t * t * (3 - 2 * t);
    if (time > at) REQUIRE(after[n] == Approx(wanted * before[n]).margin(1e-6));
  }
}

TEST_CASE("Gains that change at any time, into silence and in the middle of a change, make no click") {
  Toning rig(13);
  dsp::Random random(3);
  std::vector<float> heard;
  for (int change = 0; heard.size() < 12 * 48000; ++change) {
    const double gain_db = change % 5 == 4 ? kSilence_db : random.uniform(-40, 6);
    rig.planner.gains({{gain_db, {}, {}, ""}}, rig.now, rig.cues);
    rig.hand_over();
    const double pause_s = change % 3 == 0 ? 0.01 : random.uniform(0.02, 0.4);
    const auto more = rig.run(static_cast<SampleTime>(pause_s * 48000));
    heard.insert(heard.end(), more[0].begin(), more[0].end());
  }
  CHECK(spurious_db(heard) < -60);
  // The measure hears a click: a step of 1 dB.
  auto steady = Toning(3).run(96000)[0];
  CHECK(spurious_db(steady) < -100);
  for (std::size_t n = 48012; n < steady.size(); ++n) steady[n] *= 0.89F;
  CHECK(spurious_db(steady) > -60);
}

TEST_CASE("A gain that is overtaken on its way, or told late, is still reached smoothly") {
  Toning plain(1), turned(1);
  plain.run(9600);
  turned.run(9600);
  for (const double gain_db : {-3.0, kSilence_db, -12.0}) {  // all for a sample that has been rendered
    turned.planner.gains({{gain_db, {}, {}, ""}}, 4800, turned.cues);
    turned.hand_over();
    if (gain_db != -3.0) continue;
    turned.run(64);
    plain.run(64);
  }
  const auto before = plain.run(9600)[0], after = turned.run(9600)[0];
  double last = 1;
  for (std::size_t n = 0; n < before.size(); ++n) {
    if (std::abs(before[n]) < 0.02F) continue;
    const double gain = static_cast<double>(after[n]) / static_cast<double>(before[n]);
    REQUIRE(gain <= last + 1e-5);  // down to -3 dB, from there to -12, and never to silence
    last = gain;
    if (n > 2 * 960) REQUIRE(gain == Approx(dsp::db_to_gain(-12)).epsilon(1e-4));
    if (n > 2 * 960 + 64) break;
  }
}

TEST_CASE("A silenced sheet is exactly silent, and comes back") {
  Toning rig(3);
  rig.run(4800);
  rig.planner.gains({{kSilence_db, 1, {}, ""}}, rig.now, rig.cues);
  rig.hand_over();
  rig.run(960);
  const auto silent = rig.run(4800)[0];
  for (const float x : silent) REQUIRE(x == 0);
  rig.planner.gains({}, rig.now, rig.cues);
  rig.hand_over();
  rig.run(960);
  CHECK(rms_db(rig.run(4800)[0]) == Approx(rms_db(Toning(3).run(14400)[0], 9600)).margin(0.1));
}

}  // namespace gain_test
