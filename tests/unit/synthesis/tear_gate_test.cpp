#include "server/synthesis/tear_gate.h"

#include <catch2/catch.hpp>

#include <algorithm>
#include <cmath>
#include <vector>

namespace tear_gate_test {

using namespace rustle::synthesis;

namespace {

/// Exponent of p(x) ∝ x^-a on [low, high] by maximum likelihood.
double power_law(const std::vector<double>& values, double low, double high) {
  double mean_log = 0;
  for (const double v : values) mean_log += std::log(v / low) / static_cast<double>(values.size());
  double best = 0, most = -1e300;
  for (double a = 0.5; a < 2; a += 0.005) {
    const double p = 1 - a;
    const double mass = std::abs(p) < 1e-9 ? std::log(high / low) : (std::pow(high / low, p) - 1) / p;
    const double likelihood = -a * mean_log - std::log(mass);
    if (likelihood > most) most = likelihood, best = a;
  }
  return best;
}

template <class Gate>
std::pair<double, double> square_and_kurtosis(Gate gate, double step_m, int count) {
  double square = 0, fourth = 0;
  for (int k = 0; k < count; ++k) {
    const double g = gate.advance(step_m), g2 = g * g;
    square += g2 / count;
    fourth += g2 * g2 / count;
  }
  return {square, 3 * fourth / (square * square)};
}

}  // namespace

TEST_CASE("Breaks of a tear: energies and gaps follow their power laws, and short gaps come together") {
  TearBreaks breaks(5);
  std::vector<double> energies, gaps_m;
  double last_m = 0;
  for (int k = 0; k < 20000; ++k) {
    const TearBreak one = breaks.next();
    energies.push_back(one.energy);
    gaps_m.push_back(one.at_m - last_m);
    last_m = one.at_m;
  }
  double mean = 0, mean_gap = 0, square_gap = 0, together = 0;
  for (std::size_t k = 0; k < energies.size(); ++k) {
    const double count = static_cast<double>(energies.size());
    mean += energies[k] / count;
    mean_gap += gaps_m[k] / count;
    square_gap += gaps_m[k] * gaps_m[k] / count;
  }
  for (std::size_t k = 1; k < gaps_m.size(); ++k)
    together += std::log(gaps_m[k] / 5.5e-4) * std::log(gaps_m[k - 1] / 5.5e-4) > 0 ? 1 : 0;
  CHECK(mean == Approx(1).epsilon(0.06));
  const auto [least, most] = std::minmax_element(energies.begin(), energies.end());
  CHECK(*most / *least == Approx(kTearEnergyRange).epsilon(0.05));
  CHECK(power_law(energies, *least, *most) == Approx(1.25).margin(0.03));
  const auto [shortest, longest] = std::minmax_element(gaps_m.begin(), gaps_m.end());
  CHECK(*shortest >= kTearLeastGap_m);
  CHECK(*longest <= kTearMostGap_m);
  CHECK(power_law(gaps_m, kTearLeastGap_m, kTearMostGap_m) == Approx(1.0).margin(0.03));
  CHECK(std::sqrt(square_gap - mean_gap * mean_gap) / mean_gap > 1.3);
  CHECK(together / static_cast<double>(gaps_m.size()) > 0.75);
}

TEST_CASE("The gate of a tear has unit mean square, and depends on the torn length alone") {
  const auto [square, kurtosis] = square_and_kurtosis(TearGate(3), 2e-6, 10'000'000);
  CHECK(square == Approx(1).epsilon(0.05));
  CHECK(kurtosis > 5);
  CHECK(kurtosis < 15);
  TearGate slow(11), fast(11), other(12);
  double most = 0, apart = 0;
  for (int k = 0; k < 20000; ++k) {
    slow.advance(1e-6);
    const double at_slow = slow.advance(1e-6), at_fast = fast.advance(2e-6);
    most = std::max(most, std::abs(at_slow - at_fast) / at_fast);
    apart = std::max(apart, std::abs(at_fast - other.advance(2e-6)));
  }
  CHECK(most < 1e-6);
  CHECK(apart > 1);
  TearGate still(3);
  const double before = still.advance(1e-3);
  CHECK(still.advance(0) == before);
}

TEST_CASE("The printed gate has unit mean square and the kurtosis of r^100, and is held the longer the slower the tear") {
  const auto [square, kurtosis] = square_and_kurtosis(PublishedTearGate(4), kPublishedHold_m, 4'000'000);
  CHECK(square == Approx(1).epsilon(0.03));
  CHECK(kurtosis == Approx(302.3).epsilon(0.05));
  const auto changes = [](double speed_m_per_s) {
    PublishedTearGate gate(4);
    int count = 0;
    double last = gate.advance(0);
    for (int k = 0; k < 48000; ++k) {
      const double now = gate.advance(speed_m_per_s / 48000);
      count += now != last ? 1 : 0;
      last = now;
    }
    return count;
  };
  CHECK(changes(0.1) == Approx(100).margin(2));
  CHECK(changes(0.5) == Approx(500).margin(2));
  CHECK(changes(0) == 0);
}

}  // namespace tear_gate_test
