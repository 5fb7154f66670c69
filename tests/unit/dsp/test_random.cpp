#include <catch2/catch.hpp>
#include <set>
#include <vector>

#include "sound_db/dsp/random.h"

namespace test_random {

using namespace rustle;

TEST_CASE("the stream is fixed for good") {
  STATIC_REQUIRE(dsp::mix(0x9e3779b97f4a7c15ULL) == 0xe220a8397b1dcdafULL);  // SplitMix64's first output for the seed 0
  dsp::Random a(1), b(1), c(2);
  CHECK(a.next() == b.next());
  CHECK(a.next() != c.next());
}

TEST_CASE("hash tells its arguments apart, in their places") {
  std::set<std::uint64_t> seen;
  for (std::uint64_t seed = 0; seed < 20; ++seed) {
    for (std::uint64_t a = 0; a < 20; ++a) {
      for (std::uint64_t b = 0; b < 20; ++b) seen.insert(dsp::hash(seed, a, b));
    }
  }
  CHECK(seen.size() == 8000);
}

TEST_CASE("uniform, normal, index and Pareto have the moments they claim") {
  dsp::Random random(11);
  const int count = 200000;
  double mean = 0, square = 0, normal_mean = 0, normal_square = 0, normal_fourth = 0;
  std::vector<int> bins(7, 0);
  int above_geometric_mean = 0;
  for (int i = 0; i < count; ++i) {
    const double u = random.uniform();
    REQUIRE((u >= 0 && u < 1));
    mean += u / count;
    square += u * u / count;
    const double n = random.normal();
    normal_mean += n / count;
    normal_square += n * n / count;
    normal_fourth += n * n * n * n / count;
    ++bins[random.index(7)];
    const double e = random.truncated_pareto(1.4, 1e-4, 1.0);
    REQUIRE((e >= 0.999e-4 && e <= 1.001));
    above_geometric_mean += e > 1e-2;
  }
  CHECK(mean == Approx(0.5).margin(0.003));
  CHECK(square == Approx(1.0 / 3).margin(0.003));
  CHECK(normal_mean == Approx(0).margin(0.01));
  CHECK(normal_square == Approx(1).margin(0.02));
  CHECK(normal_fourth == Approx(3).margin(0.1));
  for (const int b : bins) CHECK(b == Approx(count / 7.0).epsilon(0.03));
  // P(e > √(lo hi)) = (g^b - hi^b) / (lo^b - hi^b) with b = -0.4
  const double expected = (std::pow(1e-2, -0.4) - 1) / (std::pow(1e-4, -0.4) - 1);
  CHECK(above_geometric_mean / double(count) == Approx(expected).epsilon(0.03));
}

}  // namespace test_random
