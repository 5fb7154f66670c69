#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <vector>

#include <catch2/catch.hpp>

#include "server/synthesis/cloth/contact_track.h"
#include "server/synthesis/cloth/friction_powers.h"
#include "server/synthesis/cloth/monotone_cubic.h"
#include "server/synthesis/cloth/target_signal.h"
#include "sound_db/pack/spectra.h"
#include "tests/unit/cloth/made_up_corpus.h"

namespace rustle::cloth::target_tests {
namespace {

using made_up::CorpusOptions;

std::shared_ptr<const PreparedCorpus> prepared_with(const CorpusOptions& options) {
  return std::make_shared<const PreparedCorpus>(made_up::corpus(options), Search::kCausal);
}

std::vector<ContactSample> contacts(std::uint32_t count, float speed, float area_m2, std::uint32_t patch = 0) {
  std::vector<ContactSample> out;
  for (std::uint32_t v = 0; v < count; ++v) out.push_back({v, speed, area_m2 / static_cast<float>(count), patch});
  return out;
}

/// Speeds of a vertex at a time, 0 where it does not slide.
double speed_at(const ContactTrack& track, std::int64_t time, std::uint32_t vertex) {
  double speed = 0;
  track.at(time, [&](const ContactSample& sample) {
    if (sample.vertex == vertex) speed = static_cast<double>(sample.speed_m_per_s);
  });
  return speed;
}

double rms(std::span<const float> x) {
  double sum = 0;
  for (const float s : x) sum += static_cast<double>(s) * s;
  return std::sqrt(sum / static_cast<double>(x.size()));
}

/// A patch that slides steadily.
std::vector<float> steady(const std::shared_ptr<const PreparedCorpus>& corpus, std::uint32_t vertices, double speed,
                          double area_m2, double seconds, std::uint64_t seed = 1) {
  ContactTrack track(0);
  const auto samples = static_cast<std::int64_t>(seconds * 48000);
  for (std::int64_t at = 0; at <= samples + 9600; at += 800)
    track.add(at, contacts(vertices, static_cast<float>(speed), static_cast<float>(area_m2)));
  TargetSignal target(corpus, seed, 1);
  target.advance(track, samples + 2400);
  std::vector<float> out(static_cast<std::size_t>(samples));
  target.read(0, 0, out);
  return out;
}

TEST_CASE("the cubic between samples is PCHIP's") {
  // Slopes by hand: 10/9 and 0 between others, 2.72 at an end, 4.25 at a beginning.
  const std::array<double, 4> t{0, 1, 2.5, 3}, y{0.2, 1, 4, 3.5};
  CHECK(monotone_cubic({t, y, true, true}, 1.3) == Approx(1.525333333));
  CHECK(monotone_cubic({t, y, true, true}, 2.0) == Approx(3.345679012));
  CHECK(monotone_cubic({t, y, true, false}, 1.3) == Approx(1.394773333));
  CHECK(monotone_cubic({t, y, true, false}, 2.0) == Approx(2.741234568));
  CHECK(monotone_cubic({t, y, false, true}, 1.3) == Approx(2.128));
  CHECK(monotone_cubic({t, y, false, true}, 2.0) == Approx(3.694444444));
  CHECK(monotone_cubic({t, y, false, false}, 2.0) == Approx(3.0));
}

TEST_CASE("speeds between frames stay between those of the frames, and zero between zeros") {
  dsp::Random random(4);
  for (int trial = 0; trial < 2000; ++trial) {
    TrackInterval interval;
    double at = 0;
    for (std::size_t k = 0; k < 4; ++k) {
      interval.at[k] = at += random.uniform(1, 900);
      interval.value[k] = random.uniform() < 0.3 ? 0 : random.uniform();
    }
    interval.before = random.uniform() < 0.8;
    interval.after = random.uniform() < 0.8;
    const auto [low, high] = std::minmax(interval.value[1], interval.value[2]);
    for (double share = 0; share <= 1; share += 0.05) {
      const double v = monotone_cubic(interval, std::lerp(interval.at[1], interval.at[2], share));
      REQUIRE(v >= low - 1e-12);
      REQUIRE(v <= high + 1e-12);
    }
  }
}

TEST_CASE("a vertex is silent until it has been faster than the threshold, without contact, and nowhere else") {
  ContactTrack track(0.2);
  track.add(0, {{3, 0.1F, 1, 0}, {5, 0.5F, 1, 0}});
  track.add(800, {{3, 0.15F, 1, 0}, {5, 0.5F, 1, 0}});
  track.add(1600, {{3, 0.3F, 1, 0}});
  track.add(2400, {{3, 0.1F, 1, 0}});
  CHECK(speed_at(track, 0, 3) == 0);
  CHECK(speed_at(track, 800, 3) == 0);
  CHECK(speed_at(track, 1600, 3) == Approx(0.3F));
  CHECK(speed_at(track, 2400, 3) == Approx(0.1F));
  CHECK(speed_at(track, 400, 5) == Approx(0.5F));
  CHECK(speed_at(track, 1200, 5) > 0);
  CHECK(speed_at(track, 1600, 5) == 0);
  CHECK(track.settled_at(1600));
  CHECK_FALSE(track.settled_at(1601));
}

TEST_CASE("contacts follow the material to a mesh made anew") {
  ContactTrack track(0.2);
  track.add(0, {{0, 0.5F, 2, 0}, {1, 0.1F, 1, 0}});
  track.add(800, {{0, 0.4F, 2, 0}, {1, 0.1F, 1, 0}});
  const std::vector<std::uint32_t> origins{1, 0, 0};  // the loud vertex has become two, 1 and 2
  track.renumber(origins);
  track.add(1600, {{0, 0.1F, 1, 0}, {1, 0.1F, 1, 0}, {2, 0.3F, 1, 0}});
  CHECK(speed_at(track, 1600, 0) == 0);  // it has still not been fast
  CHECK(speed_at(track, 1600, 1) == Approx(0.1F));
  CHECK(speed_at(track, 800, 1) == Approx(0.4F));
  CHECK(speed_at(track, 1200, 2) > 0.3);
  CHECK(speed_at(track, 1200, 2) < 0.4);
  double area = 0;
  track.at(1200, [&](const ContactSample& sample) { area += static_cast<double>(sample.area_m2); });
  CHECK(area == Approx(2));  // not 3 or 4: the new mesh says how large they are
}

TEST_CASE("vertices of which nothing is known have slid as they do now") {
  ContactTrack track(0);
  track.add(0, {{0, 0.5F, 1, 0}});
  track.add(800, {{0, 0.5F, 1, 0}});
  track.forget_vertices();
  track.add(1600, {{7, 0.3F, 1, 0}});
  CHECK(speed_at(track, 1200, 7) == Approx(0.3F));
  CHECK(speed_at(track, 1200, 0) == 0);
}

TEST_CASE("rows of power follow the spectra by speed") {
  const auto corpus = made_up::corpus();
  const FrictionPowers powers(corpus->friction);
  const pack::FrictionSpectra spectra(corpus->friction);
  std::vector<float> power(powers.bins()), magnitudes(powers.bins());
  for (const double speed : {0.02, 0.07, 0.1, 0.17, 0.39, 0.4, 0.77, 1.0, 3.0}) {
    std::vector<double> weights(powers.rows());
    powers.weigh(speed, 2.0, weights);
    powers.sum(weights, power);
    spectra.at(speed, magnitudes);
    double ours = 0, theirs = 0, apart = 0;
    for (std::size_t k = 0; k < power.size(); ++k) {
      const double p = 2.0 * static_cast<double>(magnitudes[k]) * magnitudes[k];
      ours += power[k];
      theirs += p;
      apart += std::abs(static_cast<double>(power[k]) - p);
    }
    INFO(speed << " m/s");
    CHECK(std::abs(10 * std::log10(ours / theirs)) < 0.1);
    CHECK(apart / theirs < 0.02);
  }
  std::vector<double> none(powers.rows());
  powers.weigh(0, 1, none);
  CHECK(std::ranges::all_of(none, [](double w) { return w == 0; }));
}

TEST_CASE("friction is as loud as measured, whatever the resolution, and does not ripple") {
  const auto corpus = prepared_with({});
  const double patch = corpus->corpus().friction.patch_area_m2;
  const double expected = 2 * pack::friction_rms(corpus->corpus().friction, 0.3);
  const auto coarse = steady(corpus, 5, 0.3, 4 * patch, 4), fine = steady(corpus, 2000, 0.3, 4 * patch, 4);
  CHECK(20 * std::log10(rms(coarse) / expected) == Approx(0).margin(0.3));
  CHECK(20 * std::log10(rms(fine) / rms(coarse)) == Approx(0).margin(0.01));
  // Mean power by the place within a hop, over many seeds.
  std::vector<double> power(1200);
  for (std::uint64_t seed = 0; seed < 60; ++seed) {
    const auto sound = steady(corpus, 1, 0.3, patch, 2, seed);
    for (std::size_t n = 0; n < sound.size(); ++n) power[n % 1200] += static_cast<double>(sound[n]) * sound[n];
  }
  std::vector<double> eighths(8);
  for (std::size_t n = 0; n < power.size(); ++n) eighths[n / 150] += power[n];
  const auto [low, high] = std::ranges::minmax(eighths);
  CHECK(10 * std::log10(high / low) < 0.3);
}

TEST_CASE("compressed speeds sound as those that they become") {
  const auto as_it_is = prepared_with({}), compressed = prepared_with({.compression = {4, 1.5}});
  CHECK(steady(compressed, 3, 1.0, 0.01, 0.2) == steady(as_it_is, 3, 0.125, 0.01, 0.2));
  CHECK(steady(compressed, 3, 0.0, 0.01, 0.2) == steady(as_it_is, 3, 0.0, 0.01, 0.2));
}

TEST_CASE("noise is its own for every seed and patch, and the same for the same") {
  const auto corpus = prepared_with({});
  CHECK(steady(corpus, 3, 0.3, 0.01, 0.2) == steady(corpus, 3, 0.3, 0.01, 0.2));
  CHECK(steady(corpus, 3, 0.3, 0.01, 0.2, 1) != steady(corpus, 3, 0.3, 0.01, 0.2, 2));
  ContactTrack track(0);
  auto both = contacts(1, 0.3F, 0.01F, 0);
  both.push_back({9, 0.3F, 0.01F, 1});
  for (std::int64_t at = 0; at < 9600; at += 800) track.add(at, both);
  TargetSignal target(corpus, 1, 2);
  target.advance(track, 7200);
  std::vector<float> a(4800), b(4800);
  target.read(0, 0, a);
  target.read(1, 0, b);
  CHECK(rms(a) > 0);
  double product = 0;
  for (std::size_t n = 0; n < a.size(); ++n) product += static_cast<double>(a[n]) * b[n];
  CHECK(std::abs(product / (4800 * rms(a) * rms(b))) < 0.2);
}

TEST_CASE("a crumpling unit sounds from its onset on, as it is; one that comes too late at once") {
  const auto corpus = prepared_with({});
  const auto& sound = corpus->corpus().crumpling->units[2].samples;
  TargetSignal target(corpus, 1, 2);
  ContactTrack track(0);
  target.pop(1000, 1, 2);
  target.advance(track, 3601);
  CHECK(target.settled() == 3600);
  target.pop(3000, 1, 2);
  std::vector<float> heard(6000), other(6000);
  target.read(1, 0, heard);
  target.read(0, 0, other);
  CHECK(std::equal(sound.begin(), sound.end(), heard.begin() + 1000));
  CHECK(std::equal(sound.begin(), sound.end(), heard.begin() + 3600));
  CHECK(rms(std::span(heard).subspan(1000 + sound.size(), 2600 - sound.size())) == 0);
  CHECK(rms(other) == 0);
}

TEST_CASE("two ears hear patches through their own filters") {
  const auto corpus = prepared_with({.channels = 2});
  TargetSignal target(corpus, 1, 2, 2);
  std::vector<float> near(100), far(100);
  near[10] = 1;
  far[40] = 0.25F;
  target.hear_through(1, std::vector<std::vector<float>>{near, far});
  const auto& sound = corpus->corpus().crumpling->units[2].samples;
  target.pop(500, 1, 2);
  ContactTrack track(0);
  for (std::int64_t at = 0; at < 48000; at += 800)
    track.add(at, at < 9600 ? contacts(0, 0, 0) : contacts(4, 0.3F, 0.01F, 1));
  target.advance(track, 36001);
  std::vector<float> left(36000), right(36000);
  target.read(0, 0, left);
  target.read(1, 0, right);
  for (std::size_t n = 0; n < sound.size(); ++n) {
    REQUIRE(left[510 + n] == Approx(sound[n]));
    REQUIRE(right[540 + n] == Approx(0.25F * sound[n]).margin(1e-7));
  }
  const double ratio = rms(std::span(left).last(24000)) / rms(std::span(right).last(24000));
  CHECK(20 * std::log10(ratio) == Approx(12.04).margin(0.2));
}

}  // namespace
}  // namespace rustle::cloth::target_tests
