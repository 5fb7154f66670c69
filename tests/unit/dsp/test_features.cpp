#include <catch2/catch.hpp>
#include <cmath>
#include <numbers>
#include <vector>

#include "sound_db/dsp/features.h"
#include "sound_db/dsp/level.h"
#include "sound_db/dsp/random.h"

namespace test_features {

using namespace rustle;

namespace {

/// Decaying sines and a sweep in closed form, so that NumPy can make the same.
std::vector<float> known_sound() {
  std::vector<float> x(24000);
  for (std::size_t i = 0; i < x.size(); ++i) {
    const double n = static_cast<double>(i), w = 2 * std::numbers::pi * n / 48000;
    x[i] = static_cast<float>(std::exp(-n / 2000) * (std::sin(1000 * w) + 0.5 * std::sin(5000 * w)) +
                              0.05 * std::exp(-n / 6000) * std::sin(0.00006 * n * n));
  }
  return x;
}

std::vector<float> noise(std::size_t count, std::uint64_t seed) {
  dsp::Random random(seed);
  std::vector<float> x(count);
  for (float& v : x) v = static_cast<float>(0.1 * random.normal());
  return x;
}

}  // namespace

TEST_CASE("Features agree with an independent implementation on a known sound") {
  // NumPy and SciPy in double precision: metrics.features().
  const auto features = dsp::sound_features(known_sound(), 48000);
  CHECK(features.centroid_hz == Approx(2566.51348).epsilon(0.002));
  CHECK(features.bandwidth_hz == Approx(2050.41418).epsilon(0.002));
  CHECK(features.decay_s == Approx(0.15));
  CHECK(features.kurtosis == Approx(10.40977).epsilon(0.002));
  const double expected[] = {-45.7709, 8.5852, -9.6334, -1.775,  -29.2352, 9.2029, 3.1766,
                             2.1206,   9.5598, -5.1524, -5.5752, 0.8362,   -3.9511};
  for (std::size_t c = 0; c < features.mfcc.size(); ++c) CHECK(features.mfcc[c] == Approx(expected[c]).margin(0.05));

  const auto frames = dsp::mfcc(known_sound(), 48000);
  REQUIRE(frames.frames == 45);
  CHECK(frames.frame(3)[0] == Approx(-29.62867).margin(0.05));
  CHECK(frames.frame(3)[4] == Approx(-20.85735).margin(0.05));
  CHECK(frames.frame(10)[2] == Approx(-14.16761).margin(0.05));
}

TEST_CASE("MFCC: level moves coefficient 0 only, a mean does not depend on level") {
  const auto x = noise(48000, 3);
  auto louder = x;
  for (float& v : louder) v *= 4;
  const auto soft = dsp::mfcc(x, 48000), loud = dsp::mfcc(louder, 48000);
  REQUIRE(soft.frames == loud.frames);
  for (int i = 0; i < soft.frames; i += 20) {
    CHECK(loud.frame(i)[0] - soft.frame(i)[0] == Approx(2 * std::log(4.0) * std::sqrt(26.0)).margin(1e-3));
    for (std::size_t c = 1; c < 13; ++c) CHECK(loud.frame(i)[c] == Approx(soft.frame(i)[c]).margin(1e-3));
  }
  CHECK(dsp::mfcc_distance(dsp::mean_mfcc(x, 48000), dsp::mean_mfcc(louder, 48000)) < 1e-4);
  CHECK(dsp::mfcc_distance(dsp::mean_mfcc(x, 48000), dsp::mean_mfcc(noise(48000, 4), 48000)) < 0.3);
  auto dark = x;
  for (std::size_t n = 1; n < dark.size(); ++n) dark[n] = 0.9f * dark[n - 1] + 0.1f * x[n];
  CHECK(dsp::mfcc_distance(dsp::mean_mfcc(x, 48000), dsp::mean_mfcc(dark, 48000)) > 3);
}

TEST_CASE("Silence has no features and shorter sounds than a block have some") {
  const auto none = dsp::sound_features(std::vector<float>(4800, 0.0f), 48000);
  CHECK(none.centroid_hz == 0);
  CHECK(none.kurtosis == 0);
  CHECK(dsp::sound_features({}, 48000).centroid_hz == 0);
  CHECK(dsp::without_silence(std::vector<float>(100, 0.0f), 48000).empty());
  const auto brief = noise(100, 1);
  CHECK(dsp::sound_features(brief, 48000).centroid_hz > 1000);
  CHECK(dsp::without_silence(brief, 48000).size() == 100);
}

TEST_CASE("Silence around a sound changes nothing; a decay ends where it has fallen by 30 dB") {
  std::vector<float> x(48000, 0.0f);
  const auto burst = noise(4800, 2);
  const double fall_db_per_s = 300;
  for (std::size_t n = 0; n < burst.size(); ++n)
    x[9600 + n] = burst[n] * static_cast<float>(dsp::db_to_gain(-fall_db_per_s * static_cast<double>(n) / 48000));
  const auto trimmed = dsp::without_silence(x, 48000);
  CHECK(trimmed.data() == x.data() + 9600);
  CHECK(trimmed.size() <= 4800);
  CHECK(dsp::decay_time_s(x, 48000) == Approx(0.1).margin(0.011));
  const auto alone = dsp::sound_features(trimmed, 48000), framed = dsp::sound_features(x, 48000);
  CHECK(alone.centroid_hz == framed.centroid_hz);
  CHECK(alone.mfcc == framed.mfcc);
}

TEST_CASE("Bandwidth of a flat spectrum is its width over the root of twelve") {
  const std::vector<float> flat(1025, 1.0f);
  CHECK(dsp::spectral_bandwidth_hz(flat, 48000, 1000, 7000) == Approx(6000 / std::sqrt(12.0)).epsilon(0.01));
  CHECK(dsp::spectral_bandwidth_hz(std::vector<float>(1025, 0.0f), 48000) == 0);
}

}  // namespace test_features
