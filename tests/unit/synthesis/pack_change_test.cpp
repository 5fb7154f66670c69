#include <catch2/catch.hpp>
#include <cmath>
#include <memory>

#include "sound_db/dsp/random.h"
#include "tests/unit/synthesis/rig.h"

namespace pack_change_test {

using namespace rustle::synthesis;
using namespace rustle::synthesis::rig;
namespace dsp = rustle::dsp;
namespace pack = rustle::pack;

namespace {

std::vector<float> noise(std::size_t samples, std::uint64_t seed) {
  dsp::Random random(seed);
  std::vector<float> unit(samples);
  for (float& x : unit) x = static_cast<float>(0.1 * random.normal());
  return unit;
}

PackOptions sounding(std::uint64_t seed, double friction_db = -32) {
  PackOptions options;
  options.unit = noise(24000, seed);
  options.friction_db = friction_db;
  return options;
}

void strike(Rig& rig, std::uint64_t id, double time_s) {
  auto o = rig.frame(time_s, time_s + 0.01);
  o.crumpling = {flap(id, time_s, 0.1)};
  rig.planner.plan(o, rig.now, rig.cues);
  rig.hand_over();
}

/// Contacts that slide on, sixty frames a second, rendered as they come.
std::vector<float> slide_on(Rig& rig, double seconds) {
  std::vector<float> heard;
  const double from_s = static_cast<double>(rig.now) / 48000;
  for (int k = 1; k <= std::lround(seconds * 60); ++k) {
    auto o = rig.frame(from_s + (k - 1) / 60.0, from_s + k / 60.0);
    o.friction = {slide(1, 0.1)};
    rig.planner.plan(o, rig.now, rig.cues);
    rig.hand_over();
    const auto more = rig.run(static_cast<SampleTime>(std::lround((from_s + k / 60.0) * 48000)) - rig.now);
    heard.insert(heard.end(), more[0].begin(), more[0].end());
  }
  return heard;
}

double level_db(const std::vector<float>& x, double from_s, double to_s) {
  const auto from = static_cast<std::size_t>(from_s * 48000),
             to = std::min(x.size(), static_cast<std::size_t>(to_s * 48000));
  return dsp::rms_dbfs(std::span(x).subspan(from, to - from));
}

}  // namespace

TEST_CASE("What sounds goes on with its old pack, sample for sample, and what begins has the new one") {
  Rig old(sounding(1)), changed(sounding(1)), fresh(sounding(2));
  for (Rig* rig : {&old, &changed}) strike(*rig, 1, 0);
  const auto start = old.run(9600)[0];
  CHECK(changed.run(9600)[0] == start);
  CHECK(rms_db(start) > -60);
  changed.planner.add_sheet({1, 0, make_pack(sounding(2)), {}}, changed.now, changed.cues);
  changed.hand_over();
  const auto rest = old.run(38400)[0];
  CHECK(changed.run(38400)[0] == rest);
  CHECK(rms_db(rest) > -60);
  fresh.run(48000);
  for (Rig* rig : {&fresh, &changed}) strike(*rig, 2, 1.1);
  const auto second = fresh.run(38400)[0];
  CHECK(changed.run(38400)[0] == second);
  CHECK(rms_db(second) > -60);
}

TEST_CASE("Friction goes over to the new pack without a hole or a burst") {
  const auto [before_db, after_db] = GENERATE(std::pair(-32.0, -32.0), std::pair(-32.0, -20.0), std::pair(-20.0, -50.0));
  Rig rig(sounding(1, before_db));
  const auto before = slide_on(rig, 1);
  rig.planner.add_sheet({1, 0, make_pack(sounding(1, after_db)), {}}, rig.now, rig.cues);
  const auto after = slide_on(rig, 1);
  const double was_db = level_db(before, 0.3, 1), is_db = level_db(after, 0.3, 1);
  CHECK(is_db - was_db == Approx(after_db - before_db).margin(0.7));
  // 20 ms pieces of noise stray by about 1 dB; half of each of two noises has 3 dB less than either.
  for (double at_s = 0; at_s < 0.2; at_s += 0.01) {
    CHECK(level_db(after, at_s, at_s + 0.02) > std::min(was_db, is_db) - 6);
    CHECK(level_db(after, at_s, at_s + 0.02) < std::max(was_db, is_db) + 3);
  }
  float most = 0;
  for (const float x : after) most = std::max(most, std::abs(x));
  CHECK(most < 6 * dsp::db_to_gain(std::max(was_db, is_db)));
  CHECK(rig.mixer.counters().voices == 1);
}

TEST_CASE("The same pack again changes nothing") {
  const auto shared = make_pack(sounding(1));
  const auto hear = [&](bool again) {
    Rig rig(sounding(1));
    rig.planner.add_sheet({1, 0, shared, {}}, 0, rig.cues);
    rig.hand_over();
    slide_on(rig, 0.3);
    if (again) rig.planner.add_sheet({1, 0, shared, {}}, rig.now, rig.cues);
    return slide_on(rig, 0.3);
  };
  CHECK(hear(true) == hear(false));
}

TEST_CASE("A pack that nobody has any more is let go of once its last sound has died away, and not before") {
  auto leaving = make_pack(sounding(1));
  const std::weak_ptr<const pack::SoundPack> watched = leaving;
  Rig rig(sounding(3));
  rig.planner.add_sheet({1, 0, std::move(leaving), {}}, 0, rig.cues);
  rig.hand_over();
  slide_on(rig, 0.5);
  strike(rig, 1, 0.5);
  rig.planner.add_sheet({1, 0, make_pack(sounding(2)), {}}, rig.now, rig.cues);
  rig.hand_over();
  double gone_at_s = 0;
  for (int step = 0; step < 100 && gone_at_s == 0; ++step) {
    slide_on(rig, 0.1);
    rig.planner.forget_silent(rig.now);
    if (watched.expired()) gone_at_s = static_cast<double>(rig.now) / 48000;
  }
  CHECK(gone_at_s > 1.0);  // its unit is 0.5 s long
  CHECK(gone_at_s < 6.0);
  // A sheet that comes back to it in time keeps it.
  auto kept = make_pack(sounding(1));
  const std::weak_ptr<const pack::SoundPack> stays = kept;
  rig.planner.add_sheet({1, 0, kept, {}}, rig.now, rig.cues);
  rig.planner.add_sheet({1, 0, make_pack(sounding(2)), {}}, rig.now, rig.cues);
  rig.planner.forget_silent(rig.now);
  rig.planner.add_sheet({1, 0, std::move(kept), {}}, rig.now, rig.cues);
  slide_on(rig, 10);
  rig.planner.forget_silent(rig.now);
  rig.planner.forget_silent(rig.now + 48000 * 100);
  CHECK_FALSE(stays.expired());
}

TEST_CASE("Sessions that want the same of a pack share it, while one of them is there", "[synthesis]") {
  const auto paper = make_pack({});
  std::weak_ptr<const Material> kept;
  {
    const auto first = shared_material(paper, 48000);
    kept = first;
    CHECK(shared_material(paper, 48000) == first);
    CHECK(shared_material(paper, 48000, 1024) == first);
    CHECK(shared_material(paper, 48000, 512) != first);
    CHECK(shared_material(make_pack({}), 48000) != first);
  }
  CHECK(kept.expired());
}

}  // namespace pack_change_test
