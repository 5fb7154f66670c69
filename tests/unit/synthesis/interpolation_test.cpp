#include "server/synthesis/interpolation.h"

#include <catch2/catch.hpp>

#include <cmath>
#include <cstring>
#include <numbers>
#include <vector>

#include "sound_db/dsp/random.h"

namespace interpolation_test {

using namespace rustle::synthesis;

namespace {

std::vector<float> noise(std::size_t count, std::uint64_t seed) {
  rustle::dsp::Random random(seed);
  std::vector<float> x(count);
  for (float& sample : x) sample = static_cast<float>(random.normal());
  return x;
}

/// The cubic of four neighbours, as the header has it.
double cubic(const std::vector<float>& x, double position) {
  const double whole = std::floor(position);
  const double f = position - whole;
  const float* y = &x[static_cast<std::size_t>(whole) - 1];
  return -f * (f - 1) * (f - 2) / 6 * y[0] + (f + 1) * (f - 1) * (f - 2) / 2 * y[1] - (f + 1) * f * (f - 2) / 2 * y[2] +
         (f + 1) * f * (f - 1) / 6 * y[3] + 0.03 * f * (1 - f) * (y[1] + y[2] - y[0] - y[3]);
}

Position position(double samples) {
  return std::llround(samples * static_cast<double>(kWholeSample));
}

}  // namespace

TEST_CASE("Readings are the cubic of four neighbours, at rest and on the way, forth and back, slow and fast") {
  const auto x = noise(400, 1);
  for (const double pace : {0.0, 1e-6, 0.001, -0.001, 0.01, -0.03, 1.0 / 64, 0.0625, -0.0625, 0.1, -0.12, 0.125, -0.125}) {
    for (const double first : {100.0, 100.25, 100.999999, 101.5, 140.0 - 1e-9}) {
      std::vector<float> out(kQuantum, 0.5F);
      const auto slide = static_cast<std::int32_t>(position(pace));
      add_moving({x.data(), position(first), slide, 0.8F, -0.005F}, out.data());
      for (int n = 0; n < kQuantum; ++n) {
        const double expected = (0.8 - 0.005 * n) * cubic(x, first + n * (1 + pace)) + 0.5;
        INFO("pace " << pace << " first " << first << " n " << n);
        CHECK(out[static_cast<std::size_t>(n)] == Approx(expected).margin(1e-5));
      }
    }
  }
  for (const double first : {100.0, 100.25, 100.75}) {
    std::vector<float> out(kQuantum, 0.5F);
    const auto whole = static_cast<std::size_t>(first);
    StillTap tap{&x[whole - 1], weights(position(first - std::floor(first)), 0.7F)};
    add_taps({}, std::span(&tap, 1), out.data());
    for (int n = 0; n < kQuantum; ++n)
      CHECK(out[static_cast<std::size_t>(n)] == Approx(0.7 * cubic(x, first + n) + 0.5).margin(1e-6));
  }
}

TEST_CASE("A whole delay has one weight, and weights add up to the gain") {
  CHECK(weights(0, 0.3F) == std::array<float, 4>{0, 0.3F, 0, 0});
  for (double f = 0; f < 1; f += 0.01) {
    const auto w = weights(position(f), 2.0F);
    CHECK(w[0] + w[1] + w[2] + w[3] == Approx(2.0));
  }
}

TEST_CASE("However many taps go in one pass, the bits are those of plain loops, tap after tap") {
  const auto x = noise(3000, 2);
  for (std::size_t whole_count = 0; whole_count <= 11; ++whole_count) {
    for (std::size_t still_count = 0; still_count <= 11; ++still_count) {
      std::vector<StillTap> still;
      std::vector<WholeTap> whole;
      for (std::size_t k = 0; k < still_count; ++k) {
        still.push_back(
            {&x[97 * k + 3], weights(position(0.07 * static_cast<double>(k + 1)), 0.1F * static_cast<float>(k + 1))});
      }
      for (std::size_t k = 0; k < whole_count; ++k) whole.push_back({&x[131 * k + 5], 0.2F * static_cast<float>(k + 1)});
      std::vector<float> out = noise(kQuantum, 3), plain = out;
      auto moved_still = still;
      auto moved_whole = whole;
      add_taps(moved_whole, moved_still, out.data());
      for (std::size_t k = 0; k < still_count; ++k) CHECK(moved_still[k].x == still[k].x + kQuantum);
      for (std::size_t k = 0; k < whole_count; ++k) CHECK(moved_whole[k].x == whole[k].x + kQuantum);
      std::array<std::array<float, kQuantum + 3>, 4> sums{};
      for (const auto& tap : still) {
        for (std::size_t k = 0; k < 4; ++k) {
          for (std::size_t m = 0; m < kQuantum + 3; ++m) sums[k][m] += tap.weights_gain[k] * tap.x[m];
        }
      }
      for (std::size_t n = 0; n < kQuantum; ++n) {
        for (const auto& tap : whole) plain[n] += tap.gain * tap.x[n];
        plain[n] += (sums[0][n] + sums[1][n + 1]) + (sums[2][n + 2] + sums[3][n + 3]);
      }
      INFO(whole_count << " whole and " << still_count << " still taps");
      CHECK(std::memcmp(out.data(), plain.data(), kQuantum * sizeof(float)) == 0);
    }
  }
}

}  // namespace interpolation_test
