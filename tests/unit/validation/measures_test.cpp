#include "server/validation/measures.h"

#include <catch2/catch.hpp>
#include <cmath>
#include <numbers>

#include "server/validation/check.h"
#include "sound_db/dsp/random.h"

namespace measures_test {

using namespace rustle;
using namespace rustle::validation;

namespace {

std::vector<float> decaying_noise(double t60, double seconds, std::uint64_t seed) {
  dsp::Random random(seed);
  std::vector<float> x(static_cast<std::size_t>(seconds * kRate_hz));
  for (std::size_t n = 0; n < x.size(); ++n) {
    x[n] = static_cast<float>(random.normal() * std::pow(10.0, -3 * static_cast<double>(n) / kRate_hz / t60));
  }
  return x;
}

}  // namespace

TEST_CASE("Bounds hold at their ends, or just above the low one, and never for what is no number") {
  CHECK(between(1, 2).holds(1));
  CHECK(between(1, 2).holds(2));
  CHECK_FALSE(between(1, 2).holds(2.001));
  CHECK_FALSE(above_to(0, 0.09).holds(0));
  CHECK(above_to(0, 0.09).holds(0.09));
  CHECK(around(-20, 0.5).holds(-20.4));
  CHECK_FALSE(around(-20, 0.5).holds(-20.6));
  CHECK(shown().holds(1e9));
  for (const Bound& bound : {between(1, 2), at_least(0), at_most(0), shown()}) CHECK_FALSE(bound.holds(std::nan("")));
  CHECK(at_most(0.3, "dB").text == "at most 0.3 dB");
}

TEST_CASE("The power law of a truncated Pareto sample is found, whatever lies outside the fitted range") {
  for (const double exponent : {1.0, 1.3, 1.6, 2.5}) {
    dsp::Random random(3);
    std::vector<double> values;
    for (int k = 0; k < 20000; ++k) values.push_back(random.truncated_pareto(exponent, 1, 1e4));
    const auto law = fitted_power_law(values, 10, 1000);
    INFO(exponent);
    CHECK(law.exponent == Approx(exponent).margin(exponent > 2 ? 0.15 : 0.06));
    CHECK(law.count < 20000);
  }
  CHECK(std::isnan(fitted_power_law({}, 1, 10).exponent));
}

TEST_CASE("T60 of decaying noise, whole and in a band; a sound that goes on has none") {
  CHECK(t60_s(decaying_noise(0.3, 1, 1)) == Approx(0.3).epsilon(0.05));
  CHECK(t60_s(decaying_noise(0.015, 0.2, 2)) == Approx(0.015).epsilon(0.15));
  double sum = 0;
  for (std::uint64_t seed = 1; seed <= 8; ++seed) sum += band_t60_s(decaying_noise(0.2, 1, seed), 900, 1120) / 8;
  CHECK(sum == Approx(0.2).epsilon(0.12));
  CHECK(std::isnan(t60_s(std::vector<float>{})));
}

TEST_CASE("The last window within 30 dB lies where the decay says") {
  // 60 dB in 0.4 s: 30 dB in 0.2 s.
  CHECK(last_within_30_db_s(decaying_noise(0.4, 1, 5)) == Approx(0.2).margin(0.025));
  CHECK(last_within_30_db_s(decaying_noise(0.01, 1, 5)) <= 0.010001);
}

TEST_CASE("Rank correlation is 1 for any rising law, -1 for any falling one, and low for none") {
  std::vector<double> x, rising, falling, other;
  for (int k = 0; k < 12; ++k) {
    x.push_back(k);
    rising.push_back(std::exp(k));
    falling.push_back(-k * k);
    other.push_back(k % 2);
  }
  CHECK(rank_correlation(x, rising) == Approx(1));
  CHECK(rank_correlation(x, falling) == Approx(-1));
  CHECK(std::abs(rank_correlation(x, other)) < 0.5);
}

TEST_CASE("White noise of variance 1 has a power density of 1, and its bands their share of the power") {
  dsp::Random random(8);
  std::vector<float> x(10 * kRate_hz);
  for (float& sample : x) sample = static_cast<float>(random.normal());
  const auto density = power_density(x, 1024);
  CHECK(band_power(density, 1000, 9000) == Approx(8000).epsilon(0.02));
}

}  // namespace measures_test
