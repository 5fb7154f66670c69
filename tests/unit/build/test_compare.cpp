#include <catch2/catch.hpp>

#include <algorithm>
#include <map>

#include "folder.h"
#include "sound_db/build/build_manifest.h"
#include "sound_db/build/compare.h"
#include "sound_db/dsp/filter.h"
#include "sound_db/dsp/level.h"
#include "sound_db/dsp/statistics.h"
#include "sound_db/pack/load.h"

namespace test_compare {

using namespace rustle;
using namespace rustle::build;
using namespace rustle::build::test;

namespace {

ClassifiedSound band(SoundClass sound_class, const std::string& name, double low_hz, double high_hz, std::uint64_t seed,
                     double rms = 0.05) {
  auto x = silence(0.5);
  add_noise(x, rms, seed);
  dsp::CascadeState state;
  dsp::filter(dsp::butterworth_bandpass(low_hz, high_hz, kRate_hz), state, x);
  return {sound_class, name, x};
}

const std::filesystem::path kShared = std::filesystem::path(RUSTLE_SOURCE_DIR).parent_path() / "shared/recordings";

}  // namespace

TEST_CASE("Sounds are inside the range of their like and outside that of others") {
  std::vector<ClassifiedSound> real, like, unlike;
  for (int i = 0; i < 5; ++i) {
    const auto seed = static_cast<std::uint64_t>(i);
    real.push_back(band(SoundClass::kSlide, "real", 2000 + 300 * i, 6000 + 500 * i, seed));
    like.push_back(band(SoundClass::kSlide, "like", 2100 + 250 * i, 6200 + 400 * i, seed + 10, 0.5));
    unlike.push_back(band(SoundClass::kSlide, "unlike", 200 + 10 * i, 500, seed + 20));
  }
  const auto good = compare(like, real, kRate_hz), bad = compare(unlike, real, kRate_hz);
  REQUIRE(good.classes.size() == 1);
  REQUIRE(bad.classes.size() == 1);
  const auto row = [](const Comparison& c, const char* name) {
    const auto& rows = c.classes[0].features;
    return *std::find_if(rows.begin(), rows.end(), [&](const FeatureRow& r) { return r.feature == name; });
  };
  CHECK(row(good, "centroid_hz").inside);
  CHECK(row(good, "centroid_hz").real.count == 5);
  CHECK(row(good, "centroid_hz").real.least < row(good, "centroid_hz").real.median);
  CHECK_FALSE(row(bad, "centroid_hz").inside);
  CHECK(row(bad, "centroid_hz").share_inside == 0);
  CHECK(row(good, "kurtosis").ours.median == Approx(3).margin(0.3));
  CHECK(good.classes[0].mfcc_distance < 2);
  CHECK(bad.classes[0].mfcc_distance > 3 * good.classes[0].mfcc_distance);
  CHECK(bad.classes[0].mean_mfcc_distance > 3 * good.classes[0].mean_mfcc_distance);
  CHECK(good.notices.empty());
}

TEST_CASE("The nearest recording is the one that sounds most alike, whatever its level") {
  const std::vector<ClassifiedSound> real = {
      band(SoundClass::kFlap, "low", 200, 500, 1), band(SoundClass::kFlap, "mid", 1500, 3000, 2),
      band(SoundClass::kFlap, "high", 6000, 12000, 3), band(SoundClass::kTear, "tear", 1000, 2000, 4)};
  const std::vector<ClassifiedSound> ours = {band(SoundClass::kFlap, "a", 6500, 11000, 5, 0.001),
                                             band(SoundClass::kFlap, "b", 220, 520, 6, 0.3),
                                             {SoundClass::kFlap, "none", silence(0.2)},
                                             band(SoundClass::kClac, "c", 1000, 2000, 7)};
  const auto result = compare(ours, real, kRate_hz);
  REQUIRE(result.classes.size() == 1);
  REQUIRE(result.classes[0].nearest.size() == 2);
  CHECK(real[result.classes[0].nearest[0].real].name == "high");
  CHECK(real[result.classes[0].nearest[1].real].name == "low");
  REQUIRE(result.notices.size() == 3);
  CHECK_THAT(result.notices[0], Catch::Contains("none is silent"));
  CHECK_THAT(result.notices[1], Catch::Contains("clac: no recording"));
  CHECK_THAT(result.notices[2], Catch::Contains("tear: recorded"));
  const auto pairs = pairs_to_show(result, ours, real, kRate_hz, 2);
  REQUIRE(pairs.size() == 2);
  CHECK(pairs[0].mfcc_distance <= pairs[1].mfcc_distance);
  for (const auto& pair : pairs) {
    CHECK(dsp::rms(ours[pair.ours].samples) * pair.our_gain == Approx(0.1).epsilon(0.1));
    CHECK(dsp::rms(real[pair.real].samples) * pair.real_gain == Approx(0.1).epsilon(0.1));
  }
}

TEST_CASE("Clacs are held against the loudest moments of crumplings where no clac was recorded") {
  auto clac = silence(0.03);
  add_burst(clac, 0.001, 0.1, 0.02, 1);
  auto crumpling = silence(0.8);
  for (int k = 0; k < 4; ++k) add_burst(crumpling, 0.1 + 0.15 * k, 0.1 + 0.05 * k, 0.02, static_cast<std::uint64_t>(2 + k));
  add_burst(crumpling, 0.75, 0.005, 0.02, 9);  // too faint beside the others
  const auto result =
      compare({{SoundClass::kClac, "clac", clac}}, {{SoundClass::kCrumple, "crumpling", crumpling}}, kRate_hz);
  REQUIRE(result.classes.size() == 1);
  CHECK(result.classes[0].sound_class == SoundClass::kClac);
  CHECK(result.classes[0].compared_with == SoundClass::kCrumple);
  CHECK(result.classes[0].real == 4);
  for (const auto& row : result.classes[0].features) {
    INFO(row.feature << " " << row.ours.median << " beside " << row.real.least << " to " << row.real.most);
    CHECK(row.real.count == 4);
    // Each moment is one burst, not the whole with its silences, whose kurtosis is several times as high.
    CHECK(row.ours.median > 0.5 * row.real.least);
    CHECK(row.ours.median < 2 * row.real.most);
  }
  REQUIRE(result.notices.size() == 1);
  CHECK_THAT(result.notices[0], Catch::Contains("crumple: recorded"));
}

TEST_CASE("Few recordings are no range") {
  const std::vector<ClassifiedSound> ours = {band(SoundClass::kCrumple, "a", 2000, 8000, 1)};
  const auto result = compare(ours, {band(SoundClass::kCrumple, "b", 2000, 8000, 2)}, kRate_hz);
  REQUIRE(result.classes.size() == 1);
  CHECK(result.classes[0].features[0].inside);
  CHECK(result.classes[0].real_mfcc_distance == 0);
  REQUIRE(result.notices.size() == 1);
  CHECK_THAT(result.notices[0], Catch::Contains("1 recording make no range"));
}

TEST_CASE("A pack's sounds: every unit, every spectrum as a slide of its level, crumplings") {
  pack::SoundPack pack;
  auto& crumpling = pack.crumpling.emplace();
  const auto unit = [&](pack::GridPoint point, double t60_s, std::uint64_t seed) {
    auto x = silence(0.3);
    add_burst(x, 0, 0.1, t60_s, seed);
    crumpling.units.push_back({point, "", x, point.disc_radius_m()});
  };
  unit({}, 0.02, 1);
  unit({}, 0.02, 2);
  unit({0.1, 0.2}, 0.2, 3);
  auto& friction = pack.friction.emplace();
  std::vector<float> rising(513);
  for (std::size_t k = 0; k < rising.size(); ++k) rising[k] = 0.02f * static_cast<float>(k) / 512;
  friction.gain_sigma = 0;
  friction.spectra.push_back({{0.1, 0.2}, "", rising, 0.05});
  const auto sounds = pack_sounds(pack);
  std::map<SoundClass, int> counts;
  for (const auto& sound : sounds) ++counts[sound.sound_class];
  CHECK(counts == std::map<SoundClass, int>{
                      {SoundClass::kFlap, 1}, {SoundClass::kClac, 2}, {SoundClass::kCrumple, 6}, {SoundClass::kSlide, 1}});
  const auto& slide = sounds.back();
  CHECK(slide.samples.size() == 48000);
  // A push from rest to rest, (4 t (1 - t))²: 256/630 of its power in the middle.
  const double expected_db = dsp::gain_to_db(0.02 / std::sqrt(3.0)) + 10 * std::log10(256.0 / 630);
  CHECK(dsp::rms_dbfs(slide.samples) == Approx(expected_db).margin(0.4));
  const auto spectrum = dsp::mean_magnitude(slide.samples);
  CHECK(spectrum[900] / spectrum[450] == Approx(2).epsilon(0.15));
  CHECK(sounds.front().name == "clac (1)");
  const auto again = pack_sounds(pack), other = pack_sounds(pack, 2);
  CHECK(again[4].samples == sounds[4].samples);
  CHECK(other[4].samples != sounds[4].samples);
  const auto& crumple = sounds[4];
  CHECK(crumple.sound_class == SoundClass::kCrumple);
  CHECK(dsp::kurtosis(crumple.samples) > 8);
}

TEST_CASE("References come by a manifest, or by the words of their names with a notice") {
  const Folder folder;
  auto x = silence(2);
  add_burst(x, 0.3, 0.4, 0.2, 1);
  folder.sound("pageFlip.wav", x, 44100);
  folder.sound("slides/one.wav", x);
  folder.sound("other.wav", x);
  folder.text("broken-rip.wav", "RIFF");
  const auto guessed = read_reference_recordings(folder.path());
  REQUIRE(guessed);
  REQUIRE(guessed->sounds.size() == 2);
  CHECK(guessed->sounds[0].sound_class == SoundClass::kFlap);
  CHECK(guessed->sounds[0].samples.size() == Approx(48000 * 2.177).epsilon(0.001));
  CHECK(guessed->sounds[1].name == "slides/one.wav");
  REQUIRE(guessed->notices.size() == 3);
  CHECK_THAT(guessed->notices[0], Catch::Contains("broken-rip.wav"));
  CHECK_THAT(guessed->notices[1], Catch::Contains("pageFlip.wav flap"));
  CHECK_THAT(guessed->notices[2], Catch::Contains("other.wav"));
  folder.text(kBuildManifestName, head() + "[[recording]]\nclass = \"tear\"\nfiles = \"other.wav\"\ntime = [0.5, 1.5]\n");
  const auto named = read_reference_recordings(folder.path());
  REQUIRE(named);
  REQUIRE(named->sounds.size() == 1);
  CHECK(named->sounds[0].sound_class == SoundClass::kTear);
  CHECK(named->sounds[0].name == "other.wav 0.5-1.5 s");
  CHECK(named->sounds[0].samples.size() == 48000);
  CHECK(named->notices.empty());
  const Folder empty;
  CHECK_THAT(read_reference_recordings(empty.path()).error().text(),
             Catch::Contains("no recording") && Catch::Contains("recordings.toml"));
  CHECK_FALSE(read_reference_recordings(empty / "none"));
}

TEST_CASE("Features of real recordings agree with an independent implementation within 2 %") {
  if (!std::filesystem::exists(kShared)) return;
  struct Known {
    const char* file;
    double centroid_hz, bandwidth_hz, decay_s, kurtosis, mfcc_1, mfcc_2;
  };
  // metrics.features() of NumPy and SciPy, resampled there.
  const Known files[] = {
      {"freesound-drooler/508597__drooler__crumple-06.ogg", 3956.83718, 2868.43815, 0.205, 51.0005, -4.716, -9.311},
      {"kenney-casino/card-shove-2.ogg", 6162.2199, 4216.29066, 0.535, 263.86724, -4.598, 0.195},
      {"kenney-casino/card-slide-4.ogg", 6127.55345, 3907.43565, 0.06, 69.9372, -6.189, 1.434},
      {"automat/canvas_pick.wav 0-0.5 s", 7679.05019, 4908.94473, 0.05, 13.15119, 0.686, 2.152},
      {"kenney-rpg/bookFlip1.ogg", 6206.50738, 3562.18871, 0.085, 378.81463, -7.407, -2.213},
      {"repixture-cloth/rp_sounds_dug_fuzzy.1.ogg", 4383.57782, 4019.45043, 0.235, 19.03062, 1.429, 1.02},
  };
  const auto recordings = read_reference_recordings(
      kShared, 48000, std::filesystem::path(RUSTLE_SOURCE_DIR) / "tests/e2e/shared_recordings.toml");
  REQUIRE(recordings);
  for (const Known& known : files) {
    INFO(known.file);
    const auto found = std::find_if(recordings->sounds.begin(), recordings->sounds.end(),
                                    [&](const ClassifiedSound& s) { return s.name == known.file; });
    REQUIRE(found != recordings->sounds.end());
    const auto features = dsp::sound_features(found->samples, 48000);
    CHECK(features.centroid_hz == Approx(known.centroid_hz).epsilon(0.02));
    CHECK(features.bandwidth_hz == Approx(known.bandwidth_hz).epsilon(0.02));
    CHECK(features.decay_s == Approx(known.decay_s).margin(0.0051));
    CHECK(features.kurtosis == Approx(known.kurtosis).epsilon(0.02));
    CHECK(features.mfcc[1] == Approx(known.mfcc_1).margin(0.1));
    CHECK(features.mfcc[2] == Approx(known.mfcc_2).margin(0.1));
  }
}

}  // namespace test_compare
