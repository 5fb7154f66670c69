#include "server/comparison/sound_difference.h"

#include <cmath>
#include <numbers>
#include <random>

#include <catch2/catch.hpp>

namespace sound_difference_test {

using namespace rustle::comparison;

namespace {

constexpr double kRate_hz = 48000;

/// Noise that swells and fades twice a second.
std::vector<float> noise(double gain, unsigned seed, double seconds = 2) {
  std::mt19937 random(seed);
  std::normal_distribution<float> value;
  std::vector<float> out(static_cast<std::size_t>(seconds * kRate_hz));
  for (std::size_t n = 0; n < out.size(); ++n) {
    const double swell = 0.05 + std::pow(std::sin(2 * std::numbers::pi * static_cast<double>(n) / kRate_hz), 2);
    out[n] = static_cast<float>(gain * swell) * value(random);
  }
  return out;
}

}  // namespace

TEST_CASE("a sound is identical to itself, and silence to silence") {
  const auto sound = noise(0.1, 1);
  const auto same = compare_sounds(sound, sound, kRate_hz);
  CHECK(same.identical);
  CHECK(same.level_correlation == Approx(1));
  CHECK(same.mean_level_difference_db == 0);
  CHECK(same.mean_band_difference_db == 0);
  const std::vector<float> silence(4800);
  CHECK(compare_sounds(silence, silence, kRate_hz).level_correlation == 1);
  CHECK(compare_sounds({}, {}, kRate_hz).identical);
}

TEST_CASE("another gain is a difference in level alone") {
  const auto told = compare_sounds(noise(0.1, 1), noise(0.2, 1), kRate_hz);
  CHECK_FALSE(told.identical);
  CHECK(told.other_db - told.reference_db == Approx(6.02).margin(0.01));
  CHECK(told.mean_level_difference_db == Approx(6.02).margin(0.01));
  CHECK(told.level_correlation > 0.999);
  CHECK(told.mean_band_difference_db < 0.01);
  CHECK(told.other_centroid_hz == Approx(told.reference_centroid_hz));
}

TEST_CASE("other noise of the same kind differs little, a low-passed one in its spectrum") {
  const auto reference = noise(0.1, 1);
  const auto alike = compare_sounds(reference, noise(0.1, 2), kRate_hz);
  CHECK(alike.level_correlation > 0.95);
  CHECK(alike.mean_band_difference_db < 1);
  auto dull = noise(0.1, 1);
  float held = 0;
  for (float& x : dull) x = held += 0.1f * (x - held);
  const auto told = compare_sounds(reference, dull, kRate_hz);
  CHECK(told.mean_band_difference_db > 3);
  CHECK(told.other_centroid_hz < 0.8 * told.reference_centroid_hz);
}

TEST_CASE("white noise is as loud in its third octaves as their widths say, and a shorter sound ends in silence") {
  std::mt19937 random(3);
  std::normal_distribution<float> value(0, 0.1f);
  std::vector<float> white(96000);
  for (float& x : white) x = value(random);
  const auto told = compare_sounds(white, std::span(white).first(48000), kRate_hz);
  const auto& bands = told.bands;
  REQUIRE(bands.size() > 24);
  for (std::size_t k = 12; k < 24; ++k) {
    CAPTURE(bands[k].centre_hz);
    CHECK(bands[k + 1].reference_db - bands[k].reference_db == Approx(1).margin(1));
  }
  CHECK(bands[24].reference_db - bands[12].reference_db == Approx(12).margin(0.8));
  CHECK(told.other_track_db.back() < -100);
  CHECK(told.reference_track_db.back() == Approx(-20).margin(0.5));
}

}  // namespace sound_difference_test
