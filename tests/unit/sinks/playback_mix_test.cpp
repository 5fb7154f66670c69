#include <catch2/catch.hpp>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

#include "server/sinks/playback_mix.h"

namespace playback_mix_test {

namespace {

using rustle::sinks::PlaybackMix;

constexpr std::uint32_t kRate_hz = 48000;

/// A source of its own pace: what it has produced by a device time, in blocks of 128.
class Tone {
 public:
  Tone(PlaybackMix& mix, std::uint32_t rate_hz, int channels, double frequency_hz, double amplitude = 0.25)
      : mix_(mix),
        id_(mix.add(rate_hz, channels)),
        rate_hz_(rate_hz),
        channels_(channels),
        frequency_hz_(frequency_hz),
        amplitude_(amplitude) {}

  float at(std::size_t frame) const {
    return static_cast<float>(amplitude_ *
                              std::sin(2 * std::numbers::pi * frequency_hz_ * static_cast<double>(frame) / rate_hz_));
  }

  void produce_until(double own_time_s) {
    while (static_cast<double>(produced_ + 128) <= own_time_s * rate_hz_) {
      std::vector<float> block;
      for (std::size_t n = 0; n < 128; ++n)
        block.insert(block.end(), static_cast<std::size_t>(channels_), at(produced_ + n));
      mix_.push(id_, block);
      produced_ += 128;
    }
  }
  PlaybackMix::SourceId id() const { return id_; }

 private:
  PlaybackMix& mix_;
  PlaybackMix::SourceId id_;
  std::uint32_t rate_hz_;
  int channels_;
  double frequency_hz_, amplitude_;
  std::size_t produced_ = 0;
};

/// What the device hears of `tone` over `duration_s` of its own time while the source's clock runs `ppm` fast.
std::vector<float> heard(PlaybackMix& mix, int channels, Tone& tone, double duration_s, double ppm = 0) {
  std::vector<float> out;
  std::vector<float> block(static_cast<std::size_t>(192 * channels));
  for (double t = 0; t < duration_s; t += 192.0 / kRate_hz) {
    tone.produce_until(t * (1 + 1e-6 * ppm));
    mix.mix(block);
    out.insert(out.end(), block.begin(), block.end());
  }
  return out;
}

double rms(const std::vector<float>& samples, std::size_t from, std::size_t to) {
  double sum = 0;
  for (std::size_t n = from; n < to; ++n) sum += static_cast<double>(samples[n]) * samples[n];
  return std::sqrt(sum / static_cast<double>(to - from));
}

TEST_CASE("A source at the device's rate is heard bit for bit behind its cushion") {
  PlaybackMix mix(kRate_hz, 2);
  Tone tone(mix, kRate_hz, 2, 997);
  const auto out = heard(mix, 2, tone, 5);
  CHECK(mix.figures().splices == 0);
  CHECK(mix.figures().samples_in_gaps == 0);
  std::size_t start = 0;
  while (start < out.size() / 2 && out[2 * start] == 0) ++start;
  CHECK(start >= static_cast<std::size_t>(0.025 * kRate_hz));
  CHECK(start <= static_cast<std::size_t>(0.040 * kRate_hz));
  // The first sample of a sine is zero: where it began shows in what follows the fade.
  const std::size_t probe = start + 4800;
  std::size_t offset = 0;
  for (std::size_t shift = probe - start - 4; shift < probe - start + 4; ++shift) {
    if (out[2 * probe] == tone.at(shift)) offset = probe - shift;
  }
  REQUIRE(offset > 0);
  std::size_t wrong = 0;
  for (std::size_t n = probe; n < out.size() / 2; ++n)
    wrong += out[2 * n] != tone.at(n - offset) || out[2 * n + 1] != tone.at(n - offset);
  CHECK(wrong == 0);
}

TEST_CASE("A source that runs fast or slow stays in step for an hour without a gap") {
  const double ppm = GENERATE(-200.0, 200.0);
  PlaybackMix mix(kRate_hz, 1);
  Tone tone(mix, kRate_hz, 1, 440);
  std::vector<float> block(192);
  double quietest = 1;
  const double hour_s = 3600;
  for (double t = 0; t < hour_s; t += 192.0 / kRate_hz) {
    tone.produce_until(t * (1 + 1e-6 * ppm));
    mix.mix(block);
    if (t > 1 && static_cast<int>(t * 250) % 50 == 0) quietest = std::min(quietest, rms(block, 0, 192));
  }
  const auto figures = mix.figures();
  CHECK(figures.samples_in_gaps == 0);
  CHECK(figures.samples_left_out == 0);
  // 200 ppm are 720 ms in an hour, in steps of 10 ms and a little.
  CHECK(figures.splices >= 50);
  CHECK(figures.splices <= 75);
  CHECK(quietest > 0);
}

TEST_CASE("Another rate is resampled, one channel goes to both ears") {
  const std::uint32_t rate_hz = GENERATE(44100u, 96000u);
  PlaybackMix mix(kRate_hz, 2);
  Tone tone(mix, rate_hz, 1, 1000);
  const auto out = heard(mix, 2, tone, 3);
  CHECK(mix.figures().samples_in_gaps == 0);
  const std::size_t from = kRate_hz;
  double sine = 0, cosine = 0, energy = 0;
  for (std::size_t n = from; n < 2 * from; ++n) {
    REQUIRE(out[2 * n] == out[2 * n + 1]);
    const double phase = 2 * std::numbers::pi * 1000.0 * static_cast<double>(n) / kRate_hz;
    sine += out[2 * n] * std::sin(phase);
    cosine += out[2 * n] * std::cos(phase);
    energy += static_cast<double>(out[2 * n]) * out[2 * n];
  }
  const double tone_energy = (sine * sine + cosine * cosine) * 2 / kRate_hz;
  CHECK(energy / kRate_hz == Approx(0.25 * 0.25 / 2).epsilon(0.01));
  CHECK((energy - tone_energy) / energy < 1e-6);
}

TEST_CASE("A source that stalls fades out, counts the gap, and comes in again") {
  PlaybackMix mix(kRate_hz, 1);
  Tone tone(mix, kRate_hz, 1, 440);
  heard(mix, 1, tone, 1);
  std::vector<float> silence(kRate_hz / 2);
  mix.mix(silence);
  CHECK(rms(silence, kRate_hz / 4, kRate_hz / 2) == 0);
  const auto gap = mix.figures().samples_in_gaps;
  CHECK(gap > 0);
  // No step larger than a sine of this pitch makes, but for the fades' own.
  float step = 0;
  for (std::size_t n = 1; n < silence.size(); ++n) step = std::max(step, std::abs(silence[n] - silence[n - 1]));
  CHECK(step < 0.25 * 2 * std::numbers::pi * 440 / kRate_hz + 0.25 / 100);
  PlaybackMix::SourceId id = tone.id();
  std::vector<float> again(kRate_hz / 10, 0.1f);
  mix.push(id, again);
  std::vector<float> out(kRate_hz / 20);
  mix.mix(out);
  CHECK(out[0] < 0.01f);
  CHECK(out[kRate_hz / 25] == 0.1f);
  mix.end(id);
  std::vector<float> rest(kRate_hz / 2);
  mix.mix(rest);
  CHECK(mix.empty());
  CHECK(mix.figures().samples_in_gaps == gap);
}

TEST_CASE("While no device plays nothing waits, and what comes afterwards is heard from a fresh cushion on") {
  PlaybackMix mix(kRate_hz, 1);
  const auto id = mix.add(kRate_hz, 1), ended = mix.add(kRate_hz, 1);
  const std::vector<float> old(kRate_hz / 10, 0.1f), fresh(kRate_hz / 10, 0.2f);
  mix.push(id, old);
  mix.push(ended, old);
  mix.end(ended);
  mix.rest();
  mix.push(id, old);
  mix.turn_to(kRate_hz, 1);
  std::vector<float> out(kRate_hz / 20, 1.0f);
  mix.mix(out);
  CHECK(rms(out, 0, out.size()) == 0);
  mix.push(id, fresh);
  mix.mix(out);
  CHECK(out.back() == 0.2f);
  CHECK(*std::max_element(out.begin(), out.end()) == 0.2f);
  CHECK(mix.figures().samples_in_gaps == 0);
  mix.rest();
  mix.end(id);
  CHECK(mix.empty());
}

TEST_CASE("What comes faster than it is heard is bounded and counted, and many sources stay within full scale") {
  PlaybackMix mix(kRate_hz, 2);
  const auto id = mix.add(kRate_hz, 2);
  for (int k = 0; k < 100; ++k) mix.push(id, std::vector<float>(2 * 4800, 0.9f));
  CHECK(mix.figures().samples_left_out > 9 * kRate_hz);
  const auto other = mix.add(kRate_hz, 1);
  mix.push(other, std::vector<float>(4800, 0.9f));
  std::vector<float> out(2 * 2400);
  mix.mix(out);
  for (const float sample : out) REQUIRE(std::abs(sample) <= 1.0f);
  CHECK(out[2 * 2000] > 0.9f);
}

}  // namespace

}  // namespace playback_mix_test
