#include <catch2/catch.hpp>

#include <algorithm>
#include <cmath>
#include <complex>

#include "sound_db/dsp/statistics.h"
#include "tests/unit/synthesis/rig.h"

namespace friction_test {

using namespace rustle::synthesis;
using namespace rustle::synthesis::rig;
namespace spatial = rustle::spatial;
using rustle::observation::FrictionContact;
using rustle::observation::Resonator;

namespace {

constexpr SampleTime kSecond = 48000;

double sliding_db(Rig& rig, const std::vector<FrictionContact>& contacts, double seconds) {
  rig.hold(contacts, seconds + 1);
  rig.hand_over();
  return rms_db(rig.run(static_cast<SampleTime>(seconds * kSecond))[0], 4800);
}

std::vector<FrictionContact> equal_slides(int count) {
  std::vector<FrictionContact> contacts;
  for (int k = 0; k < count; ++k) contacts.push_back(slide(static_cast<std::uint64_t>(k + 1), 0.1));
  return contacts;
}

}  // namespace

TEST_CASE("Sliding at 0.1 m/s has the pack's level at 1 m on the axis; the level follows the speed's law") {
  Rig reference;
  CHECK(sliding_db(reference, {slide(1, 0.1)}, 10) == Approx(-32).margin(0.2));
  Rig twice;
  CHECK(sliding_db(twice, {slide(1, 0.2)}, 10) == Approx(-32 + 6.02).margin(0.3));
  PackOptions rough;
  rough.speed_exponent = 0.75;
  Rig exponent(rough);
  CHECK(sliding_db(exponent, {slide(1, 0.4)}, 10) == Approx(-32 + 0.75 * 12.04).margin(0.3));
}

TEST_CASE("The slow random gain leaves the level and gives the kurtosis of slides") {
  PackOptions rough;
  rough.gain_sigma = 0.35;
  Rig rig(rough);
  rig.hold({slide(1, 0.1)}, 31);
  rig.hand_over();
  const auto x = rig.run(30 * kSecond)[0];
  CHECK(rms_db(x, 4800) == Approx(-32).margin(0.4));
  CHECK(rustle::dsp::kurtosis(std::span(x).subspan(4800)) > 3.8);
  CHECK(rustle::dsp::kurtosis(std::span(x).subspan(4800)) < 6.0);
}

TEST_CASE("Powers of equal sources add; as published their amplitudes do") {
  Rig one, eight;
  const double single_db = sliding_db(one, equal_slides(1), 20);
  CHECK(sliding_db(eight, equal_slides(8), 20) - single_db == Approx(9.03).margin(0.3));
  Rig one_published({}, Mode::kPublished), eight_published({}, Mode::kPublished);
  const double published_db = sliding_db(one_published, equal_slides(1), 5);
  CHECK(sliding_db(eight_published, equal_slides(8), 5) - published_db == Approx(18.06).margin(0.1));
}

TEST_CASE("A contact that is pressed is louder by the root of its load over its own weight; as published it is not") {
  const auto pressed_db = [](double times_its_weight, Mode mode) {
    Rig rig({}, mode);
    FrictionContact contact = slide(1, 0.1);
    contact.area_m2 = 0.01;
    contact.normal_force_n = times_its_weight < 0 ? -1 : times_its_weight * 0.080 * 9.81 * contact.area_m2;
    return sliding_db(rig, {contact}, 5);
  };
  const double free_db = pressed_db(-1, Mode::kCorrected);
  CHECK(pressed_db(1, Mode::kCorrected) == Approx(free_db).margin(0.01));
  CHECK(pressed_db(4, Mode::kCorrected) == Approx(free_db + 6.02).margin(0.01));
  CHECK(pressed_db(1e9, Mode::kCorrected) == Approx(free_db + 30).margin(0.1));
  CHECK(pressed_db(0, Mode::kCorrected) < -200);
  CHECK(pressed_db(4, Mode::kPublished) == Approx(pressed_db(-1, Mode::kPublished)).margin(0.01));
}

TEST_CASE("Resonators of one contact share its power by area") {
  Rig one, many;
  const double single_db = sliding_db(one, {slide(1, 0.1)}, 10);
  std::vector<Resonator> parts(5, bent_resonator());
  parts[0].area_m2 = 0.05;
  CHECK(sliding_db(many, {slide(1, 0.1, parts)}, 10) == Approx(single_db).margin(0.3));
}

TEST_CASE("The level is steady: ripple at the hop rate below 0.3 dB") {
  Rig rig;
  rig.hold({slide(1, 0.1)}, 41);
  rig.hand_over();
  const auto x = rig.run(40 * kSecond)[0];
  constexpr std::size_t kHop = 512;
  std::complex<double> fundamental = 0;
  double power = 0;
  const std::size_t end = x.size() / kHop * kHop;
  for (std::size_t n = 10 * kHop; n < end; ++n) {
    const double square = static_cast<double>(x[n]) * x[n];
    power += square;
    fundamental += square * std::polar(1.0, 2 * M_PI * static_cast<double>(n % kHop) / kHop);
  }
  const double depth = 2 * std::abs(fundamental) / power;
  CHECK(10 * std::log10((1 + depth) / (1 - depth)) < 0.3);
}

TEST_CASE("The size factor is held within 6 dB and does not apply to flat sheets; published it is a³") {
  Resonator large = bent_resonator();
  large.disc_radius_m *= 3;
  Rig bent;
  CHECK(sliding_db(bent, {slide(1, 0.1, {large})}, 5) == Approx(-32 + 6).margin(0.3));
  large.constrained = true;
  Rig flat;
  CHECK(sliding_db(flat, {slide(1, 0.1, {large})}, 5) == Approx(-32).margin(0.3));
  Rig published({}, Mode::kPublished);
  CHECK(sliding_db(published, {slide(1, 0.1, {large})}, 5) == Approx(-32 + 60 * std::log10(3.0)).margin(0.3));
}

TEST_CASE("A contact that ends leaves silence, and so does a sheet that ends or falls silent") {
  for (const int how : {0, 1, 2}) {
    Rig rig;
    rig.hold({slide(1, 0.3)}, 1.0);
    if (how == 0) rig.planner.plan(rig.frame(1.0, 1.02), 0, rig.cues);
    if (how == 1) rig.planner.end_sheet(1, kSecond, rig.cues);
    rig.hand_over();
    const auto sounding = rig.run(kSecond)[0];
    CHECK(rms_db(sounding, kSecond / 2) > -30);
    CHECK_FALSE(rig.mixer.silent());
    rig.run(how == 2 ? kSecond / 2 : kSecond / 10);
    CHECK(rms_db(rig.run(kSecond / 10)[0]) < -200);
    CHECK(rig.mixer.silent());
  }
}

TEST_CASE("A sheet at rest sends no cues") {
  Rig rig;
  rig.cues.clear();
  rig.hold({slide(1, 0.0)}, 1.0);
  CHECK(rig.cues.empty());
}

TEST_CASE("Speed that changes is followed without a step, half a block later") {
  Rig rig;
  auto at = [&](double from, double to, double speed) {
    auto o = rig.frame(from, to);
    o.friction = {slide(1, speed)};
    rig.planner.plan(o, 0, rig.cues);
  };
  at(0, 0, 0.1);
  for (int k = 0; k < 20; ++k) at(k * 0.1, (k + 1) * 0.1, 0.1 + 0.02 * (k + 1));
  rig.hand_over();
  const auto x = rig.run(2 * kSecond)[0];
  for (int k = 2; k < 20; ++k) {
    const std::size_t from = static_cast<std::size_t>(k * 4800);
    const double expected = -32 + 20 * std::log10((0.1 + 0.02 * (k + 0.5 - 0.107)) / 0.1);
    CHECK(rustle::dsp::rms_dbfs(std::span(x).subspan(from, 4800)) == Approx(expected).margin(0.6));
  }
}

TEST_CASE("At 96 kHz the noise has the same power density") {
  PackOptions fast;
  fast.rate_hz = 96000;
  fast.friction_db = -32;
  Rig rig(fast);
  rig.hold({slide(1, 0.1)}, 6);
  rig.hand_over();
  CHECK(rms_db(rig.run(5 * 96000)[0], 9600) == Approx(-32).margin(0.2));
}

TEST_CASE("A wall farther than the block resolves comes as an echo: the right delay, and the right comb") {
  // A wall 6 m behind the listener's line: path difference 12 m, 35 ms, more than the block.
  PackOptions plain;
  Rig rig(plain);
  const IdentifiedPlane wall{1, {{-6, 0, 0}, {1, 0, 0}, 1.0}};
  rig.planner.planes(std::span(&wall, 1), 0, 0, rig.cues);
  spatial::Listener listener = above();
  listener.position_m = {1, 0, 0};
  rig.planner.listener(listener, 0, 0, rig.cues);
  auto slid = slide(1, 0.1, {bent_resonator({0, 0, 0}, {1, 0, 0})});
  rig.hold({slid}, 41);
  rig.hand_over();
  const auto x = rig.run(40 * kSecond)[0];
  // Image at -12 m, 13 m from the listener, cos = -1: gain -1/13, 12 m later.
  const double delay = 12.0 / 343 * 48000;
  double best = 0;
  int where = 0;
  double power = 0;
  for (std::size_t n = 48000; n + 4000 < x.size(); ++n) power += static_cast<double>(x[n]) * x[n];
  for (int lag = 1400; lag < 2000; ++lag) {
    double sum = 0;
    for (std::size_t n = 48000; n + 4000 < x.size(); n += 2) {
      sum += static_cast<double>(x[n]) * x[n + static_cast<std::size_t>(lag)];
    }
    if (std::abs(sum) > std::abs(best)) {
      best = sum;
      where = lag;
    }
  }
  CHECK(std::abs(where - delay) < 1.5);
  CHECK(2 * best / power < -0.04);
}

}  // namespace friction_test
