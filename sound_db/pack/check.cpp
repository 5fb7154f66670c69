#include "sound_db/pack/check.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <set>
#include <string>
#include <utility>

#include <fmt/format.h>

#include "sound_db/dsp/level.h"
#include "sound_db/pack/cloth_check.h"
#include "sound_db/pack/levels.h"
#include "sound_db/pack/load.h"
#include "sound_db/pack/manifest.h"
#include "sound_db/pack/warnings.h"

namespace rustle::pack {

namespace {

std::string place(const GridPoint& point) {
  return point.constrained()
             ? "(0, 0)"
             : fmt::format("l_r {:g} cm, l_c {:g} cm", 100 * point.ruling_length_m, 100 * point.free_border_length_m);
}

void check_unit(const Unit& unit, double rate_hz, double gain, Warnings& warn) {
  const double seconds = static_cast<double>(unit.samples.size()) / rate_hz;
  const double peak = dsp::peak(unit.samples);
  if (peak < 1e-7) return warn(unit.file, "", "is silent", "record it again or take it out");
  if (peak / gain >= 0.9999) warn(unit.file, "", "reaches full scale: it may be clipped", "record it lower");
  if (seconds > 2.0) warn(unit.file, "", fmt::format("lasts {:.1f} s, flaps last a few tenths", seconds), "cut its end");
  double mean = 0;
  for (const float x : unit.samples) mean += x / static_cast<double>(unit.samples.size());
  if (std::abs(mean) > 0.05 * peak) warn(unit.file, "", "has a constant offset", "filter it with a high-pass");
  if (std::abs(unit.samples.front()) > 0.1 * peak)
    warn(unit.file, "", "starts with a step", "fade it in over a millisecond");
  if (std::abs(unit.samples.back()) > 0.02 * peak) warn(unit.file, "", "ends with a step", "fade it out");
}

void check_crumpling(const CrumplingSection& section, double rate_hz, double gain, Warnings& warn) {
  std::map<std::pair<double, double>, int> variants;
  std::set<std::string> files;
  for (const Unit& unit : section.units) {
    ++variants[{unit.point.ruling_length_m, unit.point.free_border_length_m}];
    if (!files.insert(unit.file).second) warn(unit.file, "crumpling.units", "is named twice", "take one entry out");
    check_unit(unit, rate_hz, gain, warn);
  }
  if (!variants.contains({0, 0})) {
    warn(kManifestName, "crumpling.units", "has no unit at (0, 0): constrained events are silent",
         "add clacs with l_r_m and l_c_m 0");
  }
  if (variants.size() <= (variants.contains({0, 0}) ? 1u : 0u)) {
    warn(kManifestName, "crumpling.units", "has no flap: unconstrained events are silent",
         "add units with their l_r_m and l_c_m");
  }
  for (const auto& [point, count] : variants) {
    if (count > 1) continue;
    warn(kManifestName, "crumpling.units",
         fmt::format("has one unit at {}: repetition will be heard", place({point.first, point.second})), "add two more");
  }
  if (const auto level = reference_flap_peak_dbfs(section); level && std::abs(*level - kReferenceFlapPeak_dbfs) > 3) {
    warn(kManifestName, "crumpling.gain_db",
         fmt::format("the reference flap peaks at {:.1f} dBFS, expected {}", *level, kReferenceFlapPeak_dbfs),
         fmt::format("add {:.1f} dB to gain_db", kReferenceFlapPeak_dbfs - *level));
  }
}

void check_friction(const FrictionSection& section, Warnings& warn) {
  std::set<std::pair<double, double>> points;
  for (const Spectrum& spectrum : section.spectra) {
    if (!points.insert({spectrum.point.ruling_length_m, spectrum.point.free_border_length_m}).second) {
      warn(spectrum.file, "friction.spectra", fmt::format("is a second spectrum for {}", place(spectrum.point)),
           "take one out; only the first is used");
    }
    if (std::all_of(spectrum.magnitudes.begin(), spectrum.magnitudes.end(), [](float m) { return m < 1e-9f; })) {
      warn(spectrum.file, "", "is silent", "measure it again or take it out");
    }
  }
  if (!points.contains({0, 0})) {
    warn(kManifestName, "friction.spectra", "has no flat spectrum: flat sheets slide in silence",
         "add one with l_r_m and l_c_m 0");
  }
  if (points.size() <= (points.contains({0, 0}) ? 1u : 0u)) {
    warn(kManifestName, "friction.spectra", "has no bent sheet: bent sheets slide in silence",
         "add spectra with their l_r_m and l_c_m");
  }
  if (const auto level = reference_friction_dbfs(section); level && std::abs(*level - kReferenceFriction_dbfs) > 3) {
    warn(kManifestName, "friction.gain_db",
         fmt::format("the reference slide has {:.1f} dBFS, expected {}", *level, kReferenceFriction_dbfs),
         fmt::format("add {:.1f} dB to gain_db", kReferenceFriction_dbfs - *level));
  }
}

void check_strays(const std::filesystem::path& folder, const Manifest& manifest, Warnings& warn) {
  namespace fs = std::filesystem;
  std::set<std::string> named;
  for (const std::string& file : named_files(manifest)) named.insert(fs::path(file).lexically_normal().string());
  std::set<std::string> strays;
  std::error_code failed;
  for (fs::recursive_directory_iterator at(folder, failed), end; !failed && at != end; at.increment(failed)) {
    const std::string name = at->path().lexically_relative(folder).string(), kind = at->path().extension().string();
    if ((kind == ".wav" || kind == ".flac" || kind == ".npy") && !named.contains(name)) strays.insert(name);
  }
  if (!manifest.pack.notices.empty()) return;  // a section that is left alone may name them
  for (const std::string& name : strays) warn(name, "", "is not named in pack.json", "add an entry or take it away");
}

}  // namespace

Findings check(const std::filesystem::path& folder) {
  Findings findings;
  Findings manifest_findings;
  const auto manifest = read_manifest(folder, manifest_findings);
  LoadOptions options;
  if (manifest) options.rate_hz = std::clamp<std::uint32_t>(manifest->pack.stored_rate_hz, 8000, 192000);
  const auto pack = load_with_findings(folder, options, findings);
  if (!pack) return findings;
  Warnings warn(folder, findings);
  if (!pack->crumpling && !pack->friction && !pack->cloth) {
    warn(kManifestName, "", "has neither crumpling nor friction nor cloth: the pack is silent", "add a section");
  }
  if (pack->crumpling) check_crumpling(*pack->crumpling, pack->rate_hz, dsp::db_to_gain(manifest->crumpling_gain_db), warn);
  if (pack->friction) check_friction(*pack->friction, warn);
  if (pack->cloth) check_cloth(*pack->cloth, *manifest->cloth, folder, findings);
  check_strays(folder, *manifest, warn);
  return findings;
}

}  // namespace rustle::pack
