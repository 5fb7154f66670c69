#include <catch2/catch.hpp>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <numbers>
#include <string>
#include <vector>

#include "sound_db/build/build.h"
#include "sound_db/build/correspondences.h"
#include "sound_db/dsp/random.h"
#include "sound_db/dsp/statistics.h"
#include "sound_db/pack/audio_file.h"
#include "sound_db/pack/check.h"
#include "sound_db/pack/friction_sweep.h"
#include "sound_db/pack/load.h"
#include "sound_db/pack/write.h"
#include "tests/unit/pack/example_pack.h"

namespace rustle::build::cloth_build_test {
namespace {

namespace fs = std::filesystem;

constexpr double kRate_hz = 48000;

std::vector<float> noise(double seconds, double level, std::uint64_t seed) {
  dsp::Random random(seed);
  std::vector<float> result(static_cast<std::size_t>(seconds * kRate_hz));
  for (float& x : result) x = static_cast<float>(level * random.normal());
  return result;
}

void write_text(const fs::path& file, const std::string& text) {
  std::ofstream(file) << text;
}

const std::string kAbout =
    "[pack]\nmaterial = \"felt\"\ntouched_surface = \"felt\"\nlicence = \"CC0-1.0\"\norigin = \"test\"\n";

/// Two stretches of cloth, a slide that grows from 0.1 to 1 m/s with its level in proportion, and eight pops.
struct Recordings {
  Recordings() {
    std::vector<float> cloth = noise(2, 0.05, 1);
    cloth.resize(cloth.size() + 24000, 0.0F);
    const auto more = noise(1.5, 0.02, 2);
    cloth.insert(cloth.end(), more.begin(), more.end());
    REQUIRE(pack::write_clip(path() / "cloth.wav", cloth, 48000));

    std::vector<float> slide = noise(8, 0.1, 3);
    for (std::size_t n = 0; n < slide.size(); ++n)
      slide[n] *= static_cast<float>(speed_at(static_cast<double>(n) / kRate_hz));
    REQUIRE(pack::write_clip(path() / "slide.wav", slide, 48000));
    write_text(path() / "speed.csv", "time,speed\n0,0.1\n1,0.1778\n2,0.3162\n3,0.5623\n4,1\n8,1\n");

    std::vector<float> pops(static_cast<std::size_t>(4.5 * kRate_hz));
    for (int i = 0; i < kPops; ++i) {
      const auto burst = noise(0.01, 0.02 * std::pow(1.5, i), static_cast<std::uint64_t>(20 + i));
      std::copy(burst.begin(), burst.end(), pops.begin() + static_cast<std::ptrdiff_t>((0.25 + 0.5 * i) * kRate_hz));
    }
    REQUIRE(pack::write_clip(path() / "pops.wav", pops, 48000));
    manifest(kAbout +
             "[cloth]\nwidths = [20, 30, 10]\nlook_ahead = 7\nspeeds = 9\nslowest = 0.12\nfastest = 0.9\n"
             "speed_tolerance = 0.15\npatch_area = 0.02\n"
             "[[recording]]\nfiles = \"cloth.wav\"\nclass = \"cloth\"\n"
             "[[recording]]\nfiles = \"slide.wav\"\nclass = \"slide\"\nspeed_track = \"speed.csv\"\n"
             "[[recording]]\nfiles = \"pops.wav\"\nclass = \"crumple\"\nthreshold_db = -30\n");
  }
  static constexpr int kPops = 8;
  static double speed_at(double t) { return t < 4 ? 0.1 * std::pow(10.0, t / 4) : 1; }
  const fs::path& path() const { return folder.path(); }
  void manifest(const std::string& text) const { write_text(path() / kBuildManifestName, text); }

  std::optional<BuiltPack> build(pack::Findings& findings) const {
    const auto read = read_build_manifest(path() / kBuildManifestName, findings);
    return read ? build_pack(*read, path(), findings) : std::nullopt;
  }

  pack::TemporaryFolder folder;
};

std::string all_of(const pack::Findings& findings) {
  std::string text;
  for (const auto& finding : findings) text += finding.what.text() + "\n";
  return text;
}

TEST_CASE("a pack of cloth from recordings: corpus, sweep and crumpling") {
  const Recordings recordings;
  pack::Findings findings;
  const auto built = recordings.build(findings);
  INFO(all_of(findings));
  REQUIRE(built);
  REQUIRE(built->pack.cloth);
  const pack::ClothCorpus& corpus = *built->pack.cloth;
  CHECK_FALSE(built->pack.crumpling);
  CHECK_FALSE(built->pack.friction);
  REQUIRE(corpus.recordings.size() == 2);
  CHECK(static_cast<double>(corpus.units()) / 240 == Approx(3.6).margin(0.15));
  CHECK(corpus.causal.values.size() == corpus.units() * 3);
  CHECK(corpus.selection.filter_widths == std::vector{20, 30, 10});
  CHECK(corpus.selection.look_ahead == 7);
  CHECK_FALSE(corpus.causal.warp.identity());

  // Noise of 0.1 v: the level is that at every speed, white above the high-pass.
  CHECK(corpus.friction.patch_area_m2 == 0.02);
  CHECK(corpus.friction.speeds_m_per_s.size() == 9);
  for (std::size_t i = 0; i < corpus.friction.rms.size(); ++i) {
    CAPTURE(corpus.friction.speeds_m_per_s[i]);
    CHECK(corpus.friction.rms[i] == Approx(0.1 * corpus.friction.speeds_m_per_s[i]).epsilon(0.12));
  }
  REQUIRE(corpus.crumpling);
  REQUIRE(corpus.crumpling->units.size() == Recordings::kPops);
  for (int i = 0; i < Recordings::kPops; ++i) {
    const double expected_s = std::pow(0.02 * std::pow(1.5, i), 2) * 0.01;
    CHECK(corpus.crumpling->units[static_cast<std::size_t>(i)].energy_s == Approx(expected_s).epsilon(0.2));
  }
  CHECK(built->report.units == Recordings::kPops);
  CHECK(built->report.spectra == 9);

  const auto path = recordings.path() / "pack";
  REQUIRE(pack::write(built->pack, path));
  for (const auto& finding : pack::check(path)) {
    CAPTURE(finding.what.text());
    CHECK(finding.severity == pack::Severity::kWarning);
    CHECK(finding.what.text().find("were replaced") == std::string::npos);
  }
  pack::Findings again;
  CHECK(recordings.build(again)->pack == built->pack);
}

TEST_CASE("of several channels each is a source, binaural ones stay together") {
  const Recordings recordings;
  const std::vector<std::vector<float>> two = {noise(2, 0.05, 7), noise(2, 0.01, 8)};
  REQUIRE(pack::write_multichannel(recordings.path() / "cloth.wav", two, 48000));
  pack::Findings findings;
  const auto apart = recordings.build(findings);
  REQUIRE(apart);
  CHECK(apart->pack.cloth->recordings.size() == 2);
  CHECK(apart->pack.cloth->dims() == 3);
  recordings.manifest(kAbout +
                      "[cloth]\nbinaural = true\n[[recording]]\nfiles = \"cloth.wav\"\nclass = \"cloth\"\n"
                      "[[recording]]\nfiles = \"slide.wav\"\nclass = \"slide\"\nspeed = 0.5\n");
  const auto binaural = recordings.build(findings);
  INFO(all_of(findings));
  REQUIRE(binaural);
  CHECK(binaural->pack.cloth->recordings.size() == 1);
  CHECK(binaural->pack.cloth->dims() == 6);
  CHECK(binaural->pack.cloth->friction.speeds_m_per_s == std::vector{0.5});
  CHECK_FALSE(binaural->pack.cloth->crumpling);
}

TEST_CASE("a manifest of cloth that cannot be followed says what is wrong and what mends it") {
  const Recordings recordings;
  const std::string cloth = "[[recording]]\nfiles = \"cloth.wav\"\nclass = \"cloth\"\n";
  const std::string slide = "[[recording]]\nfiles = \"slide.wav\"\nclass = \"slide\"\nspeed_track = \"speed.csv\"\n";
  const auto wrong = [&](const std::string& text, const std::string& part) {
    recordings.manifest(kAbout + text);
    pack::Findings findings;
    CHECK_FALSE(recordings.build(findings));
    CAPTURE(text, all_of(findings));
    REQUIRE_FALSE(findings.empty());
    CHECK(all_of(findings).find(part) != std::string::npos);
    for (const auto& finding : findings) CHECK_FALSE(finding.what.remedy.empty());
  };
  wrong("[cloth]\nwidths = [1, 2]\n" + cloth + slide, "cloth.widths");
  wrong("[cloth]\nlambda = -1\n" + cloth + slide, "cloth.lambda");
  wrong("[cloth]\nslowest = 3.0\n" + cloth + slide, "cloth.fastest");
  wrong("[cloth]\ncolour = \"red\"\n" + cloth + slide, "cloth.colour");
  wrong("[cloth]\n" + slide, "no recording of cloth");
  wrong("[cloth]\n" + cloth, "no slide");
  wrong("[cloth]\nbinaural = true\n" + cloth + slide, "one channel");
  wrong("[cloth]\n" + cloth + "[[recording]]\nfiles = \"slide.wav\"\nclass = \"flap\"\n", "\"flap\"");
  wrong("[cloth]\n" + cloth + "l_r = 0.1\nl_c = 0.2\n", "of paper only");
  write_text(recordings.path() / "speed.csv", "time,speed\n0,fast\n");
  wrong("[cloth]\n" + cloth + slide, "speed.csv");
  write_text(recordings.path() / "cloth.wav", "RIFF");
  wrong("[cloth]\n" + cloth + slide, "cloth.wav");
}

TEST_CASE("correspondence files: read, written, and wrong lines named") {
  const pack::TemporaryFolder folder;
  const auto file = folder.path() / "pairs.csv";
  const std::vector<pack::Correspondence> pairs = {{1.25, 14.1, 0.1}, {0, 3, 0.2}};
  write_text(file, correspondences_text(pairs));
  const auto read = read_correspondences(file);
  REQUIRE(read);
  CHECK(*read == pairs);
  write_text(file, "target,database\n\n# two numbers will do\n2; 3\n");
  REQUIRE(read_correspondences(file));
  CHECK(read_correspondences(file)->front() == pack::Correspondence{2, 3, 0.1});
  for (const char* text : {"1, 2, 3, 4\n", "1\n", "1, two\n", "-1, 2\n", "1, 2, 0\n", "1, nan\n", "", "# none\n"}) {
    write_text(file, text);
    CAPTURE(text);
    CHECK_FALSE(read_correspondences(file));
  }
  write_text(file, "1, 2\n1, x\n");
  CHECK(read_correspondences(file).error().find("line 2") != std::string::npos);
}

TEST_CASE("recorded cloth makes a pack that passes its check") {
  const auto shared = fs::path(RUSTLE_SOURCE_DIR).parent_path() / "shared/recordings";
  if (!fs::exists(shared)) {
    WARN("no recordings beside this repository");
    return;
  }
  const pack::TemporaryFolder folder;
  // Levels and speeds are not known of these: one rustle stands for a slide, the footsteps for crumpling.
  write_text(
      folder.path() / kBuildManifestName,
      kAbout +
          "[cloth]\n"
          "[[recording]]\nfiles = [\"kenney-rpg/cloth*.ogg\", \"freesound-martian/*.wav\", \"repixture-cloth/*dig*.ogg\"]\n"
          "class = \"cloth\"\n"
          "[[recording]]\nfiles = \"repixture-cloth/*dug*.ogg\"\nclass = \"slide\"\nspeed = 0.5\n"
          "[[recording]]\nfiles = \"repixture-cloth/*place*.ogg\"\nclass = \"crumple\"\n");
  pack::Findings findings;
  const auto manifest = read_build_manifest(folder.path() / kBuildManifestName, findings);
  REQUIRE(manifest);
  const auto built = build_pack(*manifest, shared, findings);
  INFO(all_of(findings));
  REQUIRE(built);
  const pack::ClothCorpus& corpus = *built->pack.cloth;
  CHECK(corpus.units() > 400);
  CHECK(corpus.friction.rms.size() == 1);
  REQUIRE(corpus.crumpling);
  CHECK(corpus.crumpling->units.size() >= 3);
  const double centroid_hz = dsp::spectral_centroid_hz(corpus.friction.spectrum(0), kRate_hz);
  CHECK(centroid_hz > 1000);
  CHECK(centroid_hz < 6000);
  REQUIRE(pack::write(built->pack, folder.path() / "pack"));
  for (const auto& finding : pack::check(folder.path() / "pack")) {
    CAPTURE(finding.what.text());
    CHECK(finding.severity == pack::Severity::kWarning);
    CHECK(finding.what.text().find("were replaced") == std::string::npos);
  }
}

}  // namespace
}  // namespace rustle::build::cloth_build_test
