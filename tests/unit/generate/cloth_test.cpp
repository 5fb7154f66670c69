#include <catch2/catch.hpp>

#include <sndfile.h>

#include <algorithm>
#include <cmath>
#include <complex>
#include <filesystem>
#include <map>
#include <memory>
#include <numeric>
#include <string>
#include <vector>

#include "sound_db/dsp/fft.h"
#include "sound_db/dsp/level.h"
#include "sound_db/dsp/resample.h"
#include "sound_db/dsp/statistics.h"
#include "sound_db/dsp/thin_plate_spline.h"
#include "sound_db/dsp/unit_features.h"
#include "sound_db/generate/cloth.h"
#include "sound_db/generate/cloth_motion.h"
#include "sound_db/generate/cloth_sound.h"
#include "sound_db/pack/calibration.h"
#include "sound_db/pack/check.h"
#include "sound_db/pack/corpus_source.h"
#include "sound_db/pack/load.h"
#include "sound_db/pack/spectra.h"
#include "tests/unit/pack/example_pack.h"

namespace rustle::generate::cloth_test {
namespace {

constexpr double kRate_hz = 48000;

/// Each material's pack, made once.
const std::map<std::string, pack::SoundPack>& packs() {
  static const auto made = [] {
    std::map<std::string, pack::SoundPack> result;
    for (const ClothMaterial& material : cloth_materials()) result[std::string(material.name)] = make_cloth_pack(material);
    return result;
  }();
  return made;
}

std::vector<float> whole(const pack::ClothCorpus& corpus) {
  std::vector<float> sound;
  for (const auto& recording : corpus.recordings) {
    sound.insert(sound.end(), recording.channels[0].begin(), recording.channels[0].end());
  }
  return sound;
}

/// What a sound of cloth is measured by: centroid of its mean spectrum, and the spread of the features of its units within
/// 50 dB of the loudest, filtered as cotton's are.
struct Measured {
  double centroid_hz = 0;
  std::vector<double> spread;  ///< [kUnitFeatures] standard deviation
};

Measured measured(std::span<const float> sound) {
  const std::vector<int> widths = {20, 50, 10};
  const auto raw = dsp::unit_features(sound, 200, kRate_hz);
  const std::vector<std::uint32_t> first = {0, static_cast<std::uint32_t>(raw.size() / dsp::kUnitFeatures)};
  const auto features = dsp::filtered_features(raw, dsp::kUnitFeatures, widths, first, false);
  float loudest = -1000;
  for (std::size_t i = 0; i < raw.size(); i += dsp::kUnitFeatures) loudest = std::max(loudest, raw[i]);
  Measured result{dsp::spectral_centroid_hz(dsp::mean_magnitude(sound), kRate_hz), {}};
  for (std::size_t d = 0; d < dsp::kUnitFeatures; ++d) {
    double sum = 0, square = 0, count = 0;
    for (std::size_t i = 0; i < raw.size(); i += dsp::kUnitFeatures) {
      if (raw[i] < loudest - 20) continue;
      const double f = features[i + d];
      sum += f;
      square += f * f;
      ++count;
    }
    result.spread.push_back(std::sqrt(square / count - sum / count * sum / count));
  }
  return result;
}

/// Centre of the peak of the envelope's spectrum between low_hz and high_hz, and its share of the energy within ±20 %.
struct Pulse {
  double frequency_hz = 0, share = 0;
};

Pulse pulse(std::span<const float> sound, double low_hz, double high_hz) {
  std::size_t size = 2;
  while (2 * size <= sound.size()) size *= 2;
  dsp::RealFft fft(static_cast<int>(size));
  double mean = 0;
  for (std::size_t n = 0; n < size; ++n) mean += std::abs(sound[n]) / static_cast<double>(size);
  for (std::size_t n = 0; n < size; ++n) {
    const double window = 0.5 - 0.5 * std::cos(2 * std::numbers::pi * static_cast<double>(n) / static_cast<double>(size));
    fft.time()[n] = static_cast<float>((std::abs(sound[n]) - mean) * window);
  }
  fft.forward();
  const double step_hz = kRate_hz / static_cast<double>(size);
  // Power in bands a tenth wide: pulses are irregular.
  Pulse best;
  double most = 0, all = 0;
  const auto power = [&](double from_hz, double to_hz) {
    double sum = 0;
    for (auto k = static_cast<std::size_t>(from_hz / step_hz); k <= static_cast<std::size_t>(to_hz / step_hz); ++k) {
      sum += std::norm(fft.spectrum()[k]);
    }
    return sum;
  };
  all = power(low_hz, high_hz);
  for (double f = low_hz * 1.05; f < high_hz / 1.05; f *= 1.01) {
    const double density = power(f / 1.05, f * 1.05) / f;
    if (density <= most) continue;
    most = density;
    best = {f, power(f / 1.2, f * 1.2) / all};
  }
  double weighted = 0, sum = 0;
  for (auto k = static_cast<std::size_t>(best.frequency_hz / 1.15 / step_hz);
       static_cast<double>(k) * step_hz < best.frequency_hz * 1.15; ++k) {
    weighted += static_cast<double>(k) * step_hz * static_cast<double>(std::norm(fft.spectrum()[k]));
    sum += static_cast<double>(std::norm(fft.spectrum()[k]));
  }
  best.frequency_hz = weighted / sum;
  return best;
}

TEST_CASE("packs of cloth are deterministic") {
  ClothOptions few;
  few.corpus_s = 8;
  few.pops = 10;
  for (const ClothMaterial& material : cloth_materials()) {
    const auto a = make_cloth_pack(material, few), b = make_cloth_pack(material, few);
    CHECK(a == b);
    few.seed = 2;
    CHECK_FALSE(make_cloth_pack(material, few) == a);
    few.seed = 1;
  }
}

TEST_CASE("a generated pack of cloth is written, passes its check and loads") {
  const pack::TemporaryFolder folder;
  for (const char* material : {"cotton", "corduroy"}) {
    const auto path = folder.path() / material;
    REQUIRE(write_pack(material, path));
    for (const pack::Finding& finding : pack::check(path)) FAIL_CHECK(finding.what.text());
    const auto loaded = pack::load(path, 48000);
    REQUIRE(loaded);
    const pack::ClothCorpus& corpus = *(*loaded)->cloth;
    CHECK(static_cast<double>(corpus.units()) * corpus.unit_s == Approx(120).margin(15));
    CHECK(corpus.friction.speeds_m_per_s.size() == 14);
    CHECK(corpus.crumpling.has_value() == (std::string(material) == "cotton"));
    CHECK_FALSE(corpus.causal.warp.identity());
  }
}

TEST_CASE("Table 3 and section 4.1: units, widths, look-ahead and distances") {
  const auto& made = packs();
  CHECK(made.at("cotton").cloth->unit_samples == 200);
  CHECK(made.at("corduroy").cloth->unit_samples == 800);
  CHECK(made.at("polyester").cloth->selection.filter_widths == std::vector{10, 50, 20});
  CHECK(made.at("windbreaker").cloth->selection.look_ahead == 5);
  CHECK(made.at("corduroy").cloth->selection.greatest_distance == 3);
  CHECK(made.at("corduroy").cloth->selection.lambda == 0);
  CHECK(made.at("corduroy").cloth->wale_spacing_m == 0.0014);
  for (const auto& [name, pack] : made) CHECK(pack.cloth->selection.cool_off == 20);
}

TEST_CASE("what slides faster is aimed at louder sounds of the corpus") {
  for (const auto& [name, pack] : packs()) {
    const pack::ClothCorpus& corpus = *pack.cloth;
    double before = -1000;
    for (const double speed : {0.1, 0.2, 0.35, 0.6, 1.2}) {
      std::vector<std::vector<float>> target(1);
      target[0] = pack::plain_target(
          corpus, 1, [&](double) { return speed; }, {}, 7);
      for (float& x : target[0]) x *= std::sqrt(0.2F);  // a fifth of the patch that the sweep was measured with
      const auto features = pack::target_features(corpus, target);
      std::vector<float> aimed(corpus.dims());
      double sum = 0;
      const std::size_t first = features.units / 2;
      for (std::size_t unit = first; unit < features.units; ++unit) {
        dsp::warp(corpus.causal.warp, std::span(features.causal).subspan(unit * corpus.dims(), corpus.dims()), aimed);
        sum += static_cast<double>(aimed[0]);
      }
      const double loudness = sum / static_cast<double>(features.units - first);
      CAPTURE(name, speed);
      CHECK(loudness > before);
      before = loudness;
    }
  }
}

TEST_CASE("the four materials differ pairwise, more than two recordings of one") {
  std::map<std::string, std::vector<double>> spectra;
  for (const auto& [name, pack] : packs()) {
    spectra[name] = dsp::spectrum_histogram(dsp::mean_magnitude(whole(*pack.cloth)));
  }
  for (const auto& [a, spectrum_a] : spectra) {
    for (const auto& [b, spectrum_b] : spectra) {
      if (a >= b) continue;
      CAPTURE(a, b);
      CHECK(dsp::quadratic_form_distance(spectrum_a, spectrum_b) >= 0.03);
    }
    const auto again = cloth_recording(*find_cloth_material(a), varied_motion(60, dsp::Random(77)), kRate_hz, 77);
    CAPTURE(a);
    CHECK(dsp::quadratic_form_distance(spectrum_a, dsp::spectrum_histogram(dsp::mean_magnitude(again))) < 0.03);
  }
}

TEST_CASE("friction grows with speed by the material's exponent, and its pitch follows in polyester and nylon") {
  for (const ClothMaterial& material : cloth_materials()) {
    const pack::FrictionSweep& sweep = packs().at(std::string(material.name)).cloth->friction;
    CAPTURE(material.name);
    const std::size_t last = sweep.rms.size() - 1;
    const double slope =
        std::log(sweep.rms[last] / sweep.rms[0]) / std::log(sweep.speeds_m_per_s[last] / sweep.speeds_m_per_s[0]);
    CHECK(slope == Approx(material.level_exponent).margin(0.12));
    const auto middle = [&](std::size_t i) {  // half of the power lies below
      const auto spectrum = sweep.spectrum(i);
      const auto power = [](double sum, float m) { return sum + static_cast<double>(m) * m; };
      const double all = std::accumulate(spectrum.begin(), spectrum.end(), 0.0, power);
      double below = 0;
      std::size_t k = 0;
      while (below < all / 2) below = power(below, spectrum[k++]);
      return static_cast<double>(k);
    };
    const double expected = std::pow(sweep.speeds_m_per_s[last] / sweep.speeds_m_per_s[0], material.bands[0].speed_exponent);
    CHECK(middle(last) / middle(0) == Approx(expected).epsilon(0.35));
  }
}

TEST_CASE("corduroy pulses at speed over wale spacing, the others do not") {
  for (const double speed : {0.2, 0.4, 0.8}) {
    const double expected_hz = speed / 0.0014;
    const auto sound = cloth_friction(*find_cloth_material("corduroy"), steady_motion(3, speed), kRate_hz, dsp::Random(5));
    const Pulse found = pulse(sound, 60, 1200);
    CAPTURE(speed, found.frequency_hz, found.share);
    CHECK(found.frequency_hz == Approx(expected_hz).epsilon(0.03));
    CHECK(found.share > 0.2);
    const auto smooth = cloth_friction(*find_cloth_material("cotton"), steady_motion(3, speed), kRate_hz, dsp::Random(5));
    CHECK(pulse(smooth, 60, 1200).share < 0.6 * found.share);
  }
  // The sweep: from fast to slow the pulse goes along.
  const ClothMotion roller = roller_motion(12);
  const auto sweep = cloth_friction(*find_cloth_material("corduroy"), roller, kRate_hz, dsp::Random(6));
  for (const double at_s : {3.0, 5.0, 6.5}) {
    const auto from = static_cast<std::size_t>(at_s * kRate_hz);
    const double expected_hz = roller.speed_at(at_s + 0.17) / 0.0014;
    const Pulse found = pulse(std::span(sweep).subspan(from, 16384), 60, 1200);
    CAPTURE(at_s, expected_hz, found.frequency_hz);
    CHECK(found.frequency_hz == Approx(expected_hz).epsilon(0.10));
  }
}

TEST_CASE("crumpling units: energies are a power law over three decades, none is cut") {
  for (const auto& [name, pack] : packs()) {
    if (!pack.cloth->crumpling) continue;
    CAPTURE(name);
    const auto& units = pack.cloth->crumpling->units;
    CHECK(units.size() == 160);
    CHECK(units.back().energy_s / units.front().energy_s > 1e3);
    for (std::size_t i = 0; i < units.size(); ++i) {
      if (i > 0) CHECK(units[i].energy_s >= units[i - 1].energy_s);
      CHECK(units[i].samples.size() < 9600);
      const float peak = *std::max_element(units[i].samples.begin(), units[i].samples.end());
      CHECK(std::abs(units[i].samples.front()) <= 0.2F * peak);
      CHECK(std::abs(units[i].samples.back()) <= 0.02F * peak);
    }
    // Median energy lies far below the mean: few loud ones, many soft.
    double mean = 0;
    for (const auto& unit : units) mean += unit.energy_s / static_cast<double>(units.size());
    CHECK(units[units.size() / 2].energy_s < 0.2 * mean);
  }
}

TEST_CASE("friction and crumpling are in balance: the loudest pop of a second is about as loud as a quick stroke") {
  for (const auto& [name, pack] : packs()) {
    if (!pack.cloth->crumpling) continue;
    const ClothMaterial& material = *find_cloth_material(name);
    ClothMotion crumpled = steady_motion(20, 0);
    std::fill(crumpled.crumpling.begin(), crumpled.crumpling.end(), 1.0);
    const auto pops = cloth_crumpling(material, crumpled, kRate_hz, dsp::Random(2));
    std::vector<double> loudest;
    for (std::size_t second = 0; second < 20; ++second) {
      loudest.push_back(dsp::kSilenceDb);
      for (std::size_t at = second * 48000; at + 240 <= (second + 1) * 48000; at += 240) {
        loudest.back() = std::max(loudest.back(), dsp::rms_dbfs(std::span(pops).subspan(at, 240)));
      }
    }
    std::sort(loudest.begin(), loudest.end());
    const double crumpling_db = loudest[loudest.size() / 2];
    const double friction_db = dsp::rms_dbfs(cloth_friction(material, steady_motion(5, 0.5), kRate_hz, dsp::Random(1)));
    CAPTURE(name, friction_db, crumpling_db);
    CHECK(std::abs(friction_db - crumpling_db) < 9);
  }
}

TEST_CASE("centroid and spread of features lie among those of recorded cloth") {
  // Centroids of method.md's "Default packs"; spreads of the recordings beside this repository.
  const Measured cotton = measured(whole(*packs().at("cotton").cloth));
  CAPTURE(cotton.centroid_hz, cotton.spread);
  CHECK(cotton.centroid_hz > 600);
  CHECK(cotton.centroid_hz < 4200);

  const auto folder = std::filesystem::path(RUSTLE_SOURCE_DIR).parent_path() / "shared/recordings";
  if (!std::filesystem::exists(folder)) {
    WARN("no recordings beside this repository");
    return;
  }
  std::vector<double> least(dsp::kUnitFeatures, 1e300), most(dsp::kUnitFeatures, 0.0);
  double lowest_hz = 1e9, highest_hz = 0;
  for (const char* name :
       {"kenney-rpg/cloth1.ogg", "kenney-rpg/cloth3.ogg", "kenney-rpg/cloth4.ogg",
        "freesound-martian/19291__martian__foley-cloth-rustle.wav", "repixture-cloth/rp_sounds_dig_fuzzy.1.ogg",
        "repixture-cloth/rp_sounds_dig_fuzzy.2.ogg", "repixture-cloth/rp_sounds_dug_fuzzy.1.ogg"}) {
    SF_INFO info{};
    const std::unique_ptr<SNDFILE, int (*)(SNDFILE*)> opened(sf_open((folder / name).c_str(), SFM_READ, &info), sf_close);
    REQUIRE(opened);
    std::vector<float> frames(static_cast<std::size_t>(info.frames * info.channels));
    sf_readf_float(opened.get(), frames.data(), info.frames);
    std::vector<float> mono(static_cast<std::size_t>(info.frames));
    for (std::size_t n = 0; n < mono.size(); ++n) mono[n] = frames[n * static_cast<std::size_t>(info.channels)];
    if (info.samplerate != 48000) mono = dsp::resample(mono, info.samplerate, kRate_hz);
    const auto parts = pack::source_recordings({mono}, kRate_hz, {}, "part");
    REQUIRE_FALSE(parts.empty());
    const Measured real = measured(std::max_element(parts.begin(), parts.end(), [](const auto& a, const auto& b) {
                                     return a.samples() < b.samples();
                                   })->channels[0]);
    INFO(name << ": centroid " << real.centroid_hz << " Hz, spread " << real.spread[0] << " " << real.spread[1] << " "
              << real.spread[2]);
    CHECK(real.centroid_hz > 0);
    lowest_hz = std::min(lowest_hz, real.centroid_hz);
    highest_hz = std::max(highest_hz, real.centroid_hz);
    for (std::size_t d = 0; d < dsp::kUnitFeatures; ++d) {
      least[d] = std::min(least[d], real.spread[d]);
      most[d] = std::max(most[d], real.spread[d]);
    }
  }
  CAPTURE(lowest_hz, highest_hz, least, most);
  CHECK(cotton.centroid_hz > lowest_hz);
  CHECK(cotton.centroid_hz < highest_hz);
  for (std::size_t d = 0; d < dsp::kUnitFeatures; ++d) {
    CAPTURE(d);
    CHECK(cotton.spread[d] >= least[d]);
    CHECK(cotton.spread[d] <= most[d]);
  }
}

}  // namespace
}  // namespace rustle::generate::cloth_test
