#include <algorithm>
#include <cmath>
#include <cstdint>
#include <vector>

#include <catch2/catch.hpp>

#include "server/synthesis/cloth/unit_stream.h"
#include "sound_db/pack/calibration.h"
#include "tests/unit/cloth/made_up_corpus.h"

namespace rustle::cloth::unit_stream_tests {
namespace {

constexpr std::size_t kUnit = 200;

std::shared_ptr<const PreparedCorpus> prepared_for(Search search, int channels = 1) {
  return std::make_shared<const PreparedCorpus>(made_up::corpus({.channels = channels}), search);
}

/// A target with silence before it and, in the middle, a longer one.
std::vector<float> broken_target(std::uint64_t seed = 50) {
  auto target = made_up::rustling(1.5, 0.05, seed);
  std::fill_n(target.begin(), 30 * kUnit, 0.0F);
  std::fill_n(target.begin() + 150 * kUnit, 100 * kUnit, 0.0F);
  return target;
}

std::vector<PlacedUnit> pushed(UnitStream& stream, const std::vector<std::vector<float>>& target) {
  std::vector<PlacedUnit> out;
  std::vector<std::vector<float>> unit(target.size());
  for (std::size_t first = 0; first + kUnit <= target[0].size(); first += kUnit) {
    for (std::size_t c = 0; c < target.size(); ++c)
      unit[c].assign(target[c].begin() + static_cast<std::ptrdiff_t>(first),
                     target[c].begin() + static_cast<std::ptrdiff_t>(first + kUnit));
    stream.push(unit, out);
  }
  stream.finish(out);
  return out;
}

/// Warped features of a whole target at once.
std::vector<float> warped_features(const PreparedCorpus& corpus, const std::vector<std::vector<float>>& target) {
  const auto measured = pack::target_features(corpus.corpus(), target);
  auto values = corpus.search() == Search::kCausal ? measured.causal : measured.symmetric;
  const std::size_t dims = corpus.corpus().dims();
  for (std::size_t i = 0; i < values.size(); i += dims) {
    const auto row = std::span(values).subspan(i, dims);
    dsp::warp(corpus.features().warp, row, row);
  }
  return values;
}

TEST_CASE("a stream chooses what the whole target's features choose at once") {
  for (const int channels : {1, 2}) {
    const auto corpus = prepared_for(Search::kCausal, channels);
    std::vector<std::vector<float>> target;
    for (int c = 0; c < channels; ++c) target.push_back(made_up::rustling(2, 0.05, 50 + static_cast<std::uint64_t>(c)));
    UnitStream stream(corpus, nullptr);
    // Begun in a recording, as a target is, and not after a silence.
    const auto features = warped_features(*corpus, target);
    const auto whole = select({features, corpus->corpus().dims()}, corpus->index());
    const auto streamed = pushed(stream, target);
    REQUIRE(streamed.size() == whole.size() + 1);
    std::size_t alike = 0, late = 0;
    for (std::size_t i = 0; i < whole.size(); ++i) {
      CHECK(streamed[i].place == static_cast<std::int64_t>(i));
      // The stream has heard silence before: the first features differ until they have forgotten it.
      if (i < corpus->memory_units()) continue;
      ++late;
      alike += streamed[i].choice == whole[i] ? 1 : 0;
    }
    CHECK(alike > late * 95 / 100);  // what cooled off at the beginning was something else
  }
}

TEST_CASE("a stream rests while its target is silent, and chooses after it as if it had gone on") {
  const auto corpus = prepared_for(Search::kCausal);
  UnitStream stream(corpus, nullptr);
  const auto placed = pushed(stream, {broken_target()});
  const auto memory = static_cast<std::int64_t>(corpus->memory_units());
  std::vector<std::int64_t> rests;
  std::int64_t next = 30;
  for (const auto& [place, choice] : placed) {
    if (choice.unit == kNoUnit) {
      rests.push_back(place);
      next = 250;
      continue;
    }
    CHECK(place == next++);
  }
  REQUIRE(rests.size() == 2);
  CHECK(rests[0] == 150 + memory);
  CHECK(rests[1] == 360);
  CHECK(stream.resting());
  CHECK(stream.first_open() == 360);

  // The same after another length of silence.
  auto shorter = broken_target();
  shorter.erase(shorter.begin() + 160 * kUnit, shorter.begin() + 190 * kUnit);
  UnitStream other(corpus, nullptr);
  const auto earlier = pushed(other, {shorter});
  REQUIRE(earlier.size() == placed.size());
  for (std::size_t i = 0; i < placed.size(); ++i) CHECK(earlier[i].choice == placed[i].choice);
}

TEST_CASE("nothing is chosen of silence") {
  UnitStream stream(prepared_for(Search::kCausal), nullptr);
  CHECK(pushed(stream, {std::vector<float>(48000)}).empty());
  CHECK(stream.pushed() == 240);
}

TEST_CASE("a choice comes as soon as its look-ahead is there, and none twice within what cools off") {
  const auto corpus = prepared_for(Search::kCausal);
  UnitStream stream(corpus, nullptr);
  const auto target = made_up::rustling(2, 0.05, 51);
  std::vector<PlacedUnit> out;
  for (std::int64_t i = 0; i < 480; ++i) {
    const auto first = target.begin() + i * static_cast<std::int64_t>(kUnit);
    stream.push(std::vector<std::vector<float>>{{first, first + kUnit}}, out);
    CHECK(static_cast<std::int64_t>(out.size()) == std::max<std::int64_t>(0, i + 1 - 5));
    CHECK(stream.first_open() == static_cast<std::int64_t>(out.size()));
  }
  for (std::size_t i = 0; i < out.size(); ++i) {
    for (std::size_t k = 1; k <= 20 && k <= i; ++k) REQUIRE(out[i].choice.unit != out[i - k].choice.unit);
  }
}

TEST_CASE("symmetric features and the global optimum are those of the whole target") {
  for (const Search search : {Search::kSymmetric, Search::kGlobal}) {
    const auto corpus = prepared_for(search);
    // Between silences, so that both ends are what the stream takes them for.
    auto target = made_up::rustling(1.2, 0.05, 52);
    std::fill_n(target.begin(), 40 * kUnit, 0.0F);
    std::fill(target.end() - 60 * kUnit, target.end(), 0.0F);
    UnitStream stream(corpus, nullptr);
    const auto placed = pushed(stream, {target});
    const auto features = warped_features(*corpus, {target});
    const std::size_t dims = 3, units = 288 - 40 - 60 + corpus->memory_units();
    const FeatureRows sounding{std::span(features).subspan(40 * dims, units * dims), dims};
    const auto whole = search == Search::kGlobal
                           ? select_globally(sounding, corpus->index()->database(), corpus->index()->rules())
                           : select(sounding, corpus->index());
    REQUIRE(placed.size() == whole.size() + 1);
    std::size_t alike = 0;
    for (std::size_t i = 0; i < whole.size(); ++i) alike += placed[i].choice == whole[i] ? 1 : 0;
    CHECK(alike == whole.size());
    CHECK(placed.front().place == 40);
  }
}

TEST_CASE("a corpus is made ready once for all who play it") {
  const auto corpus = made_up::corpus();
  const auto first = prepared(corpus);
  CHECK(prepared(corpus) == first);
  CHECK(prepared(made_up::corpus()) != first);
}

TEST_CASE("latency is declared: 110 ms at most for units of 4.2 ms and a look-ahead of 10") {
  const auto corpus = std::make_shared<const PreparedCorpus>(made_up::corpus({.look_ahead = 10}), Search::kCausal);
  // 11 units, half a unit of join, a clip's hop, a frame and a half at 60 a second.
  CHECK(corpus->latency_samples() == 11 * 200 + 100 + 1200 + 1200);
  CHECK(static_cast<double>(corpus->latency_samples()) / 48000 < 0.110);
}

}  // namespace
}  // namespace rustle::cloth::unit_stream_tests
