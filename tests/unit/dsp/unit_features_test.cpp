#include <catch2/catch.hpp>

#include <cmath>
#include <numbers>
#include <vector>

#include "sound_db/dsp/random.h"
#include "sound_db/dsp/resample.h"
#include "sound_db/dsp/unit_features.h"

namespace rustle::dsp::unit_features_test {
namespace {

std::vector<float> noise(std::size_t count, double level, std::uint64_t seed) {
  Random random(seed);
  std::vector<float> result(count);
  for (float& x : result) x = static_cast<float>(level * random.normal());
  return result;
}

std::vector<double> means(const std::vector<float>& features) {
  std::vector<double> mean(kUnitFeatures);
  for (std::size_t i = 0; i < features.size(); ++i) mean[i % kUnitFeatures] += features[i];
  for (double& m : mean) m *= kUnitFeatures / static_cast<double>(features.size());
  return mean;
}

/// The three bands' mean squares back from the features.
std::vector<double> band_powers(std::span<const float> features) {
  std::vector<double> powers;
  for (int b = 0; b < kUnitFeatures; ++b) {
    double logarithm = features[0] / std::sqrt(3.0);
    for (int c = 1; c < kUnitFeatures; ++c) {
      logarithm +=
          std::sqrt(2.0 / 3) * std::cos(std::numbers::pi * c * (b + 0.5) / 3) * features[static_cast<std::size_t>(c)];
    }
    powers.push_back(std::exp(logarithm));
  }
  return powers;
}

TEST_CASE("A unit's length follows the rate and is even") {
  CHECK(unit_length(1.0 / 240, 48000) == 200);
  CHECK(unit_length(1.0 / 240, 96000) == 400);
  CHECK(unit_length(1.0 / 240, 44100) == 184);
  CHECK(unit_length(1.0 / 60, 48000) == 800);
  CHECK(unit_length(1.0 / 60, 44100) % 2 == 0);
}

TEST_CASE("A sine's mean square lies in the band that holds it") {
  // Band edges of three equal parts of mel(20 kHz): 1549 Hz and 6526 Hz.
  const struct {
    double frequency_hz;
    std::size_t band;
  } cases[] = {{960, 0}, {3840, 1}, {12000, 2}};
  for (const auto& [frequency_hz, band] : cases) {
    std::vector<float> unit(200), features(kUnitFeatures);
    for (std::size_t n = 0; n < unit.size(); ++n) {
      unit[n] = static_cast<float>(0.5 * std::sin(2 * std::numbers::pi * frequency_hz * static_cast<double>(n) / 48000));
    }
    UnitFeatures measure(200, 48000);
    measure(unit, features);
    const auto powers = band_powers(features);
    CAPTURE(frequency_hz, powers);
    CHECK(powers[band] == Approx(0.125).epsilon(0.02));
    for (std::size_t other = 0; other < powers.size(); ++other) CHECK((other == band || powers[other] < 1e-4));
  }
}

TEST_CASE("Silence gives the floor, 5 dB more moves the first feature by 2") {
  const std::vector<float> silence(200);
  const auto floor = unit_features(silence, 200, 48000);
  CHECK(floor[0] == Approx(std::sqrt(3.0) * std::log(1e-10)));
  CHECK(std::abs(floor[1]) < 1e-4);
  CHECK(std::abs(floor[2]) < 1e-4);

  const auto quiet = noise(20000, 0.05, 1);
  auto loud = quiet;
  for (float& x : loud) x *= static_cast<float>(std::pow(10.0, 5.0 / 20));
  const auto a = unit_features(quiet, 200, 48000), b = unit_features(loud, 200, 48000);
  REQUIRE(a.size() == 100 * kUnitFeatures);
  for (std::size_t j = 0; j < a.size(); j += kUnitFeatures) {
    CHECK(b[j] - a[j] == Approx(1.994).margin(0.002));
    CHECK(b[j + 1] - a[j + 1] == Approx(0).margin(1e-3));
  }
}

TEST_CASE("The same sound has the same features at every rate") {
  // Low-passed as recordings are: nothing near either Nyquist frequency.
  const auto at_48 = resample(resample(noise(48000, 0.1, 2), 48000, 32000), 32000, 48000);
  const auto reference = unit_features(at_48, 200, 48000);
  const auto at_96 = unit_features(resample(at_48, 48000, 96000), 400, 96000);
  for (std::size_t i = 30; i + 30 < std::min(reference.size(), at_96.size()); ++i) {
    CHECK(at_96[i] == Approx(reference[i]).margin(0.05));
  }
  const auto at_44 = means(unit_features(resample(at_48, 48000, 44100), 184, 44100));
  for (std::size_t c = 0; c < at_44.size(); ++c) CHECK(at_44[c] == Approx(means(reference)[c]).margin(0.15));
}

TEST_CASE("Temporal filtering keeps a constant, does not cross recordings, and the causal one sees no future") {
  const std::vector<std::uint32_t> first_unit = {0, 100, 160};
  const std::vector<int> widths = {20, 50, 10};
  std::vector<float> features(160 * 3, 2.5F);
  for (const bool causal : {false, true}) {
    for (const float x : filtered_features(features, 3, widths, first_unit, causal)) CHECK(x == Approx(2.5F));
  }
  for (std::size_t i = 100 * 3; i < features.size(); ++i) features[i] = -7;
  for (const bool causal : {false, true}) {
    const auto filtered = filtered_features(features, 3, widths, first_unit, causal);
    CHECK(filtered[99 * 3] == Approx(2.5F));
    CHECK(filtered[100 * 3] == Approx(-7.0F));
  }
  std::vector<float> step(160 * 3, 0.0F);
  for (std::size_t i = 50 * 3; i < step.size(); ++i) step[i] = 1;
  const auto causal = filtered_features(step, 3, widths, first_unit, true);
  const auto symmetric = filtered_features(step, 3, widths, first_unit, false);
  for (std::size_t d = 0; d < 3; ++d) {
    CHECK(causal[49 * 3 + d] == 0);
    CHECK(causal[50 * 3 + d] > 0);
    CHECK(symmetric[49 * 3 + d] > 0);
    const auto half = static_cast<std::size_t>(widths[d] / 2);
    CHECK(symmetric[(50 - half - 1) * 3 + d] == 0);
    CHECK(causal[(50 + half) * 3 + d] == Approx(1));
  }
}

TEST_CASE("Filtered unit by unit, the same bits") {
  const std::vector<int> widths = {20, 50, 10};
  std::vector<float> features = noise(120 * 6, 3, 4);
  const std::vector<std::uint32_t> first_unit = {0, 70, 120};
  const auto whole = filtered_features(features, 6, widths, first_unit, true);
  CausalFeatureFilter filter(6, widths);
  std::vector<float> out(6);
  for (std::size_t i = 0; i < 120; ++i) {
    if (i == 70) filter.reset();
    filter.push(std::span(features).subspan(i * 6, 6), out);
    for (std::size_t d = 0; d < 6; ++d) REQUIRE(out[d] == whole[i * 6 + d]);
  }
}

}  // namespace
}  // namespace rustle::dsp::unit_features_test
