#include "server/synthesis/dense_bursts.h"

#include <catch2/catch.hpp>

#include <algorithm>
#include <cmath>
#include <map>
#include <set>

#include "sound_db/dsp/random.h"
#include "tests/unit/synthesis/rig.h"

namespace dense_bursts_test {

using namespace rustle::synthesis;
using namespace rustle::synthesis::rig;
namespace dsp = rustle::dsp;

namespace {

constexpr std::uint32_t kRate_hz = 48000;
const std::vector<float> kUnit{0.5F, -0.25F};

PlanOptions plan_options(Mode mode = Mode::kCorrected) {
  return {7, mode, kRate_hz, 0};
}

CrumpleCue cue_at(SampleTime onset, std::uint64_t event, float gain, Bus bus = 0) {
  CrumpleCue cue;
  cue.start = onset - kQuantum;
  cue.onset = onset;
  cue.event = event;
  cue.bus = bus;
  cue.unit = kUnit.data();
  cue.unit_samples = static_cast<std::uint32_t>(kUnit.size());
  cue.gain = gain;
  return cue;
}

double energy_of(const std::vector<Cue>& cues) {
  double sum = 0;
  for (const Cue& cue : cues) {
    const auto gain = static_cast<double>(std::get<CrumpleCue>(cue).gain);
    sum += gain * gain;
  }
  return sum;
}

std::vector<Cue> burst(double rate, double seconds, std::uint64_t seed) {
  dsp::Random random(seed);
  std::vector<Cue> out;
  for (std::uint64_t id = 1; id <= static_cast<std::uint64_t>(rate * seconds); ++id) {
    const auto onset = static_cast<SampleTime>(random.uniform() * seconds * kRate_hz);
    out.emplace_back(cue_at(onset, id, static_cast<float>(std::sqrt(random.truncated_pareto(1.4, 1e-4, 1)))));
  }
  return out;
}

using Sounds = std::map<std::uint64_t, float>;
Sounds sounds_of(const std::vector<Cue>& cues) {
  Sounds out;
  for (const Cue& cue : cues) out[std::get<CrumpleCue>(cue).event] = std::get<CrumpleCue>(cue).gain;
  return out;
}

}  // namespace

TEST_CASE("10,000 events a second become 1,000, within 0.03 dB", "[dense]") {
  auto cues = burst(10000, 10, 3);
  const double before = energy_of(cues);
  DenseBursts bursts(plan_options());
  bursts.merge(cues, 0);
  CHECK(cues.size() == Approx(10000).epsilon(0.01));
  CHECK(bursts.merged() == 100000 - cues.size());
  CHECK(std::abs(10 * std::log10(energy_of(cues) / before)) < 0.03);
}

TEST_CASE("The sound of a merged burst has the level of the whole, within 0.3 dB", "[dense]") {
  std::vector<float> unit(480);
  for (std::size_t n = 0; n < unit.size(); ++n) {
    unit[n] = 0.01F * static_cast<float>(std::cos(0.7 * static_cast<double>(n)) * std::exp(-static_cast<double>(n) / 60));
  }
  auto cues = burst(10000, 4, 5);
  dsp::Random random(1);
  for (Cue& cue : cues) {
    auto& c = std::get<CrumpleCue>(cue);
    c.unit = unit.data();
    c.unit_samples = static_cast<std::uint32_t>(unit.size());
    if (random.uniform() < 0.5) c.gain = -c.gain;
  }
  const auto heard = [&](const std::vector<Cue>& all) {
    std::vector<float> out(4 * kRate_hz + unit.size());
    for (const Cue& cue : all) {
      const auto& c = std::get<CrumpleCue>(cue);
      for (std::size_t n = 0; n < unit.size(); ++n) out[static_cast<std::size_t>(c.onset) + n] += c.gain * unit[n];
    }
    return rms_db(out);
  };
  const double whole_db = heard(cues);
  DenseBursts bursts(plan_options());
  bursts.merge(cues, 0);
  CHECK(heard(cues) == Approx(whole_db).margin(0.3));
}

TEST_CASE("Every slot keeps its energy and its strongest event; two events are left alone", "[dense]") {
  auto cues = burst(3000, 2, 4);
  std::map<std::int64_t, std::vector<CrumpleCue>> before, after;
  for (const Cue& cue : cues) {
    const auto& c = std::get<CrumpleCue>(cue);
    before[slot_of(c.onset, kRate_hz)].push_back(c);
  }
  DenseBursts bursts(plan_options());
  bursts.merge(cues, 0);
  for (const Cue& cue : cues) {
    const auto& c = std::get<CrumpleCue>(cue);
    after[slot_of(c.onset, kRate_hz)].push_back(c);
  }
  REQUIRE(before.size() == after.size());
  const auto energy = [](const std::vector<CrumpleCue>& all) {
    double sum = 0;
    for (const auto& c : all) sum += static_cast<double>(c.gain) * static_cast<double>(c.gain);
    return sum;
  };
  for (const auto& [slot, all] : before) {
    const auto& left = after.at(slot);
    CHECK(left.size() == std::min<std::size_t>(2, all.size()));
    CHECK(energy(left) == Approx(energy(all)).epsilon(1e-5));
    const auto louder = [](const CrumpleCue& a, const CrumpleCue& b) { return a.gain < b.gain; };
    const auto& strongest = *std::max_element(all.begin(), all.end(), louder);
    CHECK(std::any_of(left.begin(), left.end(),
                      [&](const auto& c) { return c.event == strongest.event && c.gain == strongest.gain; }));
  }
}

TEST_CASE("The one that sounds for the rest is drawn in proportion to energy", "[dense]") {
  // Beside the strongest: energies 3 and 1.
  int threes = 0;
  const int slots = 4000;
  DenseBursts bursts(plan_options());
  std::vector<Cue> cues;
  for (int k = 0; k < slots; ++k) {
    const auto id = static_cast<std::uint64_t>(3 * k);
    cues.emplace_back(cue_at(96 * k, id + 1, 1));
    cues.emplace_back(cue_at(96 * k + 20, id + 2, 3));
    cues.emplace_back(cue_at(96 * k + 95, id + 3, std::sqrt(3.0F)));
  }
  bursts.merge(cues, 0);
  REQUIRE(cues.size() == 2 * slots);
  for (const Cue& cue : cues) {
    const auto& c = std::get<CrumpleCue>(cue);
    if (c.event % 3 != 2) CHECK(c.gain == Approx(2));
    threes += c.event % 3 == 0 ? 1 : 0;
  }
  CHECK(threes / static_cast<double>(slots) == Approx(0.75).margin(0.03));
}

TEST_CASE("Neither order nor company matters: each bus and slot by itself", "[dense]") {
  auto one = burst(8000, 0.5, 6), shuffled = one, alone = one;
  dsp::Random random(2);
  for (std::size_t i = shuffled.size(); i > 1; --i)
    std::swap(shuffled[i - 1], shuffled[random.index(static_cast<std::uint32_t>(i))]);
  for (std::uint64_t id = 1; id <= 3000; ++id) shuffled.emplace_back(cue_at(static_cast<SampleTime>(id * 7), id, 1, 3));
  DenseBursts a(plan_options()), b(plan_options());
  a.merge(alone, 0);
  b.merge(shuffled, 0);
  std::erase_if(shuffled, [](const Cue& cue) { return std::get<CrumpleCue>(cue).bus == 3; });
  CHECK(sounds_of(alone) == sounds_of(shuffled));
}

TEST_CASE("The units of one event count as one and stay together", "[dense]") {
  std::vector<Cue> cues;
  for (std::uint16_t r = 0; r < 8; ++r) {
    auto cue = cue_at(100, 1, 0.2F);
    cue.resonator = r;
    cues.emplace_back(cue);
  }
  cues.emplace_back(cue_at(100, 2, 0.1F));
  DenseBursts bursts(plan_options());
  bursts.merge(cues, 0);
  CHECK(cues.size() == 9);
  cues.emplace_back(cue_at(110, 3, 5.0F));
  cues.emplace_back(cue_at(110, 4, 0));
  bursts.merge(cues, 0);
  const double total = 8 * 0.04 + 0.01;
  CHECK(energy_of(cues) == Approx(25 + total));
}

TEST_CASE("In published mode nothing is merged, and other cues are left alone", "[dense]") {
  auto cues = burst(10000, 0.1, 3);
  DenseBursts published(plan_options(Mode::kPublished)), bursts(plan_options());
  published.merge(cues, 0);
  CHECK(cues.size() == 1000);
  CHECK(published.whole_slots(1000) == 1000);
  cues.insert(cues.begin() + 500, GainCue{0, 0, 0, 1});
  bursts.merge(cues, 0);
  CHECK(std::count_if(cues.begin(), cues.end(), [](const Cue& c) { return std::holds_alternative<GainCue>(c); }) == 1);
}

TEST_CASE("A release reaches to the end of the slots that it begins, at every rate", "[dense]") {
  for (const std::uint32_t rate_hz : {44100U, 48000U, 96000U}) {
    PlanOptions options = plan_options();
    options.rate_hz = rate_hz;
    const DenseBursts bursts(options);
    for (SampleTime until = -2000; until < 3000; ++until) {
      const SampleTime reached = bursts.whole_slots(until);
      CHECK(reached >= until);
      CHECK(reached < until + rate_hz / 500 + 1);
      CHECK(bursts.whole_slots(reached) == reached);
      const std::int64_t slot = slot_of(reached + kQuantum, rate_hz);
      CHECK(first_sample_of(slot, rate_hz) == reached + kQuantum);
      CHECK(slot_of(reached + kQuantum - 1, rate_hz) == slot - 1);
    }
    CHECK(bursts.whole_slots(INT64_MAX) == INT64_MAX);
  }
}

TEST_CASE("What is released piece by piece is merged as when released at once", "[dense]") {
  const auto planned = [](SampleTime step) {
    Rig rig;
    rig.cues.clear();
    auto o = rig.frame(0, 0.5);
    dsp::Random random(9);
    for (std::uint64_t id = 1; id <= 2000; ++id)
      o.crumpling.push_back(flap(id, 0.01 + 0.2 * random.uniform(), random.uniform(0.001, 0.1)));
    rig.planner.plan(o, 0, rig.cues);
    for (SampleTime t = 0; t <= 12000; t += step) rig.planner.release(t, rig.cues);
    CHECK(rig.planner.counters().voices_merged == 2000 - rig.cues.size());
    return sounds_of(rig.cues);
  };
  const auto fine = planned(kQuantum);
  CHECK(fine.size() < 220);
  CHECK(fine == planned(12000));
  CHECK(fine == planned(10 * kQuantum));
}

TEST_CASE("What continues a merged event raises the one that sounds for it, by its share", "[dense]") {
  Rig rig;
  rig.cues.clear();
  auto o = rig.frame(0, 0.02);
  o.crumpling = {flap(1, 0.0101, 0.1), flap(2, 0.0101, 0.03), flap(3, 0.0101, 0.04)};
  rig.planner.plan(o, 0, rig.cues);
  rig.planner.release(1024, rig.cues);
  REQUIRE(rig.cues.size() == 2);
  const auto before = sounds_of(rig.cues);
  const std::uint64_t sounding = before.contains(2) ? 2 : 3;
  rig.cues.clear();
  auto more = flap(4, 0.03, 0.03);  // twice the amplitude of event 2
  more.continues = 2;
  auto next = rig.frame(0.02, 0.04);
  next.crumpling = {more};
  rig.planner.plan(next, 1024, rig.cues);
  REQUIRE(rig.cues.size() == 1);
  const auto& raise = std::get<CrumpleRaiseCue>(rig.cues[0]);
  CHECK(raise.event == sounding);
  CHECK(raise.factor == Approx(std::sqrt((4 * 9 + 16) / 25.0)));
}

}  // namespace dense_bursts_test
