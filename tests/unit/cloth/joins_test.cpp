#include <algorithm>
#include <cmath>
#include <cstdint>
#include <numeric>
#include <vector>

#include <catch2/catch.hpp>

#include "server/synthesis/cloth/joins.h"
#include "sound_db/dsp/filter.h"
#include "sound_db/dsp/random.h"

namespace rustle::cloth::joins_test {
namespace {

constexpr std::uint32_t kUnit = 200;

/// Coloured noise without what lies below 100 Hz, like a recording of cloth.
std::vector<float> recording(std::size_t samples, std::uint64_t seed = 1) {
  dsp::Random random(seed);
  std::vector<float> out(samples);
  for (float& x : out) x = static_cast<float>(0.1 * random.normal());
  for (const auto& filter : {dsp::butterworth_lowpass(3, 800, 48000), dsp::butterworth_highpass(5, 100, 48000)}) {
    dsp::CascadeState state;
    dsp::filter(filter, state, out);
  }
  return out;
}

std::vector<Choice> as_choices(const std::vector<std::uint32_t>& units) {
  std::vector<Choice> out;
  for (const std::uint32_t unit : units) out.push_back({unit, false});
  return out;
}

std::vector<Choice> random_choices(std::size_t count, std::uint32_t units) {
  dsp::Random random(9);
  std::vector<std::uint32_t> out(count);
  for (auto& unit : out) unit = random.index(units);
  return as_choices(out);
}

/// 99.9th percentile, in dB, of steps at these places (the largest of three) over the RMS step of the 2 ms on either side.
double loudest_steps_db(const std::vector<float>& signal, const std::vector<std::int64_t>& places) {
  constexpr std::int64_t kHalf = 96;
  std::vector<double> squares(signal.size() + 1), steps(signal.size());
  for (std::size_t n = 1; n < signal.size(); ++n)
    steps[n] = std::abs(static_cast<double>(signal[n]) - static_cast<double>(signal[n - 1]));
  for (std::size_t n = 0; n < signal.size(); ++n) squares[n + 1] = squares[n] + steps[n] * steps[n];
  std::vector<double> out;
  for (const std::int64_t place : places) {
    if (place <= kHalf || place >= static_cast<std::int64_t>(signal.size()) - kHalf - 2) continue;
    const auto p = static_cast<std::size_t>(place);
    const double around = (squares[p + kHalf + 1] - squares[p - kHalf]) / (2 * kHalf + 1);
    if (around > 1e-14) out.push_back(20 * std::log10(std::max({steps[p - 1], steps[p], steps[p + 1]}) / std::sqrt(around)));
  }
  std::ranges::sort(out);
  return out[static_cast<std::size_t>(0.999 * static_cast<double>(out.size() - 1))];
}

TEST_CASE("consecutive units are the source again, bit for bit") {
  const auto source = recording(20000);
  const JoinedSource joined({source}, kUnit);
  REQUIRE(joined.units() == 100);
  std::vector<std::uint32_t> units(60);
  std::iota(units.begin(), units.end(), 20U);
  const auto out = concatenated(joined, as_choices(units));
  REQUIRE(out.size() == 60 * kUnit);
  CHECK(std::equal(out.begin(), out.end(), source.begin() + 20 * kUnit));
}

/// The same, quiet, with pops of a millisecond over it.
std::vector<float> crackling(std::size_t samples) {
  auto out = recording(samples);
  dsp::Random random(5);
  for (float& x : out) x *= 0.1F;
  for (std::size_t at = 0; at + kUnit < samples; at += 1 + random.index(10 * kUnit)) {
    const double peak = random.log_uniform(0.01, 0.5);
    for (std::size_t n = 0; n < kUnit; ++n)
      out[at + n] += static_cast<float>(peak * std::exp(-static_cast<double>(n) / 20) * random.normal());
  }
  return out;
}

TEST_CASE("joins step no more than 3 dB louder than any other place") {
  for (const auto& source : {recording(48000 * 20), crackling(48000 * 20)}) {
    const JoinedSource joined({source}, kUnit);
    const auto choices = random_choices(20000, joined.units());
    std::vector<std::int64_t> joins, anywhere;
    const auto out = concatenated(joined, choices, &joins);
    dsp::Random random(3);
    for (int k = 0; k < 40000; ++k) anywhere.push_back(random.index(static_cast<std::uint32_t>(out.size())));
    CHECK(loudest_steps_db(out, joins) <= loudest_steps_db(out, anywhere) + 3);

    std::vector<float> plain;
    std::vector<std::int64_t> edges;
    for (const Choice& choice : choices) {
      edges.push_back(static_cast<std::int64_t>(plain.size()));
      plain.insert(plain.end(), source.begin() + choice.unit * kUnit, source.begin() + (choice.unit + 1) * kUnit);
    }
    CHECK(loudest_steps_db(plain, edges) > loudest_steps_db(out, joins) + 3);
  }
}

TEST_CASE("a run reaches to the nearest gentle change of sign, at most half a unit away") {
  constexpr float kWave[] = {0.1F, 0.2F, 0.5F, 0.2F, 0.1F, -0.1F, -0.2F, -0.5F, -0.2F, -0.1F};
  std::vector<float> source;
  for (std::size_t n = 0; n < 10 * kUnit; ++n) source.push_back(kWave[(n + 2) % 10]);  // changes sign at 3, 8, 13...
  for (std::size_t n = 990; n < 1004; ++n) source[n] *= 10;                            // a pop where unit 5 begins
  std::fill(source.begin() + 1450, source.end(), 0.5F);
  const JoinedSource joined({source}, kUnit);
  CHECK(joined.before(2).count == 2);
  CHECK(joined.before(2).offset == -2);
  CHECK(joined.before(2).samples == source.data() + 398);
  CHECK(joined.after(2).count == 3);
  CHECK(joined.after(2).offset == kUnit);
  CHECK(joined.before(5).count == 12);  // before the pop, though there are nearer changes within it
  CHECK(joined.before(5).samples == source.data() + 988);
  CHECK(joined.after(4).count == 8);  // and after it

  const Piece fading = joined.before(8);  // no change of sign near
  REQUIRE(fading.count == kUnit / 2);
  CHECK(fading.samples[0] < 0.01F);
  CHECK(fading.samples[kUnit / 2 - 1] > 0.49F);
  const Piece out = joined.after(8);
  REQUIRE(out.count == kUnit / 2);
  CHECK(out.samples[0] > 0.49F);
  CHECK(out.samples[kUnit / 2 - 1] < 0.01F);
}

TEST_CASE("runs do not reach into another recording") {
  const auto first = recording(2000, 1), second = recording(2150, 2);
  const JoinedSource joined({first, second}, kUnit);
  REQUIRE(joined.units() == 20);
  CHECK(joined.before(10).count == 0);
  CHECK(joined.after(9).count == 0);
  CHECK(joined.unit(10).samples == second.data());
  CHECK_FALSE(joined.follows(9, 10));
  CHECK(joined.follows(10, 11));
  CHECK_FALSE(joined.follows(19, 20));
}

TEST_CASE("a run that is ended goes on as another, joined like any") {
  const auto source = recording(4000);
  const JoinedSource joined({source}, kUnit);
  RunBuilder runs(joined);
  CHECK(runs.next(4).begins);
  CHECK(runs.goes_on(5));
  CHECK_FALSE(runs.next(5).begins);
  CHECK(runs.finish().count <= 1);
  CHECK(runs.finish().count == 0);
  CHECK_FALSE(runs.goes_on(6));
  CHECK(runs.next(6).begins);
}

}  // namespace
}  // namespace rustle::cloth::joins_test
