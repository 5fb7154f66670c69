#include "server/synthesis/noise_spectrum.h"

#include <catch2/catch.hpp>

#include <array>
#include <cmath>
#include <complex>
#include <vector>

namespace noise_spectrum_test {

using namespace rustle::synthesis;

namespace {

constexpr std::size_t kBins = 4096;

std::complex<double> at(const ComplexBins& bins, std::size_t k) {
  return {static_cast<double>(bins.re[k / kBinLanes].at[k % kBinLanes]),
          static_cast<double>(bins.im[k / kBinLanes].at[k % kBinLanes])};
}

double at(const RealBins& bins, std::size_t k) {
  return static_cast<double>(bins.value[k / kBinLanes].at[k % kBinLanes]);
}

}  // namespace

TEST_CASE("A delay is a straight phase over all bins, and two add") {
  for (const double step : {0.0, 0.001, -0.3, 3.0, 100.0}) {
    ComplexBins bins(kBins);
    add_delayed(0.7, step, bins);
    add_delayed(-0.2, 0.5, bins);
    double worst = 0;
    for (std::size_t k = 0; k < kBins; ++k) {
      const auto x = static_cast<double>(k);
      worst = std::max(worst, std::abs(at(bins, k) - std::polar(0.7, -step * x) + std::polar(0.2, -0.5 * x)));
    }
    CHECK(worst < 1e-3);
  }
}

TEST_CASE("What is shared and what is a path's own have its power together, and share by the height's spread") {
  for (const double x : {1e-5, 0.002, 0.05, 1.0, 40.0}) {
    RealBins gamma(kBins), rest(kBins);
    coherence(x, gamma, rest);
    for (std::size_t k = 0; k < kBins; ++k) {
      const double wanted = std::exp(-0.5 * std::pow(static_cast<double>(k) * x, 2));
      REQUIRE(std::abs(at(gamma, k) - wanted) < 1e-3);
      REQUIRE(std::abs(at(gamma, k) * at(gamma, k) + at(rest, k) * at(rest, k) - 1) < 0.005);
    }
    ComplexBins shared(kBins), own(kBins);
    add_delayed(0.5, 0.01, gamma, rest, shared, own);
    for (std::size_t k = 0; k < kBins; k += 37) {
      const auto whole = std::polar(0.5, -0.01 * static_cast<double>(k));
      REQUIRE(std::abs(at(shared, k) - at(gamma, k) * whole) < 1e-3);
      REQUIRE(std::abs(at(own, k) - at(rest, k) * whole) < 1e-3);
    }
  }
}

TEST_CASE("Random turns keep magnitudes, hit every quarter alike, and know nothing of one another") {
  std::vector<float> magnitudes(kBins, 2.0F);
  ComplexBins one(kBins);
  add_delayed(0.5, 0.4, one);
  std::array<int, 4> hits{};
  std::complex<double> mean = 0, square = 0, cross = 0, neighbours = 0;
  constexpr std::uint64_t kSeeds = 64;
  for (std::uint64_t seed = 1; seed <= kSeeds; ++seed) {
    ComplexBins turned(kBins), other(kBins), again(kBins);
    add_turned(seed * 0x9e3779b97f4a7c15ULL, magnitudes.data(), one, turned);
    add_turned((seed + 1000) * 0x9e3779b97f4a7c15ULL, magnitudes.data(), one, other);
    add_turned(seed * 0x9e3779b97f4a7c15ULL, magnitudes.data(), one, again);
    std::complex<double> before = 0;
    for (std::size_t k = 0; k < kBins; ++k) {
      const std::complex<double> turn = at(turned, k) / (2.0 * at(one, k));
      REQUIRE(std::abs(std::abs(turn) - 1) < 1e-5);
      REQUIRE(at(turned, k) == at(again, k));
      ++hits[static_cast<std::size_t>(std::lround(std::arg(turn) / 1.5707963 + 4)) % 4];
      mean += turn;
      square += turn * turn;
      cross += turn * std::conj(at(other, k) / (2.0 * at(one, k)));
      neighbours += turn * std::conj(before);
      before = turn;
    }
  }
  constexpr double kCount = kSeeds * kBins;
  for (const auto sum : {mean, square, cross, neighbours}) CHECK(std::abs(sum) / kCount < 4 / std::sqrt(kCount));
  for (const int count : hits) CHECK(std::abs(count - kCount / 4) < 4 * std::sqrt(kCount * 3 / 16));
}

TEST_CASE("A product adds to what is there") {
  ComplexBins a(64), b(64), out(64);
  add_delayed(0.5, 0.1, a);
  add_delayed(2, -0.3, b);
  add_delayed(1, 0, out);
  add_product(a, b, out);
  for (std::size_t k = 0; k < 64; ++k)
    CHECK(std::abs(at(out, k) - 1.0 - std::polar(1.0, 0.2 * static_cast<double>(k))) < 1e-5);
  set_zero(out);
  CHECK(std::abs(at(out, 63)) == 0);
}

TEST_CASE("What is delayed and turned in one pass is what is delayed, then turned") {
  std::vector<float> magnitudes(kBins);
  for (std::size_t k = 0; k < kBins; ++k) magnitudes[k] = 1.0F / static_cast<float>(k + 1);
  constexpr std::uint64_t kSeed = 0x1234'5678'9abc'def0ULL, kOwnSeed = 77;
  const auto worst = [&](const ComplexBins& a, const ComplexBins& b) {
    double most = 0;
    for (std::size_t k = 0; k < kBins; ++k) most = std::max(most, std::abs(at(a, k) - at(b, k)));
    return most;
  };
  for (const double step : {0.0, 0.02, -0.3}) {
    ComplexBins delayed(kBins), wanted(kBins), out(kBins);
    add_delayed(0.7, step, delayed);
    add_turned(kSeed, magnitudes.data(), delayed, wanted);
    add_turned_delayed(kSeed, magnitudes.data(), 0.7, step, out);
    CHECK(worst(out, wanted) < 1e-6);
    // And on top of what is there.
    add_turned_delayed(kSeed, magnitudes.data(), 0.7, step, out);
    add_turned(kSeed, magnitudes.data(), delayed, wanted);
    CHECK(worst(out, wanted) < 1e-6);

    RealBins gamma(kBins), rest(kBins);
    coherence(0.01, gamma, rest);
    ComplexBins shared(kBins), own(kBins), apart(kBins), together(kBins);
    add_delayed(0.7, step, gamma, rest, shared, own);
    add_turned(kSeed, magnitudes.data(), shared, apart);
    add_turned(kOwnSeed, magnitudes.data(), own, apart);
    add_turned_delayed(kSeed, kOwnSeed, magnitudes.data(), 0.7, step, 0.01, together);
    CHECK(worst(together, apart) < 1e-6);
    CHECK(worst(together, out) > 1e-3);
  }
}

}  // namespace noise_spectrum_test
