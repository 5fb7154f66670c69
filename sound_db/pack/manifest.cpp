#include "sound_db/pack/manifest.h"

#include <algorithm>
#include <cmath>
#include <fstream>
#include <set>
#include <sstream>
#include <tuple>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

namespace rustle::pack {

namespace {

using Json = nlohmann::ordered_json;

constexpr std::uintmax_t kMostManifestBytes = 16u << 20;
constexpr std::size_t kMostEntries = 10000;

/// A JSON object and its place in the file. Each reading checks type and range, and notes what was asked for.
class Reader {
 public:
  Reader(const Json& object, std::string place, std::string file, Findings& findings)
      : object_(object), place_(std::move(place)), file_(std::move(file)), findings_(findings) {}

  void error(const std::string& key, std::string message, std::string remedy) {
    findings_.push_back({Severity::kError, {file_, field(key), std::move(message), std::move(remedy)}});
  }
  void warning(const std::string& key, std::string message, std::string remedy) {
    findings_.push_back({Severity::kWarning, {file_, field(key), std::move(message), std::move(remedy)}});
  }

  double number(const std::string& key, std::optional<double> fallback, double low, double high) {
    const Json* value = find(key, !fallback, "a number");
    if (!value) return fallback.value_or(low);
    const double x = value->is_number() ? value->get<double>() : std::nan("");
    if (x >= low && x <= high) return x;
    error(key, fmt::format("is {}, expected a number from {} to {}", short_text(*value), low, high), "correct it");
    return fallback.value_or(low);
  }

  std::int64_t integer(const std::string& key, std::optional<std::int64_t> fallback, std::int64_t low, std::int64_t high) {
    const Json* value = find(key, !fallback, "a whole number");
    if (!value) return fallback.value_or(low);
    const double x = value->is_number_integer() ? value->get<double>() : std::nan("");
    if (x >= static_cast<double>(low) && x <= static_cast<double>(high)) return value->get<std::int64_t>();
    error(key, fmt::format("is {}, expected a whole number from {} to {}", short_text(*value), low, high), "correct it");
    return fallback.value_or(low);
  }

  std::string text(const std::string& key, bool required) {
    const Json* value = find(key, required, "a text");
    if (!value) return {};
    if (value->is_string() && (!required || !value->get_ref<const std::string&>().empty())) return value->get<std::string>();
    error(key, fmt::format("is {}, expected a text", short_text(*value)), "put it in quotes");
    return {};
  }

  bool flag(const std::string& key, bool fallback) {
    const Json* value = find(key, false, "");
    if (!value) return fallback;
    if (value->is_boolean()) return value->get<bool>();
    error(key, fmt::format("is {}, expected true or false", short_text(*value)), "correct it");
    return fallback;
  }

  std::optional<Reader> object(const std::string& key, bool required) {
    const Json* value = find(key, required, "an object");
    if (!value) return std::nullopt;
    if (value->is_object()) return Reader(*value, field(key), file_, findings_);
    error(key, fmt::format("is {}, expected an object", short_text(*value)), "put it in braces");
    return std::nullopt;
  }

  std::vector<Reader> objects(const std::string& key) {
    const Json* value = find(key, true, "a list");
    std::vector<Reader> result;
    if (!value) return result;
    if (!value->is_array() || value->size() > kMostEntries) {
      error(key, fmt::format("is {}, expected a list of at most {} objects", short_text(*value), kMostEntries),
            "correct it");
      return result;
    }
    for (std::size_t i = 0; i < value->size(); ++i) {
      const std::string name = fmt::format("{}[{}]", key, i);
      if ((*value)[i].is_object()) {
        result.emplace_back((*value)[i], field(name), file_, findings_);
      } else {
        error(name, fmt::format("is {}, expected an object", short_text((*value)[i])), "put it in braces");
      }
    }
    return result;
  }

  /// Keys that nothing asked for.
  std::vector<std::string> unknown() const {
    std::vector<std::string> keys;
    for (const auto& [key, value] : object_.items()) {
      if (!asked_.contains(key)) keys.push_back(key);
    }
    return keys;
  }
  void warn_unknown() {
    for (const std::string& key : unknown()) warning(key, "is not known and is left alone", "check its spelling");
  }

  std::string field(const std::string& key) const {
    return place_.empty() ? key : key.empty() ? place_ : place_ + "." + key;
  }

 private:
  const Json* find(const std::string& key, bool required, const char* what) {
    asked_.insert(key);
    const auto at = object_.find(key);
    if (at != object_.end()) return &*at;
    if (required) error(key, "is missing", fmt::format("add it: {}", what));
    return nullptr;
  }

  static std::string short_text(const Json& value) {
    const std::string text = value.dump(-1, ' ', true, Json::error_handler_t::replace);
    return text.size() <= 40 ? text : text.substr(0, 37) + "...";
  }

  const Json& object_;
  std::string place_;
  std::string file_;
  Findings& findings_;
  std::set<std::string> asked_;
};

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
  return root.dump(1, ' ', true, Json::error_handler_t::replace) + "\n";
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
