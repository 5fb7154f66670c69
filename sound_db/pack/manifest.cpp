#include "sound_db/pack/manifest.h"

#include <algorithm>
#include <cmath>
#include <fstream>
#include <sstream>

#include <fmt/format.h>

#include "sound_db/pack/cloth_json.h"
#include "sound_db/pack/json_reader.h"

namespace rustle::pack {

namespace {

constexpr std::uintmax_t kMostManifestBytes = 16u << 20;

RecordingGeometry read_geometry(Reader& section) {
  RecordingGeometry geometry;
  auto object = section.object("geometry", true);
  if (!object) return geometry;
  geometry.distance_m = object->number("distance_m", std::nullopt, 0.01, 100);
  geometry.elevation_deg = object->number("elevation_deg", std::nullopt, 5, 90);
  geometry.plane = object->flag("plane", false);
  geometry.compression = object->number("compression", 0.0, 0, 0.95);
  if (geometry.plane && geometry.compression <= 0) {
    object->error("compression", "is missing, but bent sheets over a plane stand as high as it says", "add it, 0.3 say");
  }
  object->warn_unknown();
  return geometry;
}

template <class Entry>
Entry read_entry(Reader& object) {
  Entry entry;
  entry.point.ruling_length_m = object.number("l_r_m", std::nullopt, 0, 10);
  entry.point.free_border_length_m = object.number("l_c_m", std::nullopt, 0, 10);
  if ((entry.point.ruling_length_m > 0) != (entry.point.free_border_length_m > 0)) {
    object.error("l_r_m", "and l_c_m are not both 0 nor both above 0", "0 and 0 mean constrained (clac, flat friction)");
  }
  entry.radius_m = object.number("radius_m", entry.point.disc_radius_m(), 0, 10);
  entry.file = object.text("file", true);
  return entry;
}

/// A section of a version this program reads, or nothing.
std::optional<Reader> versioned(Reader& root, const std::string& name, std::vector<std::string>& notices) {
  auto section = root.object(name, false);
  if (!section) return std::nullopt;
  const auto version = section->integer("version", std::nullopt, 1, 1000000);
  if (version <= 1) return section;
  notices.push_back(fmt::format("{} has version {}, this Rustle reads 1: the section is left alone", name, version));
  return std::nullopt;
}

CrumplingSection read_crumpling(Reader& section, double& gain_db) {
  CrumplingSection crumpling;
  crumpling.geometry = read_geometry(section);
  gain_db = section.number("gain_db", 0.0, -200, 200);
  crumpling.reference_compression = section.number("reference_compression", crumpling.reference_compression, 0.001, 0.95);
  crumpling.constrained_reference_amplitude_m =
      section.number("constrained_reference_amplitude_m", crumpling.constrained_reference_amplitude_m, 1e-6, 10);
  for (Reader& object : section.objects("units")) {
    crumpling.units.push_back(read_entry<Unit>(object));
    object.warn_unknown();
  }
  section.warn_unknown();
  return crumpling;
}

FrictionSection read_friction(Reader& section, std::uint32_t rate_hz, double& gain_db, std::vector<std::int64_t>& rows) {
  FrictionSection friction;
  friction.rate_hz = rate_hz;
  friction.geometry = read_geometry(section);
  gain_db = section.number("gain_db", 0.0, -200, 200);
  friction.reference_speed_m_per_s = section.number("reference_speed_m_per_s", std::nullopt, 1e-4, 100);
  friction.speed_exponent = section.number("speed_exponent", friction.speed_exponent, 0, 4);
  friction.fft_size = static_cast<std::uint32_t>(section.integer("fft_size", std::nullopt, 16, 65536));
  if (friction.fft_size % 2) section.error("fft_size", "is odd", "spectra have fft_size / 2 + 1 bins");
  friction.gain_sigma = section.number("gain_sigma", friction.gain_sigma, 0, 2);
  friction.gain_cutoff_hz = section.number("gain_cutoff_hz", friction.gain_cutoff_hz, 0.1, 20000);
  for (Reader& object : section.objects("spectra")) {
    friction.spectra.push_back(read_entry<Spectrum>(object));
    rows.push_back(object.integer("row", -1, -1, 1000000));
    object.warn_unknown();
  }
  section.warn_unknown();
  return friction;
}

tl::expected<Json, PackError> parse(const std::filesystem::path& file) {
  std::error_code failed;
  const auto length = std::filesystem::file_size(file, failed);
  if (failed || !std::filesystem::is_regular_file(file, failed)) {
    return tl::unexpected(PackError{file.string(), "", "cannot be read", "a sound pack is a folder with a pack.json"});
  }
  if (length > kMostManifestBytes) {
    return tl::unexpected(PackError{file.string(), "", fmt::format("{} bytes is too large", length), "is it a pack.json?"});
  }
  std::ifstream stream(file, std::ios::binary);
  std::ostringstream text;
  text << stream.rdbuf();
  try {
    Json root = Json::parse(text.str());
    if (root.is_object()) return root;
    return tl::unexpected(PackError{file.string(), "", "is not a JSON object", "a pack.json starts with {"});
  } catch (const Json::exception& error) {
    return tl::unexpected(
        PackError{file.string(), "", fmt::format("is not JSON ({})", error.what()), "mend it, or make the pack again"});
  }
}

bool has_error(const Findings& findings) {
  return std::any_of(findings.begin(), findings.end(), [](const Finding& f) { return f.severity == Severity::kError; });
}

Json geometry_json(const RecordingGeometry& geometry) {
  return {{"distance_m", geometry.distance_m},
          {"elevation_deg", geometry.elevation_deg},
          {"plane", geometry.plane},
          {"compression", geometry.compression}};
}

template <class Entry>
Json entry_json(const Entry& entry) {
  Json object{{"l_r_m", entry.point.ruling_length_m}, {"l_c_m", entry.point.free_border_length_m}};
  object["radius_m"] = entry.radius_m;
  object["file"] = entry.file;
  return object;
}

}  // namespace

std::optional<Manifest> read_manifest(const std::filesystem::path& folder, Findings& findings) {
  const std::filesystem::path file = folder / kManifestName;
  const auto json = parse(file);
  if (!json) {
    findings.push_back({Severity::kError, json.error()});
    return std::nullopt;
  }
  const std::size_t before = findings.size();
  Reader root(*json, "", file.string(), findings);
  Manifest manifest;
  SoundPack& pack = manifest.pack;
  if (root.text("format", true) != "rustle-pack") {
    root.error("format", "is not \"rustle-pack\"", "is it the pack.json of a sound pack?");
    return std::nullopt;
  }
  if (root.integer("format_version", std::nullopt, 1, 1000000) > kFormatVersion) {
    root.error("format_version", fmt::format("is newer than {}, which this Rustle reads", kFormatVersion), "update Rustle");
    return std::nullopt;
  }
  pack.name = root.text("name", true);
  pack.version = root.text("version", true);
  pack.material = root.text("material", true);
  pack.touched_surface = root.text("touched_surface", true);
  pack.grammage_kg_per_m2 = root.number("grammage_kg_per_m2", kDefaultGrammage_kg_per_m2, 1e-4, 100);
  pack.licence = root.text("licence", true);
  pack.origin = root.text("origin", true);
  pack.stored_rate_hz = static_cast<std::uint32_t>(root.integer("rate_hz", std::nullopt, 8000, 768000));
  pack.rate_hz = pack.stored_rate_hz;
  pack.folder = folder;
  if (auto section = versioned(root, "crumpling", pack.notices)) {
    pack.crumpling = read_crumpling(*section, manifest.crumpling_gain_db);
  }
  if (auto section = versioned(root, "friction", pack.notices)) {
    pack.friction = read_friction(*section, pack.stored_rate_hz, manifest.friction_gain_db, manifest.rows);
  }
  if (auto section = versioned(root, "cloth", pack.notices)) {
    manifest.cloth = read_cloth_manifest(*section, pack.stored_rate_hz);
  }
  for (const std::string& key : root.unknown()) {
    pack.notices.push_back(fmt::format("{} is not known and is left alone", key));
  }
  for (const std::string& notice : pack.notices) root.warning("", notice, "a later Rustle may read it");
  const Findings found(findings.begin() + static_cast<std::ptrdiff_t>(before), findings.end());
  if (has_error(found)) return std::nullopt;
  return manifest;
}

std::string manifest_text(const Manifest& manifest) {
  const SoundPack& pack = manifest.pack;
  Json root{{"format", "rustle-pack"}, {"format_version", kFormatVersion}};
  root["name"] = pack.name;
  root["version"] = pack.version;
  root["material"] = pack.material;
  root["touched_surface"] = pack.touched_surface;
  root["grammage_kg_per_m2"] = pack.grammage_kg_per_m2;
  root["licence"] = pack.licence;
  root["origin"] = pack.origin;
  root["rate_hz"] = pack.stored_rate_hz;
  if (pack.crumpling) {
    const CrumplingSection& crumpling = *pack.crumpling;
    Json section{{"version", 1}, {"geometry", geometry_json(crumpling.geometry)}};
    section["gain_db"] = manifest.crumpling_gain_db;
    section["reference_compression"] = crumpling.reference_compression;
    section["constrained_reference_amplitude_m"] = crumpling.constrained_reference_amplitude_m;
    section["units"] = Json::array();
    for (const Unit& unit : crumpling.units) section["units"].push_back(entry_json(unit));
    root["crumpling"] = std::move(section);
  }
  if (pack.friction) {
    const FrictionSection& friction = *pack.friction;
    Json section{{"version", 1}, {"geometry", geometry_json(friction.geometry)}};
    section["gain_db"] = manifest.friction_gain_db;
    section["reference_speed_m_per_s"] = friction.reference_speed_m_per_s;
    section["speed_exponent"] = friction.speed_exponent;
    section["fft_size"] = friction.fft_size;
    section["gain_sigma"] = friction.gain_sigma;
    section["gain_cutoff_hz"] = friction.gain_cutoff_hz;
    section["spectra"] = Json::array();
    for (std::size_t i = 0; i < friction.spectra.size(); ++i) {
      Json entry = entry_json(friction.spectra[i]);
      if (i < manifest.rows.size() && manifest.rows[i] >= 0) entry["row"] = manifest.rows[i];
      section["spectra"].push_back(std::move(entry));
    }
    root["friction"] = std::move(section);
  }
  if (manifest.cloth) root["cloth"] = cloth_json(*manifest.cloth);
  return root.dump(1, ' ', true, Json::error_handler_t::replace) + "\n";
}

std::vector<std::string> named_files(const Manifest& manifest) {
  std::vector<std::string> names;
  if (manifest.pack.crumpling) {
    for (const Unit& unit : manifest.pack.crumpling->units) names.push_back(unit.file);
  }
  if (manifest.pack.friction) {
    for (const Spectrum& spectrum : manifest.pack.friction->spectra) names.push_back(spectrum.file);
  }
  if (manifest.cloth) {
    const std::vector<std::string> of_cloth = named_files(*manifest.cloth);
    names.insert(names.end(), of_cloth.begin(), of_cloth.end());
  }
  return names;
}

tl::expected<std::filesystem::path, std::string> resolve(const std::filesystem::path& folder, const std::string& name) {
  namespace fs = std::filesystem;
  const fs::path relative(name);
  const bool climbs = std::any_of(relative.begin(), relative.end(), [](const fs::path& part) { return part == ".."; });
  if (relative.is_absolute() || climbs || name.find('\0') != std::string::npos) {
    return tl::unexpected(fmt::format("\"{}\" leads out of the pack", name));
  }
  std::error_code failed;
  const fs::path root = fs::canonical(folder, failed);
  if (failed) return tl::unexpected(fmt::format("the pack's folder cannot be read ({})", failed.message()));
  const fs::path file = fs::canonical(root / relative, failed);
  if (failed) return tl::unexpected(fmt::format("\"{}\" cannot be read ({})", name, failed.message()));
  if (std::mismatch(root.begin(), root.end(), file.begin(), file.end()).first != root.end()) {
    return tl::unexpected(fmt::format("\"{}\" is a link that leads out of the pack", name));
  }
  if (!fs::is_regular_file(file, failed)) return tl::unexpected(fmt::format("\"{}\" is not a file", name));
  return file;
}

}  // namespace rustle::pack
