#include "server/synthesis/fine_events.h"

#include <catch2/catch.hpp>

#include <algorithm>
#include <cmath>
#include <set>

#include "sound_db/dsp/random.h"
#include "tests/unit/synthesis/rig.h"

namespace fine_events_test {

using namespace rustle::synthesis;
using namespace rustle::synthesis::rig;
namespace dsp = rustle::dsp;
using rustle::observation::BendingPatch;

namespace {

constexpr SampleTime kSecond = 48000;

BendingPatch patch_of(double change_m, std::uint32_t number = 0) {
  BendingPatch patch;
  patch.patch = number;
  patch.change_m = change_m;
  patch.area_m2 = 0.01;
  patch.covariance_m2 = 1e-4 * Eigen::Matrix3d::Identity();
  return patch;
}

std::vector<FineEvent> drawn(double change_m, SampleTime length, std::uint64_t seed = 1) {
  const BendingPatch patch = patch_of(change_m);
  std::vector<FineEvent> out;
  draw_fine_events({seed, 1, 1, 0, length, 48000}, {&patch, 1}, out);
  return out;
}

/// Maximum likelihood of τ for density ∝ E^-τ on [low, high], by bisection of the score.
double fitted_exponent(const std::vector<double>& energies, double low, double high) {
  double log_sum = 0;
  for (const double e : energies) log_sum += std::log(e / low);
  const double mean = log_sum / static_cast<double>(energies.size()), span = std::log(high / low);
  const auto mean_log = [&](double tau) {  // of ln(E / low)
    const double b = 1 - tau;
    if (std::abs(b) < 1e-6) return span / 2;
    return span / (1 - std::exp(-b * span)) - 1 / b;
  };
  double from = 0.5, to = 3;
  for (int k = 0; k < 60; ++k) (mean_log((from + to) / 2) > mean ? from : to) = (from + to) / 2;
  return (from + to) / 2;
}

double variation(const std::vector<FineEvent>& events) {
  double sum = 0, squares = 0;
  for (std::size_t i = 1; i < events.size(); ++i) {
    const auto gap = static_cast<double>(events[i].onset - events[i - 1].onset);
    sum += gap, squares += gap * gap;
  }
  const double n = static_cast<double>(events.size() - 1), mean = sum / n;
  return std::sqrt(squares / n - mean * mean) / mean;
}

std::vector<CrumpleCue> crumple_cues(const std::vector<Cue>& cues) {
  std::vector<CrumpleCue> out;
  for (const Cue& cue : cues) {
    if (const auto* c = std::get_if<CrumpleCue>(&cue)) out.push_back(*c);
  }
  return out;
}

/// What a second of bending at 3 m/s becomes, planned in frames and released in steps.
std::vector<CrumpleCue> planned(double rate_hz, SampleTime step, Mode mode = Mode::kCorrected, double rigid = 1) {
  PackOptions options;
  options.fine_events = true;
  Rig rig(options, mode);
  rig.cues.clear();
  SampleTime promised = 0;
  for (int k = 1; k <= rate_hz; ++k) {
    auto o = rig.frame((k - 1) / rate_hz, k / rate_hz);
    o.bending = {patch_of(rigid * 2 / rate_hz, 0), patch_of(rigid * 1 / rate_hz, 3)};
    rig.planner.plan(o, promised, rig.cues);
    const SampleTime reached = (static_cast<SampleTime>(kSecond * k / rate_hz) - 2400) / kQuantum * kQuantum;
    for (; promised + step <= reached; promised += step) rig.planner.release(promised + step, rig.cues);
  }
  rig.planner.release(1 << 30, rig.cues);
  return crumple_cues(rig.cues);
}

}  // namespace

TEST_CASE("Energies of fine events follow a power law of 1.3 to 1.6 over three decades", "[fine]") {
  const auto events = drawn(20, 20 * kSecond);
  REQUIRE(events.size() > 5000);
  std::vector<double> energies, shocks, upper;
  const double high = strongest_fine_energy(), low = high / kFineRange;
  for (const FineEvent& event : events) {
    CHECK(event.energy >= low * (1 - 1e-9));
    CHECK(event.energy <= high * (1 + 1e-9));
    energies.push_back(event.energy);
    if (event.aftershock) shocks.push_back(event.energy);
    if (event.energy > high / 100) upper.push_back(event.energy);
  }
  CHECK(fitted_exponent(energies, low, high) == Approx(kFineExponent).margin(0.03));
  CHECK(fitted_exponent(shocks, low, high) == Approx(kFineExponent).margin(0.04));
  CHECK(fitted_exponent(upper, high / 100, high) == Approx(kFineExponent).margin(0.07));
  CHECK(fitted_exponent(upper, high / 100, high) > 1.3);
  CHECK(fitted_exponent(upper, high / 100, high) < 1.6);
}

TEST_CASE("Fine events come in clusters, at any density", "[fine]") {
  for (const double speed_m_per_s : {0.03, 0.3, 3.0}) {
    const double seconds = 60 / speed_m_per_s / 10;
    const auto events = drawn(speed_m_per_s * seconds, static_cast<SampleTime>(seconds * kSecond));
    CAPTURE(speed_m_per_s);
    REQUIRE(events.size() > 1000);
    CHECK(variation(events) > 1.3);
  }
}

TEST_CASE("Count and energy go with the bending, not with the frames that it comes in", "[fine]") {
  const auto of_frames = [](int frames) {
    std::vector<FineEvent> out;
    for (int k = 0; k < frames; ++k) {
      const BendingPatch patch = patch_of(8.0 / frames);
      draw_fine_events({5, 1, static_cast<std::uint64_t>(k + 1), 0, 100, 48000}, {&patch, 1}, out);
    }
    double energy = 0;
    for (const FineEvent& event : out) energy += event.energy;
    return std::pair(static_cast<double>(out.size()), energy);
  };
  for (const int frames : {1, 30, 480}) {
    const auto [count, energy] = of_frames(frames);
    CAPTURE(frames);
    CHECK(count == Approx(8 * kFineParents_per_m * (1 + kFineAftershocks)).epsilon(0.1));
    CHECK(energy == Approx(8 * kFineEnergy_per_m).epsilon(0.15));
  }
  CHECK(drawn(0, kSecond).empty());
}

TEST_CASE("Fine events depend on session, sheet and frame, and on nothing else", "[fine]") {
  const auto same = [](const std::vector<FineEvent>& a, const std::vector<FineEvent>& b) {
    return std::equal(a.begin(), a.end(), b.begin(), b.end(),
                      [](const FineEvent& x, const FineEvent& y) { return x.onset == y.onset && x.energy == y.energy; });
  };
  CHECK(same(drawn(1, kSecond, 1), drawn(1, kSecond, 1)));
  CHECK_FALSE(same(drawn(1, kSecond, 1), drawn(1, kSecond, 2)));
  const auto once = planned(60, 64), other = planned(60, 800 * 64);
  REQUIRE(once.size() > 300);
  REQUIRE(once.size() == other.size());
  for (std::size_t i = 0; i < once.size(); ++i) {
    CHECK(once[i].event == other[i].event);
    CHECK(once[i].onset == other[i].onset);
    CHECK(once[i].gain == other[i].gain);
    CHECK(once[i].emitter.position_m.x == other[i].emitter.position_m.x);
  }
}

TEST_CASE("Fine events are clacs, in time, in place, each no louder than the cap", "[fine]") {
  const auto cues = planned(60, 64);
  std::set<std::uint64_t> ids;
  for (const CrumpleCue& cue : cues) {
    CHECK(cue.onset >= 0);
    CHECK(cue.onset < kSecond + static_cast<SampleTime>(kFineLast_s * kSecond) + 1);
    CHECK(cue.unit_samples == 1);
    CHECK(std::abs(cue.emitter.position_m.x) <= 0.0201);
    CHECK(cue.gain <= dsp::db_to_gain(kMostFineGain_db) * 5);
    ids.insert(cue.event);
  }
  CHECK(ids.size() == cues.size());
  CHECK(planned(60, 64, Mode::kPublished).empty());
  CHECK(planned(60, 64, Mode::kCorrected, 0).empty());
}

TEST_CASE("Nothing starts before what is promised, and what comes late is spread, not piled up", "[fine]") {
  PackOptions options;
  options.fine_events = true;
  Rig rig(options);
  rig.cues.clear();
  auto o = rig.frame(0, 0.1);
  o.bending = {patch_of(1)};
  rig.planner.plan(o, kSecond, rig.cues);
  rig.planner.release(1 << 30, rig.cues);
  const auto cues = crumple_cues(rig.cues);
  REQUIRE(cues.size() > 50);
  std::set<SampleTime> onsets;
  for (const CrumpleCue& cue : cues) {
    CHECK(cue.start >= kSecond);
    onsets.insert(cue.onset);
  }
  CHECK(onsets.size() > cues.size() / 2);
}

TEST_CASE("A visible event carries a burst that leaves its level as it is", "[fine]") {
  PackOptions options;
  options.fine_events = true;
  options.unit.assign(4800, 0);
  for (std::size_t n = 0; n < options.unit.size(); ++n) {
    options.unit[n] =
        0.1F * static_cast<float>(std::cos(0.3 * static_cast<double>(n)) * std::exp(-static_cast<double>(n) / 1000));
  }
  options.clac.assign(options.unit.begin(), options.unit.begin() + 200);
  const double reference_m = make_pack(options)->crumpling->reference_amplitude_m(kBent);
  double carried = 0;
  for (std::uint64_t id = 1; id <= 40; ++id) {
    Rig rig(options);
    rig.cues.clear();
    auto o = rig.frame(0.9, 1.0);
    o.crumpling = {flap(id, 0.95, reference_m)};
    rig.planner.plan(o, 0, rig.cues);
    rig.planner.release(1 << 30, rig.cues);
    const auto cues = crumple_cues(rig.cues);
    double burst = 0;
    float loudest = 0;
    for (const CrumpleCue& cue : cues) {
      if (cue.event == id) continue;
      ++carried;
      burst += static_cast<double>(cue.gain) * static_cast<double>(cue.gain);
      loudest = std::max(loudest, cue.gain);
      CHECK(cue.onset > 0.92 * kSecond);
      CHECK(cue.onset < 1.26 * kSecond);
    }
    CHECK(loudest <= 1.01 * dsp::db_to_gain(kBurstPeak_db));
    CHECK(burst < 0.25);
    rig.planner.listener(above(), 0, 0, rig.cues);
    Rig heard(options);
    heard.planner.plan(o, 0, heard.cues);
    heard.hand_over();
    CHECK(dsp::peak_dbfs(heard.run(2 * kSecond)[0]) == Approx(-20).margin(0.5));
  }
  CHECK(carried / 40 == Approx(kBurstEvents).epsilon(0.2));
}

}  // namespace fine_events_test
