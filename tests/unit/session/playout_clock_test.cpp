#include <catch2/catch.hpp>

#include <algorithm>
#include <cmath>
#include <functional>
#include <vector>

#include "server/session/playout_clock.h"

namespace playout_clock_test {

namespace {

using rustle::session::PlayoutClock;
using Change = PlayoutClock::Change;

constexpr double kRate = 48000;

/// Uniform from 0 to 1, the same in every run.
class Chance {
 public:
  explicit Chance(std::uint64_t seed = 1) : state_(seed) {}
  double next() {
    state_ = state_ * 6364136223846793005ULL + 1442695040888963407ULL;
    return static_cast<double>(state_ >> 11) / 9007199254740992.0;
  }
  double normal() {
    double sum = -6;
    for (int k = 0; k < 12; ++k) sum += next();
    return sum;
  }

 private:
  std::uint64_t state_;
};

/// Feeds a clock and looks at every map it makes.
class Fed {
 public:
  explicit Fed(PlayoutClock::Options options = {}) : clock(options) {}

  Change frame(double time_s, double arrived_s) {
    const bool before = clock.placed();
    const auto was = before ? clock.mapping() : rustle::engine::TimeMapping{};
    const Change change = clock.frame(time_s, arrived_s);
    const auto& now = clock.mapping();
    REQUIRE(now.samples_per_s > 0);
    if (change == Change::kPlaced) {
      ++placed;
    } else if (change == Change::kAdjusted) {
      ++adjusted;
      // Both maps agree where the one takes over from the other: at a whole sample beside the newest frame's.
      const double pivot_s = now.time_s(static_cast<double>(now.first_sample));
      CHECK(std::abs(was.position(newest_s) - static_cast<double>(now.first_sample)) <= 0.5001);
      greatest_step = std::max(greatest_step, std::abs(now.position(pivot_s) - was.position(pivot_s)));
    } else {
      CHECK(now == was);
    }
    if (change != Change::kPlaced && time_s > newest_s) {
      least_slope = std::min(least_slope, (now.position(time_s) - last_position) / kRate / (time_s - newest_s));
    }
    newest_s = std::max(newest_s, time_s);
    last_position = now.position(newest_s);
    return change;
  }

  /// When a frame of that time is heard, in seconds on the audio clock.
  double heard_s(double time_s) const { return clock.mapping().position(time_s) / kRate; }

  PlayoutClock clock;
  int placed = 0, adjusted = 0;
  double greatest_step = 0, least_slope = 1e9;
  double newest_s = -1e9, last_position = 0;
};

TEST_CASE("A sender on time is heard 40 ms after its first frame came, and less as it proves steady") {
  Fed fed;
  CHECK(fed.frame(100, 7) == Change::kPlaced);
  CHECK(fed.heard_s(100) == Approx(7.04));
  for (int k = 1; k <= 60; ++k) fed.frame(100 + k / 60.0, 7 + k / 60.0);
  CHECK(fed.clock.delay_s() == Approx(0.04).margin(0.002));
  for (int k = 61; k <= 1200; ++k) fed.frame(100 + k / 60.0, 7 + k / 60.0);
  CHECK(fed.clock.delay_s() == Approx(0.03).margin(1e-6));
  CHECK(fed.heard_s(120) == Approx(27.03).margin(0.0005));
  CHECK(fed.placed == 1);
  CHECK(fed.greatest_step < 1e-3);
  CHECK(std::abs(fed.clock.drift_ppm()) < 0.01);
}

TEST_CASE("Drift of 200 ppm is followed for an hour within a millisecond, without a step") {
  const double ppm = GENERATE(200.0, -200.0, 0.0);
  const double jitter_s = GENERATE(0.0, 0.02);
  Fed fed;
  Chance chance;
  double worst_s = 0, greatest_delay_s = 0, least_lead_s = 1e9;
  for (int k = 0; k < 3600 * 60; ++k) {
    const double t = k / 60.0;
    const double sent_s = 3 + t / (1 + 1e-6 * ppm);
    const double arrived_s = sent_s + 0.01 + jitter_s * chance.next();
    fed.frame(50 + t, arrived_s);
    if (t < 60) continue;
    // Of a frame that waits for nothing; a low decile of the jitter counts as that.
    const double error_s = fed.heard_s(50 + t) - fed.clock.delay_s() - (sent_s + 0.01 + 0.1 * jitter_s);
    worst_s = std::max(worst_s, std::abs(error_s));
    greatest_delay_s = std::max(greatest_delay_s, fed.clock.delay_s());
    least_lead_s = std::min(least_lead_s, fed.heard_s(50 + t) - arrived_s);
  }
  CAPTURE(ppm, jitter_s, worst_s, greatest_delay_s, least_lead_s, fed.adjusted);
  CHECK(worst_s < 0.001);
  CHECK(fed.clock.drift_ppm() == Approx(ppm).margin(2));
  CHECK(fed.placed == 1);
  CHECK(fed.greatest_step < 1e-3);
  CHECK(fed.least_slope > 0.74);
  CHECK(least_lead_s > 0.005);  // no frame comes after it is due
  CHECK(greatest_delay_s < 0.06);
}

/// What a sender with jitter and losses leaves to be desired: how far sound had to go on without news at most.
struct Lack {
  double most_s = -1;  ///< after the newest frame's time, before the next one came
  double greatest_delay_s = 0;
  int placed = 0;
};
Lack lack_of(double frames_per_s, const std::function<double(Chance&)>& transit_s, double seconds, std::uint64_t seed) {
  Fed fed;
  Chance chance(seed);
  std::vector<std::pair<double, double>> arrivals;
  for (int k = 0; k < seconds * frames_per_s; ++k) {
    const double t = k / frames_per_s;
    if (chance.next() >= 0.01) arrivals.emplace_back(t + transit_s(chance), t);
  }
  std::sort(arrivals.begin(), arrivals.end());
  Lack lack;
  double newest_s = -1;
  for (const auto& [arrived_s, t] : arrivals) {
    if (t < newest_s) continue;  // reordered
    if (newest_s > 3) lack.most_s = std::max(lack.most_s, arrived_s - fed.heard_s(newest_s) - fed.clock.carry_s());
    fed.frame(t, arrived_s);
    newest_s = t;
    lack.greatest_delay_s = std::max(lack.greatest_delay_s, fed.clock.delay_s());
  }
  lack.placed = fed.placed;
  return lack;
}

TEST_CASE("20 ± 10 ms of jitter with one frame in a hundred lost leaves no gap at a delay of at most 80 ms") {
  // Even, or normal without bounds; at 30 frames a second the latter needs more.
  const auto [frames_per_s, normal] = GENERATE(
      table<double, bool>({{30, false}, {60, false}, {60, true}, {120, false}, {120, true}, {240, false}, {240, true}}));
  const std::uint64_t seed = GENERATE(1, 2, 3);
  const bool bell = normal;
  const Lack lack = lack_of(
      frames_per_s, [&](Chance& c) { return bell ? std::max(0.0, 0.02 + 0.01 * c.normal()) : 0.01 + 0.02 * c.next(); }, 300,
      seed);
  CAPTURE(frames_per_s, normal, seed, lack.most_s, lack.greatest_delay_s);
  CHECK(lack.most_s < 0);
  CHECK(lack.greatest_delay_s <= 0.080);
  CHECK(lack.placed == 1);
}

TEST_CASE("The delay grows at once with the jitter and shrinks slowly after it, along a continuous map") {
  Fed fed;
  Chance chance;
  double at = 0;
  double arrived_s = 0;  // in order, as on a connection
  const auto run = [&](double seconds, double jitter_s) {
    for (const double end = at + seconds; at < end; at += 1 / 60.0) {
      arrived_s = std::max(arrived_s, 1 + at + jitter_s * chance.next());
      fed.frame(at, arrived_s);
    }
  };
  const auto lead_s = [&] { return fed.heard_s(at) - 1 - at; };
  run(20, 0.001);
  CHECK(fed.clock.delay_s() < 0.035);
  run(2, 0.08);
  const double grown_s = lead_s();
  CHECK(grown_s > 0.08 + 1 / 60.0);
  run(3, 0.001);
  CHECK(lead_s() > 0.06);  // still remembered
  run(30, 0.001);
  CHECK(lead_s() < 0.035);
  CHECK(fed.greatest_step < 1e-3);
  CHECK(fed.least_slope > 0.74);
  CHECK(fed.placed == 1);
}

TEST_CASE("After a stall a sender is in step again") {
  const bool all_come = GENERATE(true, false);  // what was held up comes all at once, or never
  Fed fed;
  for (int k = 0; k < 600; ++k) fed.frame(k / 60.0, 1 + k / 60.0);
  const double delay_s = fed.clock.delay_s();
  for (int k = 600; k < 630 && all_come; ++k) fed.frame(k / 60.0, 1 + 630 / 60.0);
  for (int k = 630; k < 700; ++k) fed.frame(k / 60.0, 1 + k / 60.0);
  CHECK(fed.heard_s(700 / 60.0) == Approx(1 + 700 / 60.0 + delay_s).margin(0.002));
  CHECK(fed.clock.delay_s() == Approx(delay_s).margin(0.01));
  CHECK(fed.placed == 1);
}

TEST_CASE("A pause of the sender is followed within a quarter of a second") {
  const double pause_s = GENERATE(0.1, 0.5, 30.0, 3600.0);
  Fed fed;
  for (int k = 0; k < 600; ++k) fed.frame(k / 60.0, 1 + k / 60.0);
  double in_step_s = -1;
  for (int k = 600; k < 700; ++k) {
    const double arrived_s = 1 + pause_s + k / 60.0;
    fed.frame(k / 60.0, arrived_s);
    const double lead_s = fed.heard_s(k / 60.0) - arrived_s;
    if (lead_s < 0.02 || lead_s > 0.06) {
      in_step_s = -1;
    } else if (in_step_s < 0) {
      in_step_s = (k - 600) / 60.0;
    }
  }
  CHECK(in_step_s >= 0);
  CHECK(in_step_s < 0.35);
  CHECK(fed.placed == 2);
}

TEST_CASE("A step of simulation time is followed at once") {
  Fed fed;
  for (int k = 0; k < 600; ++k) fed.frame(k / 60.0, 1 + k / 60.0);
  const double step_s = GENERATE(0.4, 100.0);
  for (int k = 600; k < 660; ++k) {
    fed.frame(step_s + k / 60.0, 1 + k / 60.0);
    CHECK(fed.heard_s(step_s + k / 60.0) == Approx(1 + k / 60.0 + 0.035).margin(0.015));
  }
  CHECK(fed.placed == 2);
}

TEST_CASE("A simulator at another speed is in step within half a second, and its drift says how fast it is") {
  const double speed = GENERATE(0.1, 0.5, 0.9, 0.97, 1.05, 2.0, 10.0, 100.0);
  const double jitter_s = GENERATE(0.0, 0.01);
  Fed fed;
  Chance chance;
  double most_lead_s = 0, least_lead_s = 1e9;
  for (int k = 0; k < 1200; ++k) {  // 60 frames a second of real time
    const double arrived_s = 1 + k / 60.0 + jitter_s * chance.next();
    fed.frame(speed * k / 60.0, arrived_s);
    if (k < 90) continue;
    const double lead_s = fed.heard_s(speed * k / 60.0) - arrived_s;
    most_lead_s = std::max(most_lead_s, lead_s);
    least_lead_s = std::min(least_lead_s, lead_s);
  }
  CAPTURE(speed, jitter_s, fed.placed, least_lead_s, most_lead_s);
  CHECK(least_lead_s > 0.0);
  CHECK(most_lead_s < 0.12);
  CHECK(fed.clock.drift_ppm() == Approx(1e6 * (speed - 1)).epsilon(0.005).margin(2000));
}

TEST_CASE("A simulator whose speed changes is followed") {
  Fed fed;
  Chance chance;
  double t = 0;
  int out_of_step = 0;
  for (int k = 0; k < 60 * 60; ++k) {
    const double at = k / 60.0;
    t += (0.6 + 0.3 * std::sin(at / 3)) / 60;
    const double arrived_s = 1 + at + 0.005 * chance.next();
    fed.frame(t, arrived_s);
    const double lead_s = fed.heard_s(t) - arrived_s;
    out_of_step += lead_s < 0 || lead_s > 0.15 ? 1 : 0;
  }
  CAPTURE(fed.placed);
  CHECK(out_of_step < 60 * 60 / 20);
}

TEST_CASE("A sender in chunks of 200 ms makes the delay what the first frame of a chunk needs") {
  Fed fed;
  double least_lead_s = 1e9;
  for (int k = 0; k < 1800; ++k) {
    const double arrived_s = 1 + (k / 12) * 0.2;
    fed.frame(k / 60.0, arrived_s);
    if (k > 300) least_lead_s = std::min(least_lead_s, fed.heard_s(k / 60.0) - arrived_s);
  }
  CHECK(least_lead_s > 0);
  CHECK(fed.clock.delay_s() < 0.26);
}

TEST_CASE("A fixed delay stays what it is, and only the time moves") {
  Fed fed({kRate, 0.1});
  Chance chance;
  for (int k = 0; k < 6000; ++k) fed.frame(k / 60.0, 1 + k / 60.0 * 1.0001 + 0.015 * chance.next());
  CHECK(fed.clock.delay_s() == 0.1);
  CHECK(fed.heard_s(100) == Approx(101.01 + 0.1 + 0.0015).margin(0.001));
  CHECK(fed.placed == 1);
}

TEST_CASE("The time that analysis takes is part of the delay") {
  Fed fed;
  for (int k = 0; k < 1200; ++k) {
    fed.frame(k / 60.0, 1 + k / 60.0);
    fed.clock.ready(1 + k / 60.0 + 0.03);
  }
  CHECK(fed.clock.delay_s() == Approx(0.03 + 1 / 60.0 + 0.005).margin(0.001));
}

TEST_CASE("Several sheets with frames of the same times are one sender") {
  Fed one, three;
  for (int k = 0; k < 1200; ++k) {
    one.frame(k / 60.0, 1 + k / 60.0);
    for (int sheet = 0; sheet < 3; ++sheet) three.frame(k / 60.0, 1 + k / 60.0);
  }
  CHECK(three.clock.mapping().position(20) == Approx(one.clock.mapping().position(20)).margin(1));
  CHECK(three.clock.delay_s() == Approx(one.clock.delay_s()).margin(1e-6));
}

TEST_CASE("The same arrivals give the same maps, bit for bit") {
  const auto run = [] {
    Fed fed;
    Chance chance(9);
    std::vector<rustle::engine::TimeMapping> maps;
    for (int k = 0; k < 3000; ++k) {
      fed.frame(k / 60.0, 1 + k / 60.0 + 0.02 * chance.next() + (k > 1000 ? 2 : 0));
      maps.push_back(fed.clock.mapping());
    }
    return maps;
  };
  CHECK(run() == run());
}

}  // namespace

}  // namespace playout_clock_test
