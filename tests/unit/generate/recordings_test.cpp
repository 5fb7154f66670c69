#include <sndfile.h>

#include <catch2/catch.hpp>
#include <filesystem>
#include <map>
#include <memory>
#include <string>

#include "sound_db/dsp/resample.h"
#include "tests/unit/generate/measures.h"

namespace recordings_test {

using namespace rustle;
using namespace rustle::generate;

namespace {

struct Range {
  double least = 1e300, most = 0;
  void add(double value) {
    least = std::min(least, value);
    most = std::max(most, value);
  }
  bool holds(double value) const { return value >= least && value <= most; }
};

struct Features {
  Range centroid_hz, kurtosis;
};

/// What real paper measures, whole recordings trimmed at 40 dB. Centroids: more recordings than lie beside this repository.
/// Flaps: books whose pages turn. Crumples: a sheet of paper, and card packs' wrappers. Slides: cards and a sheet, each
/// pushed once by hand. Clacs: the 30 ms from the loudest moments of the crumples on.
const std::map<std::string, Features> kReal = {{"flap", {{3400, 7232}, {19, 379}}},
                                               {"crumple", {{3600, 7500}, {51, 236}}},
                                               {"slide", {{3700, 7700}, {7.7, 264}}},
                                               {"clac", {{3100, 6900}, {3.4, 39.5}}}};

struct ValuesOf {
  std::vector<double> centroids_hz, kurtoses;
  void add(std::span<const float> sound) {
    centroids_hz.push_back(centroid_hz(sound));
    kurtoses.push_back(kurtosis(sound));
  }
};

std::vector<float> recording(const std::filesystem::path& file) {
  SF_INFO info{};
  const std::unique_ptr<SNDFILE, int (*)(SNDFILE*)> opened(sf_open(file.c_str(), SFM_READ, &info), sf_close);
  REQUIRE(opened);
  std::vector<float> frames(static_cast<std::size_t>(info.frames * info.channels));
  frames.resize(static_cast<std::size_t>(sf_readf_float(opened.get(), frames.data(), info.frames) * info.channels));
  const auto channels = static_cast<std::size_t>(info.channels);
  std::vector<float> mono(frames.size() / channels, 0.0f);
  for (std::size_t n = 0; n < frames.size(); ++n) mono[n / channels] += frames[n] / static_cast<float>(channels);
  return info.samplerate == 48000 ? mono : dsp::resample(mono, info.samplerate, kRate_hz);
}

/// 30 ms each, from a millisecond before the loudest milliseconds, 40 ms apart.
std::vector<std::vector<float>> loudest_moments(const std::vector<float>& sound, int count) {
  auto energy = energies(sound, 0.001);
  std::vector<std::vector<float>> result;
  for (int i = 0; i < count; ++i) {
    const auto at = static_cast<std::size_t>(std::max_element(energy.begin(), energy.end()) - energy.begin());
    const std::size_t from = 48 * std::max<std::size_t>(at, 1) - 48, to = std::min(sound.size(), from + 1440);
    result.emplace_back(sound.begin() + static_cast<std::ptrdiff_t>(from), sound.begin() + static_cast<std::ptrdiff_t>(to));
    for (std::size_t k = at < 40 ? 0 : at - 40; k < std::min(energy.size(), at + 40); ++k) energy[k] = 0;
  }
  return result;
}

/// Clacs and one small flap in twenty, energies with exponent 1.45 over two decades (P13), waiting times log-uniform over
/// 1-50 ms. Flaps carry the energy of clacs.
std::vector<float> crumple(const pack::SoundPack& pack, dsp::Random random) {
  std::vector<float> out(57600, 0.0f);
  const auto clacs = pack::nearest_variants(*pack.crumpling, {}),
             flaps = pack::nearest_variants(*pack.crumpling, {0.025, 0.05});
  std::uint32_t last = pack::kNoUnit;
  for (double t = 0; t < 1.15; t += random.log_uniform(0.001, 0.05)) {
    const bool flap = random.uniform() < 0.05;
    last = pack::choose_variant(flap ? flaps : clacs, random.uniform(), last);
    const auto& unit = pack.crumpling->units[last].samples;
    const double gain = (flap ? 0.1 : 1.0) * std::sqrt(random.truncated_pareto(1.45, 0.01, 1.0));
    const auto from = static_cast<std::size_t>(t * kRate_hz);
    for (std::size_t n = 0; n < unit.size() && from + n < out.size(); ++n)
      out[from + n] += static_cast<float>(gain) * unit[n];
  }
  return out;
}

std::vector<float> steady_slide(const pack::SoundPack& pack, const pack::Spectrum& spectrum, double seconds,
                                std::uint64_t seed) {
  return friction_noise(spectrum.magnitudes, seconds, *pack.friction, dsp::Random(seed));
}

/// A push by hand of half a second: the speed of least jerk, t² (1 - t)².
std::vector<float> slide(const pack::SoundPack& pack, const pack::Spectrum& spectrum, std::uint64_t seed) {
  auto out = steady_slide(pack, spectrum, 0.5, seed);
  for (std::size_t n = 0; n < out.size(); ++n) {
    const double t = static_cast<double>(n) / static_cast<double>(out.size());
    out[n] *= static_cast<float>(16 * t * t * (1 - t) * (1 - t));
  }
  return out;
}

std::map<std::string, ValuesOf> generated(const pack::SoundPack& pack) {
  std::map<std::string, ValuesOf> result;
  for (const pack::Unit& unit : pack.crumpling->units) result[unit.point.constrained() ? "clac" : "flap"].add(unit.samples);
  for (std::uint64_t i = 0; i < 8; ++i) result["crumple"].add(crumple(pack, dsp::Random(i)));
  for (std::size_t i = 0; i < pack.friction->spectra.size(); ++i)
    result["slide"].add(slide(pack, pack.friction->spectra[i], i));
  return result;
}

}  // namespace

TEST_CASE("centroid and kurtosis of flaps, clacs, crumples and slides lie among those of real paper") {
  for (const pack::SoundPack& pack : packs()) {
    for (const auto& [kind, values] : generated(pack)) {
      const Features& real = kReal.at(kind);
      INFO(pack.material << " " << kind << ": centroids "
                         << *std::min_element(values.centroids_hz.begin(), values.centroids_hz.end()) << "-"
                         << *std::max_element(values.centroids_hz.begin(), values.centroids_hz.end())
                         << " Hz, median kurtosis " << median(values.kurtoses));
      CHECK(real.centroid_hz.holds(median(values.centroids_hz)));
      CHECK(real.kurtosis.holds(median(values.kurtoses)));
      if (pack.material != "printer-paper") continue;
      for (const double centroid : values.centroids_hz) CHECK(real.centroid_hz.holds(centroid));
      if (kind == "slide" || kind == "crumple") continue;
      // A clac is less than a crumple: it may have what either has.
      const double most = kind == "clac" ? kReal.at("crumple").kurtosis.most : real.kurtosis.most;
      for (const double kurtosis : values.kurtoses) CHECK((kurtosis >= real.kurtosis.least && kurtosis <= most));
    }
  }
}

TEST_CASE("steady sliding has a kurtosis of 4-6") {
  const pack::SoundPack& pack = packs().front();
  std::vector<double> kurtoses;
  for (std::size_t i = 0; i < 12; ++i) kurtoses.push_back(kurtosis(steady_slide(pack, pack.friction->spectra[7 * i], 3, i)));
  CHECK((median(kurtoses) > 4 && median(kurtoses) < 6));
}

TEST_CASE("the ranges are those of the recordings beside this repository") {
  const auto folder = std::filesystem::path(RUSTLE_SOURCE_DIR).parent_path() / "shared/recordings";
  if (!std::filesystem::exists(folder)) {
    WARN("no recordings beside this repository");
    return;
  }
  std::map<std::string, Features> measured;
  const auto add = [&](const std::string& kind, std::span<const float> sound) {
    measured[kind].centroid_hz.add(centroid_hz(sound));
    measured[kind].kurtosis.add(kurtosis(sound));
  };
  for (const char* file : {"kenney-rpg/bookFlip1.ogg", "kenney-rpg/bookFlip3.ogg", "kenney-rpg/bookOpen.ogg"}) {
    add("flap", recording(folder / file));
  }
  for (const auto& [file, moments] : {std::pair{"freesound-drooler/508597__drooler__crumple-06.ogg", 10},
                                      {"kenney-casino/cards-pack-open-1.ogg", 6},
                                      {"kenney-casino/cards-pack-open-2.ogg", 6}}) {
    const auto sound = recording(folder / file);
    add("crumple", sound);
    for (const auto& moment : loudest_moments(sound, moments)) add("clac", moment);
  }
  for (const auto& [name, count] : {std::pair{"card-slide-", 8}, {"card-shove-", 4}, {"cards-pack-take-out-", 1}}) {
    for (int i = 1; i <= count; ++i) add("slide", recording(folder / "kenney-casino" / (name + std::to_string(i) + ".ogg")));
  }
  const auto sheet = recording(folder / "automat/canvas_pick.wav");  // it lands after half a second
  add("slide", std::span(sheet).first(24000));
  for (const auto& [kind, real] : kReal) {
    INFO(kind << ": " << measured[kind].centroid_hz.least << "-" << measured[kind].centroid_hz.most << " Hz, kurtosis "
              << measured[kind].kurtosis.least << "-" << measured[kind].kurtosis.most);
    CHECK(real.centroid_hz.holds(measured[kind].centroid_hz.least));
    CHECK(real.centroid_hz.holds(measured[kind].centroid_hz.most));
    CHECK(real.kurtosis.least == Approx(measured[kind].kurtosis.least).epsilon(0.05));
    CHECK(real.kurtosis.most == Approx(measured[kind].kurtosis.most).epsilon(0.05));
  }
}

}  // namespace recordings_test
