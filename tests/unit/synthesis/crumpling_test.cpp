#include <catch2/catch.hpp>

#include <algorithm>
#include <cmath>
#include <set>

#include "tests/unit/synthesis/rig.h"

namespace crumpling_test {

using namespace rustle::synthesis;
using namespace rustle::synthesis::rig;
namespace spatial = rustle::spatial;
using rustle::observation::Resonator;

namespace {

double reference_m() {
  static const auto pack = make_pack({});
  return pack->crumpling->reference_amplitude_m(kBent);
}

/// Peak at 1 m on the axis of one event, relative to the unit's own.
double heard_db(const rustle::observation::CrumplingEvent& event, Mode mode = Mode::kCorrected) {
  Rig rig({}, mode);
  auto o = rig.frame(0, 0.1);
  o.crumpling = {event};
  rig.planner.plan(o, 0, rig.cues);
  rig.hand_over();
  return rustle::dsp::peak_dbfs(rig.run(9600)[0]) + 20;
}

std::vector<Cue> crumples(const std::vector<Cue>& cues) {
  std::vector<Cue> out;
  std::copy_if(cues.begin(), cues.end(), std::back_inserter(out), [](const Cue& c) {
    return std::holds_alternative<CrumpleCue>(c) || std::holds_alternative<CrumpleRaiseCue>(c);
  });
  return out;
}

}  // namespace

TEST_CASE("A unit starts at its event's sample, exactly, and is heard as it is on the axis at 1 m") {
  PackOptions options;
  options.unit = {0.5F, -0.25F, 0.125F};
  Rig rig(options);
  auto o = rig.frame(0, 0.1);
  o.crumpling = {flap(1, 1000.0 / 48000 + 1e-6, reference_m())};
  rig.planner.plan(o, 0, rig.cues);
  rig.hand_over();
  const auto x = rig.run(4800)[0];
  for (std::size_t n = 0; n < x.size(); ++n) {
    const float expected = n >= 1000 && n < 1003 ? options.unit[n - 1000] : 0.0F;
    CHECK(x[n] == Approx(expected).margin(1e-7));
  }
  CHECK(rig.mixer.silent());
}

TEST_CASE("No onset lies before what is already rendered") {
  Rig rig;
  rig.cues.clear();
  auto o = rig.frame(0, 0.1);
  o.crumpling = {flap(1, 0.02, 0.1)};
  rig.planner.plan(o, 3200, rig.cues);
  rig.planner.release(1 << 20, rig.cues);
  REQUIRE(rig.cues.size() == 1);
  CHECK(std::get<CrumpleCue>(rig.cues[0]).onset == 3200);
  CHECK(std::get<CrumpleCue>(rig.cues[0]).start == 3200);
}

TEST_CASE("Level: linear in the event's amplitude, capped, size held within 6 dB, power shared by resonators") {
  CHECK(heard_db(flap(1, 0.05, reference_m())) == Approx(0).margin(0.01));
  CHECK(heard_db(flap(1, 0.05, 2 * reference_m())) == Approx(6.02).margin(0.01));
  CHECK(heard_db(flap(1, 0.05, 100 * reference_m())) == Approx(12).margin(0.01));
  Resonator large = bent_resonator();
  large.disc_radius_m *= 2;
  CHECK(heard_db(flap(1, 0.05, reference_m(), {large})) == Approx(6).margin(0.01));
  CHECK(heard_db(flap(1, 0.05, reference_m(), {bent_resonator(), bent_resonator()})) == Approx(3.01).margin(0.01));
  Resonator held = large;
  held.constrained = true;
  CHECK(heard_db(flap(1, 0.05, 0.001, {held})) == Approx(0).margin(0.01));
  CHECK(heard_db(flap(1, 0.05, 0.16, {held})) == Approx(12).margin(0.01));
  CHECK(heard_db(flap(1, 0.05, 0)) < -100);
}

TEST_CASE("As published a³ counts as it stands, and the event as the sum of |ΔH|") {
  Resonator large = bent_resonator();
  large.disc_radius_m *= 2;
  auto event = flap(1, 0.05, reference_m());
  event.published_amplitude_per_m = reference_m() * 11200;
  CHECK(heard_db(event, Mode::kPublished) == Approx(0).margin(0.1));
  event.resonators = {large};
  CHECK(heard_db(event, Mode::kPublished) == Approx(60 * std::log10(2.0)).margin(0.1));
  event.published_amplitude_per_m *= 10;
  CHECK(heard_db(event, Mode::kPublished) == Approx(60 * std::log10(2.0) + 20).margin(0.1));
}

TEST_CASE("Variants are drawn by seed and event: the same again for the same seed, never one twice running, all in use") {
  PackOptions options;
  options.variants = 3;
  const auto draw = [&](double time_offset_s) {
    Rig rig(options);
    rig.cues.clear();
    auto o = rig.frame(0, 3);
    for (std::uint64_t id = 1; id <= 60; ++id)
      o.crumpling.push_back(flap(id, 0.01 * static_cast<double>(id) + time_offset_s, 0.1));
    rig.planner.plan(o, 0, rig.cues);
    rig.planner.release(1 << 20, rig.cues);
    std::vector<float> firsts;
    for (const Cue& cue : rig.cues) firsts.push_back(std::get<CrumpleCue>(cue).unit[0]);
    return firsts;
  };
  const auto drawn = draw(0);
  REQUIRE(drawn.size() == 60);
  CHECK(draw(0.3) == drawn);
  CHECK(std::set<float>(drawn.begin(), drawn.end()).size() == 3);
  CHECK(std::adjacent_find(drawn.begin(), drawn.end()) == drawn.end());
}

TEST_CASE("What continues a waiting event adds to it; the larger one's resonators stay") {
  Rig rig;
  rig.cues.clear();
  auto o = rig.frame(0, 0.02);
  o.crumpling = {flap(1, 0.015, 0.02)};
  rig.planner.plan(o, 0, rig.cues);
  auto next = rig.frame(0.02, 0.04);
  auto more = flap(2, 0.03, 0.05, {bent_resonator({0, 0, 0.3})});
  more.continues = 1;
  next.crumpling = {more};
  rig.planner.plan(next, 0, rig.cues);
  rig.planner.release(1 << 20, rig.cues);
  const auto sent = crumples(rig.cues);
  REQUIRE(sent.size() == 1);
  const auto& cue = std::get<CrumpleCue>(sent[0]);
  CHECK(cue.event == 1);
  CHECK(cue.onset == 720);
  CHECK(cue.gain == Approx(0.07 / reference_m()));
  CHECK(cue.emitter.position_m.z == 0.3);
}

TEST_CASE("What continues a sounding event raises its voices, and after 100 ms starts its own") {
  PackOptions options;
  options.unit.assign(24000, 0.1F);
  Rig rig(options);
  auto o = rig.frame(0, 0.02);
  o.crumpling = {flap(1, 0.01, 0.02)};
  rig.planner.plan(o, 0, rig.cues);
  rig.hand_over(960);
  auto x = rig.run(960)[0];
  const float before = x.back();
  auto more = flap(2, 0.03, 0.02);
  more.continues = 1;
  auto next = rig.frame(0.02, 0.04);
  next.crumpling = {more};
  rig.planner.plan(next, 960, rig.cues);
  REQUIRE(crumples(rig.cues).size() == 1);
  CHECK(std::get<CrumpleRaiseCue>(rig.cues.back()).factor == Approx(2));
  rig.hand_over(1920);
  x = rig.run(960)[0];
  CHECK(x.back() == Approx(2 * before));
  for (std::size_t n = 1; n < x.size(); ++n) CHECK(std::abs(x[n] - x[n - 1]) < 0.02F * before);
  auto late = flap(3, 0.2, 0.02);
  late.continues = 2;
  auto third = rig.frame(0.19, 0.21);
  third.crumpling = {late};
  rig.cues.clear();
  rig.planner.plan(third, 9600, rig.cues);
  rig.planner.release(1 << 20, rig.cues);
  REQUIRE(crumples(rig.cues).size() == 1);
  CHECK(std::holds_alternative<CrumpleCue>(rig.cues.back()));
}

TEST_CASE("Release keeps back what starts later, and sends by start, then event") {
  Rig rig;
  rig.cues.clear();
  auto o = rig.frame(0, 0.1);
  o.crumpling = {flap(3, 0.05, 0.1), flap(2, 0.02, 0.1), flap(1, 0.05, 0.1)};
  rig.planner.plan(o, 0, rig.cues);
  CHECK(rig.cues.empty());
  rig.planner.release(960 - 64, rig.cues);
  CHECK(rig.cues.empty());
  rig.planner.release(960, rig.cues);
  REQUIRE(rig.cues.size() == 1);
  CHECK(std::get<CrumpleCue>(rig.cues[0]).event == 2);
  rig.planner.release(1 << 20, rig.cues);
  REQUIRE(rig.cues.size() == 3);
  CHECK(std::get<CrumpleCue>(rig.cues[1]).event == 1);
  CHECK(std::get<CrumpleCue>(rig.cues[2]).event == 3);
}

TEST_CASE("A pack without the wanted sound is counted, not guessed") {
  auto bare = std::make_shared<rustle::pack::SoundPack>();
  bare->rate_hz = 48000;
  Planner planner({});
  std::vector<Cue> cues;
  planner.add_sheet({1, 0, bare, {}}, 0, cues);
  rustle::observation::Observation o;
  o.sheet = 1;
  o.time_s = 0.1;
  o.crumpling = {flap(1, 0.05, 0.1)};
  o.friction = {slide(1, 0.1)};
  planner.plan(o, 0, cues);
  planner.release(1 << 20, cues);
  CHECK(cues.empty());
  CHECK(planner.counters().sounds_missing == 2);
}

TEST_CASE("Above the voice limit the quietest fades away, without a step") {
  PackOptions options;
  options.unit.resize(48000);
  for (std::size_t n = 0; n < options.unit.size(); ++n) {
    options.unit[n] = 0.1F * static_cast<float>(std::sin(2 * M_PI * 200 * static_cast<double>(n) / 48000));
  }
  Rig rig(options, Mode::kCorrected, spatial::Layout::kMono, 4);
  Rig without(options, Mode::kCorrected, spatial::Layout::kMono, 8);
  auto o = rig.frame(0, 0.1);
  std::uint64_t id = 1;
  for (const double share : {0.9, 0.7, 0.1, 0.5}) {
    // 3 ms apart: those of one slot of 2 ms would be merged.
    o.crumpling.push_back(flap(id, 0.01 + 0.003 * static_cast<double>(id), share * reference_m()));
    ++id;
  }
  auto missing = o;
  missing.crumpling.erase(missing.crumpling.begin() + 2);
  o.crumpling.push_back(flap(9, 0.1, 0.4 * reference_m()));
  missing.crumpling.push_back(flap(9, 0.1, 0.4 * reference_m()));
  rig.planner.plan(o, 0, rig.cues);
  without.planner.plan(missing, 0, without.cues);
  rig.hand_over();
  without.hand_over();
  const auto x = rig.run(9600)[0];
  const auto y = without.run(9600)[0];
  CHECK(rig.mixer.counters().voices_stolen == 1);
  CHECK(without.mixer.counters().voices_stolen == 0);
  for (std::size_t n = 4800 + 192; n < x.size(); ++n) CHECK(x[n] == Approx(y[n]).margin(1e-6));
  float steepest = 0;
  for (std::size_t n = 1; n < x.size(); ++n) steepest = std::max(steepest, std::abs(x[n] - x[n - 1]));
  CHECK(steepest < 1.05F * 0.1F * 2.7F * 2 * static_cast<float>(M_PI) * 200 / 48000);
}

}  // namespace crumpling_test
