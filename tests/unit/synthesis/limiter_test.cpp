#include "server/synthesis/limiter.h"

#include <catch2/catch.hpp>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <vector>

#include "sound_db/dsp/random.h"

namespace limiter_test {

using namespace rustle::synthesis;

namespace {

std::vector<float> noise(std::size_t count, double scale, std::uint64_t seed) {
  rustle::dsp::Random random(seed);
  std::vector<float> x(count);
  for (float& sample : x) sample = static_cast<float>(std::clamp(scale * random.normal(), -3e38, 3e38));
  return x;
}

void limit(Limiter& limiter, std::vector<float>& x) {
  float* channel = x.data();
  limiter.process(std::span(&channel, 1), x.size());
}

}  // namespace

TEST_CASE("What stays below -3 dBFS passes bit for bit") {
  std::vector<float> x = noise(48000, 0.2, 1);
  for (float& sample : x) sample = std::clamp(sample, -0.707F, 0.707F);
  std::vector<float> y = x;
  Limiter limiter(48000);
  limit(limiter, y);
  CHECK(std::memcmp(x.data(), y.data(), x.size() * sizeof(float)) == 0);
  CHECK(limiter.limited() == 0);
}

TEST_CASE("Whatever comes in, what goes out is finite and within ±1") {
  for (const double scale : {0.5, 1.0, 10.0, 1e6, 1e30, 1e38}) {
    std::vector<float> x = noise(20000, scale, 2);
    x[100] = std::numeric_limits<float>::quiet_NaN();
    x[200] = std::numeric_limits<float>::infinity();
    x[300] = -std::numeric_limits<float>::infinity();
    x[400] = std::numeric_limits<float>::max();
    Limiter limiter(48000);
    limit(limiter, x);
    CHECK(limiter.not_finite() == 3);
    CHECK(std::all_of(x.begin(), x.end(), [](float s) { return std::isfinite(s) && std::abs(s) <= 1; }));
    CHECK(x[100] == 0.0F);
    CHECK(x[400] > 0.9F);
  }
}

TEST_CASE("Both channels are turned down alike, and let go within half a second") {
  std::vector<float> left(48000, 0.1F), right(48000, 0.05F);
  left[1000] = 5.0F;
  float* channels[] = {left.data(), right.data()};
  Limiter limiter(48000);
  limiter.process(channels, 48000);
  CHECK(left[999] == 0.1F);
  CHECK(left[1001] < 0.05F);
  for (std::size_t n = 1001; n < left.size(); ++n) CHECK(left[n] / 0.1F == Approx(right[n] / 0.05F));
  CHECK(std::is_sorted(left.begin() + 1001, left.end()));
  CHECK(left[1000 + 4800] == Approx(0.1F * (1 - 0.8F * std::exp(-1.0F))).epsilon(0.02));
  CHECK(left.back() > 0.0999F);
}

TEST_CASE("Grouping does not matter, and the curve rises") {
  const std::vector<float> x = noise(6400, 0.8, 3);
  std::vector<float> whole = x, parts = x;
  Limiter a(48000), b(48000);
  limit(a, whole);
  for (std::size_t n = 0; n < x.size(); n += 64) {
    float* channel = parts.data() + n;
    b.process(std::span(&channel, 1), 64);
  }
  CHECK(std::memcmp(whole.data(), parts.data(), whole.size() * sizeof(float)) == 0);
  float before = 0;
  for (float level = 0.5F; level < 4; level += 0.01F) {
    std::vector<float> one{level};
    Limiter fresh(48000);
    limit(fresh, one);
    CHECK(one[0] >= before - 2e-7F);
    before = one[0];
  }
}

}  // namespace limiter_test
