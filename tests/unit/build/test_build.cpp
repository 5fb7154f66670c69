#include <catch2/catch.hpp>

#include <algorithm>

#include "folder.h"
#include "sound_db/build/build.h"
#include "sound_db/build/friction_average.h"
#include "sound_db/build/recording.h"
#include "sound_db/build/segment.h"
#include "sound_db/build/unit_search.h"
#include "sound_db/dsp/filter.h"
#include "sound_db/dsp/level.h"
#include "sound_db/pack/check.h"
#include "sound_db/pack/levels.h"
#include "sound_db/pack/load.h"
#include "sound_db/pack/spectra.h"
#include "sound_db/pack/write.h"

namespace test_build {

using namespace rustle;
using namespace rustle::build;
using namespace rustle::build::test;

namespace {

std::string all_of(const pack::Findings& findings) {
  std::string text;
  for (const auto& finding : findings) text += finding.what.text() + "\n";
  return text;
}

std::optional<BuiltPack> built(const Folder& folder, const std::string& manifest, pack::Findings& findings) {
  folder.text("recordings.toml", manifest);
  const auto read = read_build_manifest(folder / "recordings.toml", findings);
  if (!read) return std::nullopt;
  return build_pack(*read, folder.path(), findings);
}

BuiltPack built(const Folder& folder, const std::string& manifest) {
  pack::Findings findings;
  auto result = built(folder, manifest, findings);
  INFO(all_of(findings));
  REQUIRE(result);
  return std::move(*result);
}

std::string take(const std::string& file, const std::string& lines) {
  return "[[recording]]\nfiles = \"" + file + "\"\n" + lines + "\n";
}

PreparedTake prepared(std::vector<float> samples) {
  PreparedTake result;
  result.rate_hz = kRate_hz;
  result.duration_s = static_cast<double>(samples.size()) / kRate_hz;
  result.samples = std::move(samples);
  return result;
}

/// Noise through a band-pass: amplitude per bin is 0.02 |H|.
std::vector<float> coloured_noise(double seconds, const dsp::Cascade& filter, std::uint64_t seed, double rms = 0.02) {
  auto x = silence(seconds);
  add_noise(x, rms, seed);
  dsp::CascadeState state;
  dsp::filter(filter, state, x);
  return x;
}

const std::string kFlap = "class = \"flap\"\nl_r = 0.1\nl_c = 0.2\n";
const std::string kBentSlide = "class = \"slide\"\nl_r = 0.1\nl_c = 0.2\nspeed = 0.1\n";

}  // namespace

TEST_CASE("Windowed power is the mean square around a sample") {
  std::vector<float> x(1000, 0.0f);
  for (std::size_t n = 400; n < 600; ++n) x[n] = 0.5f;
  const auto power = windowed_power(x, 100);
  CHECK(power[500] == Approx(0.25));
  CHECK(power[400] == Approx(0.125));
  CHECK(power[300] == 0);
  CHECK(power[600] == Approx(0.125));
}

TEST_CASE("As many units as bursts, where they are, from zero crossing to zero crossing") {
  const std::vector<double> times_s = {0.2, 0.31, 0.5, 0.9, 1.0, 1.45};
  auto x = silence(2);
  for (std::size_t i = 0; i < times_s.size(); ++i) add_burst(x, times_s[i], 0.3 * std::pow(0.7, i), 0.03, i + 1);
  add_noise(x, 1e-4, 99);
  Take take;
  take.sound_class = SoundClass::kCrumple;
  const auto search = find_units(prepared(x), take);
  REQUIRE(search.units.size() == times_s.size());
  for (std::size_t i = 0; i < times_s.size(); ++i) {
    const auto& unit = search.units[i];
    INFO(i << " " << unit.reason);
    CHECK(unit.reason.empty());
    CHECK(static_cast<double>(unit.segment.begin) / kRate_hz == Approx(times_s[i]).margin(0.001));
    CHECK(unit.segment.length() < 0.06 * kRate_hz);
    CHECK((x[unit.segment.begin - 1] < 0) != (x[unit.segment.begin] < 0));
    CHECK((x[unit.segment.end - 1] < 0) != (x[unit.segment.end] < 0));
    CHECK(std::abs(unit.clip.back()) < 1e-6);
    if (i > 0) CHECK(unit.segment.begin >= search.units[i - 1].segment.end);
  }
}

TEST_CASE("A threshold and a window that are said are used") {
  auto x = silence(1);
  add_burst(x, 0.2, 0.5, 0.03, 1);
  add_burst(x, 0.6, 0.5 * 0.05, 0.03, 2);  // 26 dB lower
  Take take;
  take.sound_class = SoundClass::kClac;
  take.threshold_db = -20;
  CHECK(find_units(prepared(x), take).units.size() == 1);
  take.threshold_db = -40;
  CHECK(find_units(prepared(x), take).units.size() == 2);
  // 12 ms apart: one sound in a window of 20 ms, two in one of 2 ms.
  auto pair = silence(0.5);
  add_burst(pair, 0.2, 0.5, 0.005, 1);
  add_burst(pair, 0.212, 0.5, 0.005, 2);
  take.threshold_db = -25;
  CHECK(find_units(prepared(pair), take).units.size() == 1);
  take.window_s = 0.002;
  CHECK(find_units(prepared(pair), take).units.size() == 2);
}

TEST_CASE("What is no unit is left out with its reason") {
  using Catch::Contains;
  Take take;
  take.sound_class = SoundClass::kFlap;
  const auto reasons = [&](const PreparedTake& sound) {
    std::string all;
    for (const auto& unit : find_units(sound, take).units) all += unit.reason + ";";
    return all;
  };
  auto good = silence(1);
  add_burst(good, 0.3, 0.5, 0.2, 1);
  CHECK(reasons(prepared(good)) == ";");
  auto brief = silence(1);
  add_burst(brief, 0.3, 0.5, 0.005, 1);
  CHECK_THAT(reasons(prepared(brief)), Contains("too short"));
  auto endless = silence(4);
  for (double t = 0.3; t < 3.5; t += 0.05) add_burst(endless, t, 0.5, 0.2, static_cast<std::uint64_t>(1000 * t));
  CHECK_THAT(reasons(prepared(endless)), Contains("overlapping"));
  auto clipped = prepared(good);
  clipped.clipped.push_back({15000, 15003});
  CHECK_THAT(reasons(clipped), Contains("clipped"));
  CHECK_THAT(reasons(prepared({good.begin() + 14600, good.end()})), Contains("cut at the start"));
  CHECK_THAT(reasons(prepared({good.begin(), good.begin() + 14600})), Contains("cut at the end"));
  auto faint = silence(1);
  add_burst(faint, 0.3, 0.5, 0.2, 1);
  add_burst(faint, 0.7, 0.5 * 0.022, 0.3, 2);
  add_noise(faint, 0.0025, 5);
  take.threshold_db = -38;
  CHECK_THAT(reasons(prepared(faint)), Contains("too quiet"));
}

TEST_CASE("A flap snaps no later than its lead allows, and is whole when it is said to be") {
  auto x = silence(1.5);
  for (double t = 0.2; t < 0.6; t += 0.02) add_burst(x, t, 0.05, 0.05, static_cast<std::uint64_t>(1000 * t));
  add_burst(x, 0.6, 0.5, 0.2, 1);
  Take take;
  take.sound_class = SoundClass::kFlap;
  take.threshold_db = -40;
  const auto begins_s = [&] {
    const auto units = find_units(prepared(x), take).units;
    REQUIRE(units.size() == 1);
    CHECK(units[0].reason.empty());
    CHECK(std::abs(units[0].clip.front()) < 1e-6);
    return static_cast<double>(units[0].segment.begin) / kRate_hz;
  };
  CHECK(begins_s() == Approx(0.55).margin(0.003));
  take.lead_s = 0.2;
  CHECK(begins_s() == Approx(0.4).margin(0.003));
  take.whole = true;
  CHECK(begins_s() == Approx(0.2).margin(0.003));
}

TEST_CASE("Units far quieter than the loudest of their sheet and session are left out") {
  const Folder folder;
  auto x = silence(3);
  add_burst(x, 0.3, 0.5, 0.2, 1);
  add_burst(x, 1.3, 0.5, 0.2, 2);
  add_burst(x, 2.3, 0.5 * 0.05, 0.2, 3);
  folder.sound("flaps.wav", x);
  const auto result = built(folder, head() + take("flaps.wav", kFlap));
  CHECK(result.report.units == 2);
  CHECK_THAT(result.report.sources[0].segments[2].reason, Catch::Contains("too quiet: 2") && Catch::Contains("dB below"));
}

TEST_CASE("Recordings of any rate, several channels, offset and rumble") {
  const Folder folder;
  auto x = silence(1);
  add_burst(x, 0.3, 0.4, 0.2, 1);
  std::vector<float> stereo;
  for (std::size_t n = 0; n < x.size(); ++n) {
    const double rumble = 0.05 + 0.2 * std::sin(2 * std::numbers::pi * 20 * static_cast<double>(n) / kRate_hz);
    stereo.push_back(x[n] + static_cast<float>(rumble));
    stereo.push_back(0.0f);
  }
  folder.sound("a.wav", stereo, 48000, 2);
  Take left;
  left.channel = 1;
  const auto sound = prepare(folder / "a.wav", left, 48000, 100);
  REQUIRE(sound);
  CHECK(sound->channels == 2);
  const auto before = std::span(sound->samples).subspan(4800, 4800);
  CHECK(dsp::rms(before) < 2e-3);
  left.channel = 2;
  CHECK(dsp::peak(prepare(folder / "a.wav", left, 48000, 100)->samples) < 1e-6);
  left.channel = 3;
  CHECK_THAT(prepare(folder / "a.wav", left, 48000, 100).error(), Catch::Contains("2 channels"));
  Take mean;
  mean.gain_db = 6.0206;
  const auto both = prepare(folder / "a.wav", mean, 48000, 100);
  CHECK(dsp::peak(both->samples) == Approx(dsp::peak(sound->samples)).epsilon(1e-3));
  Take part;
  part.from_s = 0.25;
  part.to_s = 0.75;
  const auto faster = prepare(folder / "a.wav", part, 96000, 100);
  REQUIRE(faster);
  CHECK(faster->samples.size() == 48000);
  CHECK(faster->from_s == Approx(0.25));
  part.from_s = 5;
  part.to_s = 6;
  CHECK_THAT(prepare(folder / "a.wav", part, 48000, 100).error(), Catch::Contains("lasts 1.000 s"));
  folder.text("b.wav", "not a sound");
  CHECK_THAT(prepare(folder / "b.wav", mean, 48000, 100).error(), Catch::Contains("cannot be read"));
}

TEST_CASE("Clipping is seen at full scale and at a lower flat top, not at a loud peak") {
  const Folder folder;
  auto x = silence(0.5);
  for (std::size_t n = 4800; n < 9600; ++n) x[n] = static_cast<float>(std::sin(0.2 * static_cast<double>(n)));
  const auto clipped_at = [&](float limit, float gain) {
    auto y = x;
    for (float& v : y) v = gain * std::clamp(1.5f * v, -limit, limit);
    folder.sound("c.wav", y, 48000, 1, SF_FORMAT_WAV | SF_FORMAT_PCM_16);
    return !prepare(folder / "c.wav", {}, 48000, 100)->clipped.empty();
  };
  CHECK(clipped_at(1.0f, 1.0f));
  CHECK(clipped_at(1.0f, 0.5f));
  CHECK_FALSE(clipped_at(2.0f, 0.6f));
}

TEST_CASE("A slide's spectrum is its own, at any FFT size, level by the reference event") {
  const Folder folder;
  const auto filter = dsp::butterworth_bandpass(1500, 6000, kRate_hz);
  folder.sound("slide.wav", coloured_noise(20, filter, 4));
  for (const int fft_size : {512, 1024, 2048}) {
    INFO(fft_size);
    const auto result =
        built(folder, head("[friction]\nfft_size = " + std::to_string(fft_size)) + take("slide.wav", kBentSlide));
    const auto& friction = *result.pack.friction;
    CHECK_FALSE(result.pack.crumpling);
    REQUIRE(friction.spectra.size() == 1);
    const auto& m = friction.spectra[0].magnitudes;
    REQUIRE(m.size() == static_cast<std::size_t>(fft_size / 2 + 1));
    CHECK(dsp::gain_to_db(pack::noise_rms(m)) == Approx(-32).margin(0.05));
    double total = 0;
    for (std::size_t k = 0; k < m.size(); ++k)
      total += std::pow(dsp::magnitude(filter, kRate_hz / 2 * static_cast<double>(k) / static_cast<double>(m.size() - 1),
                                       kRate_hz),
                        2) /
               static_cast<double>(m.size());
    const double level = dsp::db_to_gain(-32) / std::sqrt(total);
    // Bands of a third of an octave.
    for (double low_hz = 300; low_hz < 16000; low_hz *= 1.26) {
      double got = 0, expected = 0;
      for (std::size_t k = 0; k < m.size(); ++k) {
        const double f = kRate_hz / 2 * static_cast<double>(k) / static_cast<double>(m.size() - 1);
        if (f < low_hz || f >= 1.26 * low_hz) continue;
        got += m[k] * m[k];
        expected += std::pow(level * dsp::magnitude(filter, f, kRate_hz), 2);
      }
      if (expected > 0) CHECK(10 * std::log10(got / expected) == Approx(0).margin(1.0));
    }
  }
}

TEST_CASE("White noise has its RMS in every bin, scaled to the reference speed") {
  auto x = silence(10);
  add_noise(x, 0.1, 6);
  Take take;
  take.sound_class = SoundClass::kSlide;
  const auto at = [&](double speed) {
    const auto blocks = average_friction(prepared(x), take, constant_speed(speed), 1024, 0.1, 0.75);
    CHECK(blocks.level_dbfs == Approx(-20).margin(0.1));
    CHECK(blocks.kept_s == Approx(10).margin(0.1));
    return dsp::gain_to_db(pack::noise_rms(mean_spectrum(blocks.sum)));
  };
  CHECK(at(0.1) == Approx(-20).margin(0.1));
  CHECK(at(0.4) == Approx(-20 - 15 * std::log10(4.0)).margin(0.1));
  // Few blocks are smoothed: bins of two blocks would scatter by 4 dB.
  x.resize(1536);
  const auto few = mean_spectrum(average_friction(prepared(x), take, constant_speed(0.1), 1024, 0.1, 0.75).sum);
  double square = 0;
  for (std::size_t k = 40; k < 480; ++k) square += std::pow(dsp::gain_to_db(few[k]) + 20, 2) / 440;
  CHECK(std::sqrt(square) < 1.2);
}

TEST_CASE("Slides of several speeds make the spectrum of the reference speed") {
  const Folder folder;
  const auto filter = dsp::butterworth_bandpass(1000, 8000, kRate_hz);
  // Amplitude ∝ speed^0.75: 0.05 m/s for 4 s, then 0.4 m/s for 4 s, with 1 s of rest between.
  auto slow = coloured_noise(4, filter, 1, 0.02 * std::pow(0.5, 0.75)),
       fast = coloured_noise(4, filter, 2, 0.02 * std::pow(4, 0.75));
  auto rest = silence(1);
  add_noise(rest, 1e-5, 3);
  slow.insert(slow.end(), rest.begin(), rest.end());
  slow.insert(slow.end(), fast.begin(), fast.end());
  folder.sound("slide.wav", slow);
  folder.sound("steady.wav", coloured_noise(8, filter, 7));
  folder.text("speed.csv", "0,0.05\n3.99,0.05\n4.01,0\n4.99,0\n5.01,0.4\n9,0.4\n");
  const std::string friction = "[friction]\nspeed_exponent = 0.75";
  const auto varying = built(
      folder, head(friction) + take("slide.wav", "class = \"slide\"\nl_r = 0.1\nl_c = 0.2\nspeed_track = \"speed.csv\"\n") +
                  take("steady.wav", "class = \"slide\"\nconstrained = true\nspeed = 0.1\n"));
  const auto& spectra = varying.pack.friction->spectra;
  REQUIRE(spectra.size() == 2);
  CHECK(spectra[0].point.constrained());
  CHECK(dsp::gain_to_db(pack::noise_rms(spectra[1].magnitudes) / pack::noise_rms(spectra[0].magnitudes)) ==
        Approx(0).margin(0.3));
  const auto& segments = varying.report.sources[0].segments;
  REQUIRE(segments.size() >= 2);
  CHECK(segments[0].seconds == Approx(8).margin(0.1));
  CHECK(segments[1].reason == "too slow");
}

TEST_CASE("A session keeps its levels, another does not disturb them, each meets the reference events") {
  const Folder folder;
  const auto flap_file = [&](const std::string& name, double amplitude, std::uint64_t seed) {
    auto x = silence(1);
    add_burst(x, 0.3, amplitude, 0.2, seed);
    folder.sound(name, x);
  };
  flap_file("big.wav", 0.4, 1);
  flap_file("small.wav", 0.1, 1);
  flap_file("elsewhere.wav", 0.01, 2);
  const std::string small = "class = \"flap\"\nl_r = 0.05\nl_c = 0.1\n";
  const auto result = built(folder, head() + take("big.wav", kFlap) + take("small.wav", small) +
                                        take("elsewhere.wav", kFlap + "session = \"two\"\n"));
  const auto& crumpling = *result.pack.crumpling;
  REQUIRE(crumpling.units.size() == 3);
  CHECK(*pack::reference_flap_peak_dbfs(crumpling) == Approx(-20).margin(0.05));
  const auto peak = [&](std::size_t i) { return dsp::peak_dbfs(crumpling.units[i].samples); };
  CHECK(crumpling.units[0].point.ruling_length_m == 0.05);
  CHECK(peak(1) - peak(0) == Approx(12.04).margin(0.1));
  CHECK(peak(1) == Approx(peak(2)).margin(0.2));
  REQUIRE(result.report.sessions.size() == 2);
  CHECK(result.report.sessions[1].gain_db - result.report.sessions[0].gain_db == Approx(32).margin(1.5));
}

TEST_CASE("Recordings from elsewhere are brought to the section's geometry") {
  const Folder folder;
  auto x = silence(1);
  add_burst(x, 0.3, 0.4, 0.2, 1);
  folder.sound("near.wav", x);
  for (float& v : x) v *= 0.5f;
  folder.sound("far.wav", x);
  const auto result = built(folder, head("[geometry]\ndistance_m = 1\n") + take("near.wav", kFlap) +
                                        take("far.wav", kFlap + "[recording.geometry]\ndistance_m = 2\n"));
  const auto& units = result.pack.crumpling->units;
  REQUIRE(units.size() == 2);
  CHECK(dsp::peak_dbfs(units[0].samples) == Approx(dsp::peak_dbfs(units[1].samples)).margin(0.01));
}

TEST_CASE("Clacs found in crumpling are equally loud unless their levels are to be kept") {
  const Folder folder;
  auto x = silence(2);
  for (int i = 0; i < 8; ++i) add_burst(x, 0.2 + 0.2 * i, 0.5 * std::pow(0.8, i), 0.02, static_cast<std::uint64_t>(i + 1));
  add_noise(x, 1e-4, 9);
  folder.sound("crumpling.wav", x);
  const auto spread_db = [&](const std::string& more) {
    const auto result = built(folder, head() + take("crumpling.wav", "class = \"crumple\"\n" + more));
    REQUIRE(result.pack.crumpling->units.size() == 8);
    double least = 1e9, most = 0;
    for (const auto& unit : result.pack.crumpling->units) {
      CHECK(unit.point.constrained());
      least = std::min(least, dsp::rms(unit.samples) * std::sqrt(static_cast<double>(unit.samples.size())));
      most = std::max(most, dsp::rms(unit.samples) * std::sqrt(static_cast<double>(unit.samples.size())));
    }
    return dsp::gain_to_db(most / least);
  };
  CHECK(spread_db("") < 0.1);
  CHECK(spread_db("keep_levels = true\n") > 10);
  const auto few =
      built(folder, head("[crumpling]\nunits_per_point = 3\n") + take("crumpling.wav", "class = \"crumple\"\n"));
  CHECK(few.pack.crumpling->units.size() == 3);
  CHECK(few.report.left_out == 5);
  double peaks_db = 0;
  for (const auto& unit : few.pack.crumpling->units) peaks_db += dsp::peak_dbfs(unit.samples) / 3;
  CHECK(peaks_db == Approx(kReferenceClacPeak_dbfs).margin(0.1));
}

TEST_CASE("A built pack is written, passes the check, loads, and is the same again") {
  const Folder folder;
  auto x = silence(4);
  for (int i = 0; i < 3; ++i) add_burst(x, 0.3 + i, 0.4, 0.2, static_cast<std::uint64_t>(i + 1));
  add_noise(x, 1e-4, 9);
  folder.sound("r100_c200.flac", x, 44100, 1, SF_FORMAT_FLAC | SF_FORMAT_PCM_24);
  auto clacs = silence(2);
  for (int i = 0; i < 4; ++i) add_burst(clacs, 0.3 + 0.3 * i, 0.3, 0.02, static_cast<std::uint64_t>(i + 10));
  add_noise(clacs, 1e-4, 8);
  folder.sound("clacs.ogg", clacs, 48000, 1, SF_FORMAT_OGG | SF_FORMAT_VORBIS);
  const auto filter = dsp::butterworth_bandpass(1500, 6000, kRate_hz);
  folder.sound("bent.wav", coloured_noise(5, filter, 4));
  folder.sound("flat.wav", coloured_noise(5, filter, 5, 0.01));
  const std::string manifest =
      head("[geometry]\ndistance_m = 1\n[friction.geometry]\nelevation_deg = 30\nplane = true\ncompression = 0.3\n") +
      take("r100_c200.flac", "class = \"flap\"\n") + take("clacs.ogg", "class = \"clac\"\n") + take("bent.wav", kBentSlide) +
      take("flat.wav", "class = \"slide\"\nconstrained = true\nspeed = 0.1\n");
  const auto result = built(folder, manifest);
  CHECK(result.report.units == 7);
  CHECK(result.report.spectra == 2);
  REQUIRE(pack::write(result.pack, folder / "pack"));
  const auto findings = pack::check(folder / "pack");
  INFO(all_of(findings));
  CHECK(findings.empty());
  const auto loaded = pack::load(folder / "pack", 48000);
  REQUIRE(loaded);
  CHECK((*loaded)->crumpling->units.size() == 7);
  const auto again = built(folder, manifest);
  for (std::size_t i = 0; i < 7; ++i)
    CHECK(again.pack.crumpling->units[i].samples == result.pack.crumpling->units[i].samples);
  CHECK(again.pack.friction->spectra[1].magnitudes == result.pack.friction->spectra[1].magnitudes);
}

TEST_CASE("A pack without clacs, without flaps or without friction is made, and says what it lacks") {
  const Folder folder;
  auto x = silence(1);
  add_burst(x, 0.3, 0.4, 0.2, 1);
  folder.sound("flap.wav", x);
  const auto missing = [](const BuiltPack& pack) {
    std::string all;
    for (const auto& line : pack.report.missing) all += line + "\n";
    return all;
  };
  const auto flaps = built(folder, head() + take("flap.wav", kFlap));
  CHECK_FALSE(flaps.pack.friction);
  CHECK_THAT(missing(flaps),
             Catch::Contains("clacs") && Catch::Contains("slides of flat sheets") && Catch::Contains("1 of the usual 81"));
  CHECK(pack::write(flaps.pack, folder / "flaps"));
  CHECK(pack::load(folder / "flaps", 48000));
  const auto clacs = built(folder, head() + take("flap.wav", "class = \"clac\"\nwhole = true\n"));
  CHECK_FALSE(clacs.pack.friction);
  CHECK_THAT(missing(clacs), Catch::Contains("flaps"));
  const auto filter = dsp::butterworth_bandpass(1500, 6000, kRate_hz);
  folder.sound("flat.wav", coloured_noise(2, filter, 5, 0.01));
  const auto flat = built(folder, head() + take("flat.wav", "class = \"slide\"\nconstrained = true\nspeed = 0.1\n"));
  CHECK_FALSE(flat.pack.crumpling);
  CHECK(dsp::gain_to_db(pack::noise_rms(flat.pack.friction->spectra[0].magnitudes)) ==
        Approx(kReferenceFlatFriction_dbfs).margin(0.05));
}

TEST_CASE("What cannot be built is refused with the file and a remedy") {
  const Folder folder;
  folder.text("broken.wav", "RIFF");
  folder.sound("empty.wav", silence(0.5));
  folder.sound("flap.wav", silence(0.5));
  using Catch::Contains;
  const auto complaint = [&](const std::string& takes) {
    pack::Findings findings;
    CHECK_FALSE(built(folder, head() + takes, findings));
    return all_of(findings);
  };
  CHECK_THAT(complaint(take("broken.wav", kFlap)), Contains("broken.wav") && Contains("cannot be read"));
  CHECK_THAT(complaint(take("empty.wav", kFlap)), Contains("none of 1 sounds") && Contains("silent"));
  CHECK_THAT(complaint(take("flap.wav", "class = \"flap\"\n")), Contains("no place in the grid") && Contains("r100_c200"));
  CHECK_THAT(complaint(take("flap.wav", "class = \"slide\"\nconstrained = true\nspeed_track = \"none.csv\"\n")),
             Contains("none.csv"));
  CHECK_THAT(complaint(take("flap.wav", "class = \"tear\"\n")), Contains("only tears and cloth"));
}

}  // namespace test_build
