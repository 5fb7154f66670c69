#include <catch2/catch.hpp>
#include <complex>
#include <numbers>
#include <vector>

#include "sound_db/dsp/fft.h"
#include "sound_db/dsp/random.h"
#include "sound_db/dsp/window.h"

namespace test_fft {

using namespace rustle;

namespace {

std::vector<float> noise(std::size_t count, std::uint64_t seed) {
  dsp::Random random(seed);
  std::vector<float> x(count);
  for (float& v : x) v = static_cast<float>(random.normal());
  return x;
}

}  // namespace

TEST_CASE("the inverse transform undoes the forward one") {
  for (const int size : {2, 6, 64, 1000, 1024, 4096}) {
    dsp::RealFft fft(size);
    const auto x = noise(static_cast<std::size_t>(size), 7);
    std::vector<std::complex<float>> spectrum(static_cast<std::size_t>(fft.bins()));
    std::vector<float> back(x.size());
    fft.forward(x, spectrum);
    fft.inverse(spectrum, back);
    for (std::size_t n = 0; n < x.size(); ++n) REQUIRE(back[n] == Approx(x[n]).margin(1e-5));
  }
}

TEST_CASE("Parseval: the energy of a signal is that of its spectrum over N") {
  const int size = 1024;
  dsp::RealFft fft(size);
  const auto x = noise(size, 3);
  std::vector<std::complex<float>> spectrum(static_cast<std::size_t>(fft.bins()));
  fft.forward(x, spectrum);
  double time = 0, frequency = 0;
  for (const float v : x) time += static_cast<double>(v) * v;
  for (int k = 0; k < fft.bins(); ++k) frequency += std::norm(spectrum[k]) * (k == 0 || k == size / 2 ? 1.0 : 2.0);
  CHECK(frequency / size == Approx(time).epsilon(1e-5));
}

TEST_CASE("a cosine on a bin lands in that bin alone") {
  const int size = 256;
  dsp::RealFft fft(size);
  for (int n = 0; n < size; ++n) fft.time()[n] = static_cast<float>(std::cos(2 * std::numbers::pi * 19 * n / size));
  fft.forward();
  for (int k = 0; k < fft.bins(); ++k) CHECK(std::abs(fft.spectrum()[k]) == Approx(k == 19 ? size / 2.0 : 0.0).margin(1e-3));
}

TEST_CASE("two plans of one size give the same bits") {
  const auto x = noise(2048, 5);
  dsp::RealFft a(2048), b(2048);
  std::vector<std::complex<float>> p(1025), q(1025);
  a.forward(x, p);
  b.forward(x, q);
  CHECK(p == q);
}

TEST_CASE("squares of the sine window and Hann windows add to one at half overlap") {
  std::vector<float> sine(512), hann(512);
  dsp::sine_window(sine);
  dsp::hann_window(hann);
  for (std::size_t n = 0; n < 256; ++n) {
    CHECK(sine[n] * sine[n] + sine[n + 256] * sine[n + 256] == Approx(1).epsilon(1e-5));
    CHECK(hann[n] + hann[n + 256] == Approx(1).epsilon(1e-5));
  }
}

}  // namespace test_fft
