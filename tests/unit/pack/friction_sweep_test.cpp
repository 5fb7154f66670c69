#include <catch2/catch.hpp>

#include <cmath>
#include <numeric>
#include <vector>

#include "sound_db/pack/energy_histogram.h"
#include "sound_db/pack/friction_sweep.h"
#include "sound_db/pack/spectra.h"

namespace rustle::pack::friction_sweep_test {
namespace {

constexpr double kBin_hz = 20;  // 48 kHz, 2400

/// Bands at the given centres, each 80 Hz wide, over a floor.
FrictionSweep sweep_of(const std::vector<double>& speeds, const std::vector<double>& centres_hz,
                       const std::vector<double>& gains, double floor_db) {
  FrictionSweep sweep;
  sweep.speeds_m_per_s = speeds;
  for (std::size_t i = 0; i < speeds.size(); ++i) {
    for (std::size_t k = 0; k < sweep.bins(); ++k) {
      const double off = (static_cast<double>(k) * kBin_hz - centres_hz[i]) / 80;
      const double band = std::exp(-0.5 * off * off) + std::pow(10.0, floor_db / 20);
      sweep.magnitudes.push_back(static_cast<float>(gains[i] * band));
    }
    sweep.rms.push_back(noise_rms(sweep.spectrum(i)));
  }
  return sweep;
}

double power_within(const std::vector<float>& magnitudes, double centre_hz, double reach_hz) {
  double inside = 0, all = 0;
  for (std::size_t k = 0; k < magnitudes.size(); ++k) {
    const double power = static_cast<double>(magnitudes[k]) * magnitudes[k];
    all += power;
    if (std::abs(static_cast<double>(k) * kBin_hz - centre_hz) < reach_hz) inside += power;
  }
  return inside / all;
}

TEST_CASE("Half way between two bands the sound is half way between them") {
  for (const double floor_db : {-41.0, -50.0, -60.0, -200.0}) {
    const auto sweep = sweep_of({0.2, 0.6}, {1000, 3000}, {1, 1}, floor_db);
    const FrictionSpectra spectra(sweep);
    std::vector<float> middle(sweep.bins());
    spectra.at(0.4, middle);
    CAPTURE(floor_db);
    CHECK(power_within(middle, 2000, 300) >= 0.95);
    CHECK(power_within(middle, 1000, 300) < 0.01);
    CHECK(power_within(middle, 3000, 300) < 0.01);
  }
}

TEST_CASE("The level is linear between speeds, falls with the square below and stays above") {
  const auto sweep = sweep_of({0.2, 0.6, 1.0}, {1000, 3000, 4000}, {0.1, 0.3, 0.5}, -50);
  const FrictionSpectra spectra(sweep);
  std::vector<float> out(sweep.bins());
  const auto rms_at = [&](double speed) {
    spectra.at(speed, out);
    return noise_rms(out);
  };
  for (const double alpha : {0.0, 0.25, 0.5, 0.75}) {
    CHECK(rms_at(0.2 + 0.4 * alpha) == Approx((1 - alpha) * sweep.rms[0] + alpha * sweep.rms[1]).epsilon(1e-5));
    CHECK(friction_rms(sweep, 0.6 + 0.4 * alpha) == Approx((1 - alpha) * sweep.rms[1] + alpha * sweep.rms[2]));
  }
  CHECK(rms_at(0.1) == Approx(sweep.rms[0] / 4));
  CHECK(rms_at(0.02) == Approx(sweep.rms[0] / 100));
  CHECK(rms_at(5) == Approx(sweep.rms[2]));
  CHECK(rms_at(0) == 0);
  CHECK(rms_at(-1) == 0);
}

TEST_CASE("At measured speeds the measured spectra") {
  const auto sweep = sweep_of({0.2, 0.6}, {1000, 3000}, {1, 0.3}, -50);
  const FrictionSpectra spectra(sweep);
  std::vector<float> out(sweep.bins());
  for (std::size_t i = 0; i < 2; ++i) {
    spectra.at(sweep.speeds_m_per_s[i] + (i == 0 ? 1e-9 : -1e-9), out);
    for (std::size_t k = 0; k < out.size(); ++k) CHECK(out[k] == Approx(sweep.spectrum(i)[k]).margin(1e-5));
  }
}

TEST_CASE("The peak moves steadily with speed") {
  const auto sweep = sweep_of({0.2, 0.6}, {1000, 3000}, {1, 1}, -80);
  const FrictionSpectra spectra(sweep);
  std::vector<float> out(sweep.bins());
  double before_hz = 0;
  for (double speed = 0.2; speed <= 0.6; speed += 0.05) {
    spectra.at(speed, out);
    const auto peak = std::max_element(out.begin(), out.end()) - out.begin();
    CHECK(static_cast<double>(peak) * kBin_hz == Approx(1000 + (speed - 0.2) * 5000).margin(60));
    CHECK(static_cast<double>(peak) * kBin_hz > before_hz);
    before_hz = static_cast<double>(peak) * kBin_hz;
  }
}

TEST_CASE("The clip is 50 ms at every rate, its hop whole") {
  for (const double rate : {44100.0, 48000.0, 96000.0, 22050.0}) {
    CHECK(friction_clip_length(rate) % 2 == 0);
    CHECK(friction_clip_length(rate) / rate == Approx(0.05).epsilon(0.001));
  }
}

TEST_CASE("Histograms of energies: share and its inverse, held at the ends") {
  std::vector<double> energies;
  for (int i = 0; i <= 300; ++i) energies.push_back(std::pow(10.0, -6 + 4 * i / 300.0));
  const auto histogram = energy_histogram(energies);
  CHECK(histogram.least == Approx(1e-6));
  CHECK(histogram.most == Approx(1e-2));
  CHECK(std::accumulate(histogram.counts.begin(), histogram.counts.end(), 0.0) == 301);
  for (const double share : {0.0, 0.1, 0.5, 0.9, 1.0}) {
    CHECK(cumulative_share(histogram, energy_at(histogram, share)) == Approx(share).margin(1e-9));
  }
  CHECK(energy_at(histogram, 0.5) == Approx(1e-4).epsilon(0.05));
  CHECK(cumulative_share(histogram, 1e-9) == 0);
  CHECK(cumulative_share(histogram, 1) == 1);
  CHECK(energy_histogram(energies, 1e-4).least == Approx(1e-4).epsilon(0.05));

  // An empty stretch: the least energy that reaches the share.
  EnergyHistogram gap{1, 1000, {1, 0, 1}};
  CHECK(energy_at(gap, 0.5) == Approx(10));
  CHECK(energy_at(gap, 0.75) == Approx(std::pow(10.0, 2.5)));

  // Both power laws, other exponents and scales: rank is kept.
  std::vector<double> events;
  for (int i = 1; i <= 400; ++i) events.push_back(30 * std::pow(i / 400.0, -2.5));
  const auto from = energy_histogram(events);
  double before = 0;
  for (double e = 30; e < 30 * std::pow(400.0, 2.5); e *= 1.5) {
    const double matched = matched_energy(from, histogram, e);
    CHECK(matched >= before);
    CHECK(matched >= histogram.least);
    CHECK(matched <= histogram.most);
    before = matched;
  }
  const std::vector<double> equal = {5, 5, 5};
  const auto step = energy_histogram(equal);
  CHECK(cumulative_share(step, 4) == 0);
  CHECK(cumulative_share(step, 6) == 1);
}

}  // namespace
}  // namespace rustle::pack::friction_sweep_test
