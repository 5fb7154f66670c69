#include <catch2/catch.hpp>
#include <cmath>
#include <numbers>
#include <vector>

#include "sound_db/dsp/filter.h"
#include "sound_db/dsp/level.h"
#include "sound_db/dsp/random.h"
#include "sound_db/dsp/resample.h"
#include "sound_db/dsp/statistics.h"
#include "sound_db/dsp/stft.h"

namespace test_signal {

using namespace rustle;

namespace {

std::vector<float> sine(double frequency_hz, double rate_hz, std::size_t count, double amplitude = 1) {
  std::vector<float> x(count);
  for (std::size_t n = 0; n < count; ++n) {
    x[n] = static_cast<float>(amplitude * std::sin(2 * std::numbers::pi * frequency_hz * static_cast<double>(n) / rate_hz));
  }
  return x;
}

}  // namespace

TEST_CASE("levels of a sine: peak 0, RMS -3 dBFS; silence reads the floor") {
  const auto x = sine(1000, 48000, 48000);
  CHECK(dsp::peak_dbfs(x) == Approx(0).margin(0.01));
  CHECK(dsp::rms_dbfs(x) == Approx(-3.01).margin(0.01));
  CHECK(dsp::rms_dbfs(std::vector<float>(100, 0.0f)) == dsp::kSilenceDb);
  CHECK(dsp::rms_dbfs({}) == dsp::kSilenceDb);
}

TEST_CASE("Butterworth filters have their -3 dB point, slope and pass band") {
  for (const double rate : {44100.0, 48000.0, 96000.0}) {
    const auto high = dsp::butterworth_highpass(5, 100, rate);
    CHECK(dsp::gain_to_db(dsp::magnitude(high, 100, rate)) == Approx(-3.01).margin(0.01));
    CHECK(dsp::gain_to_db(dsp::magnitude(high, 50, rate)) == Approx(-30.1).margin(0.3));
    CHECK(dsp::gain_to_db(dsp::magnitude(high, 1000, rate)) == Approx(0).margin(0.01));
    const auto low = dsp::butterworth_lowpass(2, 10000, rate);
    CHECK(dsp::gain_to_db(dsp::magnitude(low, 10000, rate)) == Approx(-3.01).margin(0.01));
    CHECK(dsp::gain_to_db(dsp::magnitude(low, 100, rate)) == Approx(0).margin(0.01));
    const auto band = dsp::butterworth_bandpass(1000, 4000, rate);
    CHECK(dsp::gain_to_db(dsp::magnitude(band, 1000, rate)) == Approx(-3.01).margin(0.01));
    CHECK(dsp::gain_to_db(dsp::magnitude(band, 4000, rate)) == Approx(-3.01).margin(0.01));
  }
}

TEST_CASE("a filtered sine has the level the transfer function says, block by block or whole") {
  const auto cascade = dsp::butterworth_highpass(5, 2000, 48000);
  auto whole = sine(1500, 48000, 48000);
  auto parts = whole;
  dsp::CascadeState a, b;
  dsp::filter(cascade, a, whole);
  for (std::size_t at = 0; at < parts.size(); at += 100) dsp::filter(cascade, b, std::span(parts).subspan(at, 100));
  CHECK(whole == parts);
  const double level = dsp::rms_dbfs(std::span(whole).subspan(4800)) + 3.0103;
  CHECK(level == Approx(dsp::gain_to_db(dsp::magnitude(cascade, 1500, 48000))).margin(0.02));
}

TEST_CASE("a resampled sine is that sine at the new rate") {
  for (const double to : {44100.0, 96000.0, 16000.0}) {
    const auto out = dsp::resample(sine(3000, 48000, 24000, 0.5), 48000, to);
    REQUIRE(out.size() == static_cast<std::size_t>(to / 2));
    const auto expected = sine(3000, to, out.size(), 0.5);
    for (std::size_t n = out.size() / 4; n < out.size() * 3 / 4; ++n) REQUIRE(out[n] == Approx(expected[n]).margin(2e-4));
  }
}

TEST_CASE("the spectrogram dates and tunes a burst") {
  std::vector<float> x(48000, 0.0f);
  const auto tone = sine(6000, 48000, 4800);
  std::copy(tone.begin(), tone.end(), x.begin() + 24000);
  const auto s = dsp::power_spectrogram(x, 48000, 1024, 256);
  CHECK(s.bins == 513);
  CHECK(s.frames == 48000 / 256 + 1);
  const int frame = static_cast<int>(0.55 / s.hop_s), bin = static_cast<int>(6000 / s.bin_hz);
  CHECK(s.at(frame, bin) == Approx(0).margin(0.1));
  CHECK(s.at(frame, bin * 2) < -60);
  CHECK(s.at(static_cast<int>(0.45 / s.hop_s), bin) < -100);
}

TEST_CASE("the quadratic-form distance equals its definition and orders spectra by how far their mass moved") {
  dsp::Random random(4);
  std::vector<double> p(64), q(64);
  double sum_p = 0, sum_q = 0;
  for (std::size_t i = 0; i < 64; ++i) {
    sum_p += p[i] = random.uniform();
    sum_q += q[i] = random.uniform() * random.uniform();
  }
  for (double& v : p) v /= sum_p;
  for (double& v : q) v /= sum_q;
  double form = 0;
  for (int i = 0; i < 64; ++i) {
    for (int j = 0; j < 64; ++j) form += (p[i] - q[i]) * (1 - std::abs(i - j) / 63.0) * (p[j] - q[j]);
  }
  CHECK(dsp::quadratic_form_distance(p, q) == Approx(std::sqrt(form)).epsilon(1e-9));
  CHECK(dsp::quadratic_form_distance(p, p) == 0);

  const auto near = dsp::spectrum_distance(sine(3000, 48000, 9600), sine(4000, 48000, 9600));
  const auto far = dsp::spectrum_distance(sine(3000, 48000, 9600), sine(9000, 48000, 9600));
  CHECK(near < far);
  // One line moved by d of N bins: √(2 d / (N-1)); 6 kHz of 24 kHz are 64 bins of 256.
  CHECK(far == Approx(std::sqrt(2.0 * 64 / 255)).epsilon(0.02));
}

TEST_CASE("histograms keep area; the centroid of a line is its frequency; kurtosis tells noise from clicks") {
  std::vector<float> magnitudes(513, 0.0f);
  magnitudes[100] = 2.0f;
  const auto histogram = dsp::spectrum_histogram(magnitudes);
  double sum = 0;
  for (const double h : histogram) sum += h;
  CHECK(sum == Approx(1));
  CHECK(dsp::spectral_centroid_hz(magnitudes, 48000) == Approx(100 * 46.875));
  dsp::Random random(8);
  std::vector<float> noise(100000), clicks(100000, 0.0f);
  for (float& v : noise) v = static_cast<float>(random.normal());
  for (std::size_t i = 0; i < clicks.size(); i += 100) clicks[i] = 1;
  CHECK(dsp::kurtosis(noise) == Approx(3).margin(0.1));
  CHECK(dsp::kurtosis(clicks) > 50);
}

}  // namespace test_signal
