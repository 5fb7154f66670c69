#include "server/comparison/event_matching.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <random>

#include <catch2/catch.hpp>

namespace event_matching_test {

using namespace rustle::comparison;

namespace {

std::vector<ListedEvent> at(std::initializer_list<double> times_s) {
  std::vector<ListedEvent> out;
  for (const double time_s : times_s) out.push_back({1, "crumpling", time_s, 0.1});
  return out;
}

/// The best of all matchings, tried one by one: (pairs, sum of distances).
std::pair<std::size_t, double> best_by_trial(const std::vector<ListedEvent>& a, const std::vector<ListedEvent>& b,
                                             double tolerance_s) {
  std::pair<std::size_t, double> best{0, 0};
  std::vector<char> used(b.size());
  const std::function<void(std::size_t, std::size_t, double)> go = [&](std::size_t i, std::size_t pairs, double sum) {
    if (i == a.size()) {
      if (pairs > best.first || (pairs == best.first && sum < best.second)) best = {pairs, sum};
      return;
    }
    go(i + 1, pairs, sum);
    for (std::size_t j = 0; j < b.size(); ++j) {
      const double apart = std::abs(a[i].time_s - b[j].time_s);
      if (used[j] || apart > tolerance_s || a[i].sheet != b[j].sheet) continue;
      used[j] = 1;
      go(i + 1, pairs + 1, sum + apart);
      used[j] = 0;
    }
  };
  go(0, 0, 0);
  return best;
}

}  // namespace

TEST_CASE("matching finds the most pairs, and among those the nearest, as trying all does") {
  std::mt19937 random(7);
  std::uniform_real_distribution<double> time(0, 0.3);
  for (int round = 0; round < 200; ++round) {
    std::vector<ListedEvent> a, b;
    for (int k = 0; k < 6; ++k) {
      a.push_back({static_cast<std::uint32_t>(round % 2 + k % 2), "crumpling", time(random), 1});
      b.push_back({static_cast<std::uint32_t>(round % 2 + k % 2), "crumpling", time(random), 1});
    }
    const auto pairs = match_events(a, b, 0.05);
    double sum = 0;
    std::vector<std::size_t> seen_a, seen_b;
    for (const auto& pair : pairs) {
      sum += std::abs(a[pair.reference].time_s - b[pair.other].time_s);
      CHECK(std::abs(a[pair.reference].time_s - b[pair.other].time_s) <= 0.05);
      CHECK(a[pair.reference].sheet == b[pair.other].sheet);
      seen_a.push_back(pair.reference), seen_b.push_back(pair.other);
    }
    std::sort(seen_a.begin(), seen_a.end()), std::sort(seen_b.begin(), seen_b.end());
    CHECK(std::adjacent_find(seen_a.begin(), seen_a.end()) == seen_a.end());
    CHECK(std::adjacent_find(seen_b.begin(), seen_b.end()) == seen_b.end());
    const auto best = best_by_trial(a, b, 0.05);
    CAPTURE(round);
    CHECK(pairs.size() == best.first);
    CHECK(sum == Approx(best.second).margin(1e-12));
  }
}

TEST_CASE("precision, recall, timing and amplitude of a shifted list with one event missing and two invented") {
  const auto reference = at({1.0, 2.0, 3.0, 4.0});
  auto other = at({1.004, 2.004, 3.004, 5.0, 6.0});
  for (auto& event : other) event.amplitude = 0.2;
  const auto score = score_events(reference, other, match_events(reference, other, 0.02));
  CHECK(score.matched == 3);
  CHECK(score.precision == Approx(3.0 / 5));
  CHECK(score.recall == Approx(3.0 / 4));
  CHECK(score.median_error_s == Approx(0.004));
  CHECK(score.bias_s == Approx(0.004));
  CHECK(score.amplitude_db == Approx(20 * std::log10(2.0)));
  const auto nothing = score_events({}, {}, {});
  CHECK((nothing.precision == 1 && nothing.recall == 1));
}

TEST_CASE("kinds do not match each other") {
  auto friction = at({1.0});
  friction[0].kind = "friction";
  CHECK(match_events(at({1.0}), friction, 1).empty());
}

TEST_CASE("an event list is read without continuations, and a bad line is named") {
  const auto read = read_event_list(
      "{\"sheet\":1,\"kind\":\"crumpling\",\"time_s\":0.5,\"amplitude\":0.01,\"continues\":null}\n\n"
      "{\"sheet\":1,\"kind\":\"crumpling\",\"time_s\":0.6,\"amplitude\":0.01,\"continues\":4}\n");
  REQUIRE(read.has_value());
  REQUIRE(read->size() == 1);
  CHECK(read->front().time_s == 0.5);
  for (const char* bad : {"{}\n", "nonsense\n", "{\"sheet\":-1,\"kind\":\"crumpling\",\"time_s\":0.5,\"amplitude\":0.01}\n",
                          "{\"sheet\":1,\"kind\":\"crumpling\",\"time_s\":\"0.5\",\"amplitude\":0.01}\n"}) {
    const auto wrong = read_event_list(bad);
    REQUIRE_FALSE(wrong.has_value());
    CHECK(wrong.error().find("line 1") != std::string::npos);
  }
}

}  // namespace event_matching_test
