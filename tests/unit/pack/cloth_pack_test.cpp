#include <catch2/catch.hpp>

#include <cmath>
#include <memory>
#include <nlohmann/json.hpp>

#include "sound_db/dsp/unit_features.h"
#include "sound_db/pack/audio_file.h"
#include "sound_db/pack/calibration.h"
#include "sound_db/pack/check.h"
#include "sound_db/pack/cloth_corpus.h"
#include "sound_db/pack/corpus_source.h"
#include "sound_db/pack/load.h"
#include "sound_db/pack/manifest.h"
#include "sound_db/pack/spectra.h"
#include "sound_db/pack/write.h"
#include "tests/unit/pack/example_pack.h"

namespace rustle::pack::cloth_pack_test {
namespace {

using Json = nlohmann::ordered_json;

std::vector<float> noise(double seconds, double level, std::uint64_t seed) {
  dsp::Random random(seed);
  std::vector<float> result(static_cast<std::size_t>(seconds * 48000));
  for (std::size_t n = 0; n < result.size(); ++n) {
    const double swell = 1.2 + std::sin(static_cast<double>(n) / 9000);
    result[n] = static_cast<float>(level * swell * random.normal());
  }
  return result;
}

/// A small corpus of two channels, with everything that a corpus can have.
ClothCorpus example_corpus() {
  ClothCorpus corpus;
  corpus.channels = 2;
  for (int r = 0; r < 2; ++r) {
    const auto seed = static_cast<std::uint64_t>(10 * r);
    corpus.recordings.push_back({"cloth/source_0" + std::to_string(r + 1) + ".wav",
                                 {noise(0.5 + 0.31 * r, 0.05, seed + 1), noise(0.5 + 0.31 * r, 0.02, seed + 2)}});
  }
  corpus.causal.file = "cloth/causal.npy";
  corpus.symmetric.file = "cloth/symmetric.npy";
  corpus.wale_spacing_m = 0.0014;
  corpus.friction.file = "cloth/friction.npy";
  corpus.friction.speeds_m_per_s = {0.1, 0.4};
  corpus.friction.compression = {4, 1.5};
  for (std::size_t i = 0; i < 2; ++i) {
    for (std::size_t k = 0; k < corpus.friction.bins(); ++k) {
      corpus.friction.magnitudes.push_back(
          static_cast<float>((0.01 + 0.02 * static_cast<double>(i)) / (1 + std::pow(static_cast<double>(k) / 60.0, 2))));
    }
    corpus.friction.rms.push_back(noise_rms(corpus.friction.spectrum(i)));
  }
  corpus.crumpling.emplace();
  std::vector<double> energies;
  for (int i = 0; i < 4; ++i) {
    ClothCrumplingUnit unit{"cloth/pop_" + std::to_string(i) + ".wav", noise(0.01, 0.01 * std::pow(4.0, i), 40), 0};
    for (const float x : unit.samples) unit.energy_s += static_cast<double>(x) * x / 48000;
    energies.push_back(unit.energy_s);
    corpus.crumpling->units.push_back(unit);
  }
  corpus.crumpling->unit_energies = energy_histogram(energies);
  corpus.crumpling->event_amplitudes = {0.01, 1, {4, 3, 2, 1}};
  measure_units(corpus);
  const std::vector<std::vector<float>> target = {noise(1, 0.1, 90), noise(1, 0.01, 91)};
  const std::vector<Correspondence> pairs = {{0.1, 0.2, 0.1}, {0.5, 0.6, 0.2}};
  calibrate(corpus, target_features(corpus, target), pairs);
  return corpus;
}

struct WrittenCloth {
  WrittenCloth() {
    pack.name = "example";
    pack.version = "1";
    pack.material = pack.touched_surface = "felt";
    pack.licence = "CC0-1.0";
    pack.origin = "test";
    pack.cloth = std::make_shared<const ClothCorpus>(example_corpus());
    REQUIRE(write(pack, path));
  }
  Json manifest() const { return Json::parse(read_bytes(path / kManifestName)); }
  void manifest(const Json& json) const { write_bytes(path / kManifestName, json.dump(1)); }

  TemporaryFolder folder;
  std::filesystem::path path = folder.path() / "felt";
  SoundPack pack;
};

bool has(const Findings& findings, Severity severity, const std::string& text) {
  return std::any_of(findings.begin(), findings.end(), [&](const Finding& finding) {
    return finding.severity == severity && finding.what.text().find(text) != std::string::npos;
  });
}

TEST_CASE("a pack of cloth comes back as it was written") {
  const WrittenCloth written;
  const auto loaded = load(written.path, 48000);
  REQUIRE(loaded);
  REQUIRE((*loaded)->cloth);
  const ClothCorpus &was = *written.pack.cloth, &is = *(*loaded)->cloth;
  CHECK(is.first_unit == was.first_unit);
  CHECK(is.units() == 120 + 194);
  CHECK(is.dims() == 6);
  CHECK(is.recordings == was.recordings);
  CHECK(is.causal == was.causal);
  CHECK(is.symmetric == was.symmetric);
  CHECK(is.selection == was.selection);
  CHECK(is.friction == was.friction);
  CHECK(is.wale_spacing_m == was.wale_spacing_m);
  REQUIRE(is.crumpling);
  CHECK(is.crumpling->event_amplitudes == was.crumpling->event_amplitudes);
  REQUIRE(is.crumpling->units.size() == was.crumpling->units.size());
  for (std::size_t i = 0; i < is.crumpling->units.size(); ++i) {
    CHECK(is.crumpling->units[i].energy_s == Approx(was.crumpling->units[i].energy_s).epsilon(1e-5));
  }
  CHECK(is.recording_of(119) == 0);
  CHECK(is.recording_of(120) == 1);
  const auto again = load(written.path, 48000);
  REQUIRE(again);
  CHECK(**again == **loaded);
  const TemporaryFolder other;
  REQUIRE(write(written.pack, other.path() / "felt"));
  for (const auto& entry : std::filesystem::recursive_directory_iterator(written.path)) {
    if (!entry.is_regular_file()) continue;
    CHECK(read_bytes(entry.path()) == read_bytes(other.path() / "felt" / entry.path().lexically_relative(written.path)));
  }
}

TEST_CASE("packs are equal by everything they hold") {
  SoundPack pack = example_pack();
  pack.cloth = std::make_shared<const ClothCorpus>(example_corpus());
  const auto differs = [&](const auto& change) {
    SoundPack other = pack;
    change(other);
    return !(other == pack);
  };
  SoundPack same = pack;
  same.cloth = std::make_shared<const ClothCorpus>(*pack.cloth);
  CHECK(same == pack);
  CHECK(differs([](SoundPack& p) { p.name += "x"; }));
  CHECK(differs([](SoundPack& p) { p.version += "x"; }));
  CHECK(differs([](SoundPack& p) { p.material += "x"; }));
  CHECK(differs([](SoundPack& p) { p.touched_surface += "x"; }));
  CHECK(differs([](SoundPack& p) { p.grammage_kg_per_m2 *= 2; }));
  CHECK(differs([](SoundPack& p) { p.licence += "x"; }));
  CHECK(differs([](SoundPack& p) { p.origin += "x"; }));
  CHECK(differs([](SoundPack& p) { p.rate_hz = 1; }));
  CHECK(differs([](SoundPack& p) { p.stored_rate_hz = 1; }));
  CHECK(differs([](SoundPack& p) { p.crumpling.reset(); }));
  CHECK(differs([](SoundPack& p) { p.friction.reset(); }));
  CHECK(differs([](SoundPack& p) { p.folder = "x"; }));
  CHECK(differs([](SoundPack& p) { p.notices.emplace_back("x"); }));
  CHECK(differs([](SoundPack& p) { p.cloth.reset(); }));
  CHECK(differs([](SoundPack& p) {
    auto corpus = std::make_shared<ClothCorpus>(*p.cloth);
    corpus->recordings[0].channels[0][5] += 0.1F;
    p.cloth = corpus;
  }));
}

TEST_CASE("cloth loads at another rate: units of the same time, measured anew, the same levels") {
  const WrittenCloth written;
  for (const std::uint32_t rate : {44100U, 96000U}) {
    const auto loaded = load(written.path, rate);
    REQUIRE(loaded);
    const ClothCorpus &was = *written.pack.cloth, &is = *(*loaded)->cloth;
    CHECK(is.rate_hz == rate);
    CHECK(is.unit_samples == dsp::unit_length(1.0 / 240, rate));
    CHECK(std::abs(static_cast<int>(is.units()) - static_cast<int>(was.units())) <= 2);
    CHECK(is.causal.values.size() == is.units() * is.dims());
    CHECK(is.causal.warp == was.causal.warp);
    CHECK(is.friction.fft_size == static_cast<std::uint32_t>(friction_clip_length(rate)));
    for (std::size_t i = 0; i < 2; ++i) CHECK(is.friction.rms[i] == Approx(was.friction.rms[i]).epsilon(0.05));
    for (std::size_t i = 0; i < is.crumpling->units.size(); ++i) {
      CHECK(is.crumpling->units[i].energy_s == Approx(was.crumpling->units[i].energy_s).epsilon(0.15));
    }
  }
}

TEST_CASE("every cut file of cloth is an error that names it, with a remedy") {
  const WrittenCloth written;
  Findings findings;
  const auto manifest = read_manifest(written.path, findings);
  REQUIRE(manifest);
  const auto files = named_files(*manifest);
  CHECK(files.size() == 2 + 2 + 1 + 2 + 4);
  for (const std::string& name : files) {
    const std::string bytes = read_bytes(written.path / name);
    for (const std::size_t keep : {std::size_t{0}, std::size_t{9}, bytes.size() / 2, bytes.size() - 1}) {
      write_bytes(written.path / name, bytes.substr(0, keep));
      const auto loaded = load(written.path, 48000);
      CAPTURE(name, keep, bytes.size());
      REQUIRE_FALSE(loaded);
      CHECK(loaded.error().file.find(std::filesystem::path(name).filename().string()) != std::string::npos);
      CHECK_FALSE(loaded.error().remedy.empty());
    }
    std::filesystem::remove(written.path / name);
    const auto missing = load(written.path, 48000);
    REQUIRE_FALSE(missing);
    CHECK(missing.error().text().find(name) != std::string::npos);
    CHECK_FALSE(missing.error().remedy.empty());
    write_bytes(written.path / name, bytes);
  }
  CHECK(load(written.path, 48000));
}

TEST_CASE("features that are not of as many units as the recordings have are an error, unless they are measured anew") {
  const WrittenCloth written;
  const std::vector<std::vector<float>> shorter = {noise(0.4, 0.05, 3), noise(0.4, 0.05, 4)};
  REQUIRE(write_multichannel(written.path / "cloth/source_01.wav", shorter, 48000));
  const auto loaded = load(written.path, 48000);
  REQUIRE_FALSE(loaded);
  CHECK(loaded.error().file.find("causal.npy") != std::string::npos);
  CHECK(loaded.error().remedy.find("rustle pack calibrate") != std::string::npos);
  LoadOptions anew;
  anew.measure_units = true;
  const auto measured = load(written.path, anew);
  REQUIRE(measured);
  CHECK((*measured)->cloth->units() == 96 + 194);
  CHECK((*measured)->cloth->causal.warp.identity());
}

TEST_CASE("a manifest of cloth with a wrong type or value says which field") {
  const WrittenCloth written;
  const Json right = written.manifest();
  const auto wrong = [&](const char* pointer, const Json& value, const char* field) {
    Json changed = right;
    changed[Json::json_pointer(pointer)] = value;
    written.manifest(changed);
    const auto loaded = load(written.path, 48000);
    CAPTURE(pointer);
    REQUIRE_FALSE(loaded);
    CAPTURE(loaded.error().text());
    CHECK(loaded.error().field.find(field) != std::string::npos);
    CHECK_FALSE(loaded.error().remedy.empty());
  };
  wrong("/cloth/units_per_s", "fast", "cloth.units_per_s");
  wrong("/cloth/channels", 3, "cloth.");
  wrong("/cloth/channels", 99, "cloth.channels");
  wrong("/cloth/recordings", Json::array(), "cloth.recordings");
  wrong("/cloth/recordings/0/file", "../out.wav", "cloth.recordings[0].file");
  wrong("/cloth/features/widths", {20, 50}, "cloth.features.widths");
  wrong("/cloth/features/widths/1", -1, "cloth.features.widths[1]");
  wrong("/cloth/features/causal", 7, "cloth.features.causal");
  wrong("/cloth/selection/look_ahead", -2, "cloth.selection.look_ahead");
  wrong("/cloth/warp/causal/affine", {1, 2, 3}, "cloth.warp.causal.affine");
  wrong("/cloth/warp/lambda", -1, "cloth.warp.lambda");
  wrong("/cloth/friction/speeds_m_per_s", {0.4, 0.1}, "cloth.friction.speeds_m_per_s");
  wrong("/cloth/friction/speeds_m_per_s", {0.1, 0.2, 0.4}, "cloth.friction.file");
  wrong("/cloth/friction/fft_size", 1024, "cloth.friction.file");
  wrong("/cloth/crumpling/events/most_m", 0.001, "cloth.crumpling.events.most_m");
  wrong("/cloth/crumpling/events/counts", {0, 0}, "cloth.crumpling.events.counts");
  written.manifest(right);
  CHECK(load(written.path, 48000));
}

TEST_CASE("a check of cloth finds recordings that were replaced, rumble, pauses and what is missing") {
  const WrittenCloth written;
  CHECK_FALSE(has(check(written.path), Severity::kError, ""));
  CHECK_FALSE(has(check(written.path), Severity::kWarning, "cloth.features"));
  ClothCorpus changed = *written.pack.cloth;
  auto& channel = changed.recordings[1].channels[0];
  for (std::size_t n = 0; n < channel.size(); ++n)
    channel[n] = static_cast<float>(0.3 * std::sin(static_cast<double>(n) * 0.004));
  changed.crumpling->event_amplitudes.counts.clear();
  changed.causal.warp = dsp::identity_warp(6);
  SoundPack pack = written.pack;
  pack.cloth = std::make_shared<const ClothCorpus>(changed);
  REQUIRE(write(pack, written.path));
  const auto findings = check(written.path);
  CHECK(has(findings, Severity::kWarning, "they were replaced"));
  CHECK(has(findings, Severity::kWarning, "high-pass at 100 Hz"));
  CHECK(has(findings, Severity::kWarning, "cloth.crumpling.events"));
  CHECK(has(findings, Severity::kWarning, "cloth.warp"));
  CHECK(has(findings, Severity::kWarning, "repetition will be heard"));
  CHECK_FALSE(has(findings, Severity::kError, ""));
}

TEST_CASE("a recording is cut at its pauses, and its rumble taken out") {
  std::vector<float> sound = noise(1, 0.05, 1);
  const std::vector<float> second = noise(0.5, 0.05, 2);
  sound.resize(sound.size() + 48000, 0.0F);
  sound.insert(sound.end(), second.begin(), second.end());
  for (std::size_t n = 0; n < sound.size(); ++n) {
    if (n < 48000 || n >= 96000)
      sound[n] += static_cast<float>(0.2 * std::sin(2 * std::numbers::pi * 20 * static_cast<double>(n) / 48000));
  }
  std::vector<CorpusStretch> stretches;
  const auto recordings = source_recordings({sound}, 48000, {}, "cloth/source", 3, &stretches);
  REQUIRE(recordings.size() == 2);
  CHECK(recordings[0].file == "cloth/source_03.flac");
  CHECK(stretches[0].begin == 0);
  CHECK(static_cast<double>(recordings[0].samples()) / 48000 == Approx(1.05).margin(0.05));
  CHECK(static_cast<double>(stretches[1].begin) / 48000 == Approx(1.95).margin(0.02));
  for (const auto& recording : recordings) {
    double low = 0, all = 0;
    for (std::size_t n = 4800; n < recording.samples(); ++n) {
      const double x = recording.channels[0][n];
      low += x * std::sin(2 * std::numbers::pi * 20 * static_cast<double>(n) / 48000);
      all += x * x;
    }
    CHECK(std::abs(low) / static_cast<double>(recording.samples()) < 1e-3);
    CHECK(all > 0);
  }
}

TEST_CASE("crumpling events take units of equal rank; small ones are silent") {
  const ClothCorpus corpus = example_corpus();
  const ClothCrumpling& crumpling = *corpus.crumpling;
  CHECK_FALSE(crumpling_unit_for(crumpling, 0.005));
  CHECK_FALSE(crumpling_unit_for(crumpling, 0));
  CHECK(crumpling_unit_for(crumpling, 0.01) == 0U);
  CHECK(crumpling_unit_for(crumpling, 50) == 3U);
  std::size_t before = 0;
  for (double amplitude = 0.01; amplitude < 2; amplitude *= 1.1) {
    const auto unit = crumpling_unit_for(crumpling, amplitude);
    REQUIRE(unit);
    CHECK(*unit >= before);
    before = *unit;
  }
  ClothCrumpling alike = crumpling;
  for (auto& unit : alike.units) unit.energy_s = 1e-3;
  CHECK(crumpling_unit_for(alike, 0.3) == 0U);
}

TEST_CASE("correspondences are cut where either side ends, and residuals fall by the warp") {
  const ClothCorpus corpus = example_corpus();
  CHECK(units_of({0, 0, 0.1}, corpus, 1000).count == 24);
  CHECK(units_of({0, 1.3, 0.1}, corpus, 1000).count == 2);
  CHECK(units_of({9, 0, 0.1}, corpus, 1000).count == 0);
  ClothCorpus plain = corpus;
  plain.selection.lambda = 0;
  const std::vector<std::vector<float>> target = {noise(2, 0.1, 90), noise(2, 0.01, 91)};
  const TargetFeatures features = target_features(plain, target);
  const std::vector<Correspondence> pairs = {{0.1, 0.2, 0.1}, {0.5, 0.6, 0.2}, {99, 0, 0.1}};
  const auto exact = calibrate(plain, features, pairs);
  REQUIRE(exact.size() == 3);
  CHECK(exact[0].units == 24);
  CHECK(exact[0].before > 1);
  CHECK(exact[0].after < 1e-6);
  CHECK(exact[2].units == 0);
  plain.selection.lambda = 1e5;
  const auto stiff = calibrate(plain, features, pairs);
  CHECK(stiff[0].after > exact[0].after);
  CHECK(stiff[0].after < stiff[0].before);
  const auto proposed = proposed_correspondences(plain, features, 6);
  CHECK(proposed.size() == 7);
  for (const auto& pair : proposed) CHECK(units_of(pair, plain, features.units).count == 24);
  plain.selection.lambda = 0;  // met exactly: the middle unit of each
  const auto single = proposed_correspondences(plain, features, 6);
  REQUIRE(single.size() == proposed.size());
  for (std::size_t i = 0; i < single.size(); ++i) {
    const UnitInterval clip = units_of(proposed[i], plain, features.units),
                       unit = units_of(single[i], plain, features.units);
    CHECK(unit.count == 1);
    CHECK(unit.target == clip.target + 11);
    CHECK(unit.database == clip.database + 11);
  }
}

}  // namespace
}  // namespace rustle::pack::cloth_pack_test
