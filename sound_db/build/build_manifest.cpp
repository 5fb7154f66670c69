#include "sound_db/build/build_manifest.h"

#include <algorithm>
#include <cctype>
#include <cmath>
#include <limits>
#include <set>

#include <fmt/format.h>
#include <fnmatch.h>
#include <toml++/toml.h>

namespace rustle::build {

namespace {

namespace fs = std::filesystem;

/// A TOML table and its place in the file. Each reading checks type and range, and notes what was asked for.
class TableReader {
 public:
  TableReader(const toml::table& table, std::string place, std::string file, pack::Findings& findings)
      : table_(table), place_(std::move(place)), file_(std::move(file)), findings_(findings) {}

  void error(const std::string& key, std::string message, std::string remedy) {
    const toml::node* node = table_.get(key);
    const auto line = node ? node->source().begin.line : place_.empty() ? 0 : table_.source().begin.line;
    const std::string at = line > 0 ? fmt::format(" (line {})", line) : "";
    findings_.push_back({pack::Severity::kError, {file_, field(key) + at, std::move(message), std::move(remedy)}});
  }

  std::optional<double> number(const std::string& key, double low, double high) {
    const toml::node* node = find(key);
    if (!node) return std::nullopt;
    const auto value = node->value<double>();
    if (value && *value >= low && *value <= high) return value;
    error(key, fmt::format("is not a number from {} to {}", low, high), "correct it");
    return std::nullopt;
  }
  double number(const std::string& key, double fallback, double low, double high) {
    return number(key, low, high).value_or(fallback);
  }

  int integer(const std::string& key, int fallback, int low, int high) {
    const toml::node* node = find(key);
    if (!node) return fallback;
    const auto value = node->value_exact<std::int64_t>();
    if (value && *value >= low && *value <= high) return static_cast<int>(*value);
    error(key, fmt::format("is not a whole number from {} to {}", low, high), "correct it");
    return fallback;
  }

  std::string text(const std::string& key, bool required, std::string fallback = {}) {
    const toml::node* node = find(key);
    if (!node) {
      if (required) error(key, "is missing", "add it: a text in quotes");
      return fallback;
    }
    const auto value = node->value_exact<std::string>();
    if (value && !value->empty()) return *value;
    error(key, "is not a text", "put it in quotes");
    return fallback;
  }

  bool flag(const std::string& key, bool fallback) {
    const toml::node* node = find(key);
    if (!node) return fallback;
    if (const auto value = node->value_exact<bool>()) return *value;
    error(key, "is neither true nor false", "correct it");
    return fallback;
  }

  /// A text or a list of texts.
  std::vector<std::string> texts(const std::string& key) {
    const toml::node* node = find(key);
    std::vector<std::string> result;
    if (node && node->is_string()) result.push_back(*node->value<std::string>());
    if (node && node->is_array()) {
      for (const toml::node& item : *node->as_array()) {
        if (const auto value = item.value_exact<std::string>()) result.push_back(*value);
      }
      if (result.size() != node->as_array()->size()) result.clear();
    }
    if (result.empty()) error(key, node ? "is not a text or a list of texts" : "is missing", "name files in quotes");
    return result;
  }

  /// Two rising numbers.
  std::optional<std::pair<double, double>> span(const std::string& key) {
    const toml::node* node = find(key);
    if (!node) return std::nullopt;
    if (const toml::array* array = node->as_array(); array && array->size() == 2) {
      const auto from = (*array)[0].value<double>(), to = (*array)[1].value<double>();
      if (from && to && *from >= 0 && *from < *to) return std::pair(*from, *to);
    }
    error(key, "is not [from, to] in seconds with 0 <= from < to", "correct it, time = [0.5, 2.0] say");
    return std::nullopt;
  }

  std::optional<TableReader> table(const std::string& key) {
    const toml::node* node = find(key);
    if (!node) return std::nullopt;
    if (const toml::table* inner = node->as_table()) return TableReader(*inner, field(key), file_, findings_);
    error(key, "is not a table", fmt::format("write it as [{}]", field(key)));
    return std::nullopt;
  }

  std::vector<TableReader> tables(const std::string& key) {
    const toml::node* node = find(key);
    std::vector<TableReader> result;
    const toml::array* array = node ? node->as_array() : nullptr;
    if (array) {
      for (const toml::node& item : *array) {
        if (!item.is_table()) continue;
        const auto line = item.source().begin.line;
        result.emplace_back(*item.as_table(), fmt::format("{}[{}] (line {})", key, result.size(), line), file_, findings_);
      }
    }
    if (result.empty()) error(key, "is missing", fmt::format("add a [[{}]] for each kind of recording", key));
    return result;
  }

  bool has(const std::string& key) const { return table_.contains(key); }
  const std::string& place() const { return place_; }

  void refuse_unknown() {
    for (const auto& [key, node] : table_) {
      const std::string name(key.str());
      if (!asked_.contains(name)) {
        error(name, "is not known",
              "check its spelling; `rustle pack build --print-manifest` explains what a manifest may say");
      }
    }
  }

 private:
  const toml::node* find(const std::string& key) {
    asked_.insert(key);
    return table_.get(key);
  }
  std::string field(const std::string& key) const { return place_.empty() ? key : place_ + "." + key; }

  const toml::table& table_;
  std::string place_;
  std::string file_;
  pack::Findings& findings_;
  std::set<std::string> asked_;
};

pack::RecordingGeometry read_geometry(TableReader& parent, pack::RecordingGeometry geometry) {
  auto table = parent.table("geometry");
  if (!table) return geometry;
  geometry.distance_m = table->number("distance_m", geometry.distance_m, 0.01, 100);
  geometry.elevation_deg = table->number("elevation_deg", geometry.elevation_deg, 5, 90);
  geometry.plane = table->flag("plane", geometry.plane);
  geometry.compression = table->number("compression", geometry.compression, 0, 0.95);
  if (geometry.plane && geometry.compression <= 0)
    table->error("compression", "is 0, but bent sheets over a plane stand as high as it says", "add it, 0.3 say");
  table->refuse_unknown();
  return geometry;
}

void read_point(TableReader& reader, Take& take) {
  const bool lengths = reader.has("l_r") || reader.has("l_c"), constrained = reader.flag("constrained", false);
  const auto l_r = reader.number("l_r", 0.001, 10), l_c = reader.number("l_c", 0.001, 10);
  if (lengths && (!l_r || !l_c)) {
    if (!reader.has("l_r") || !reader.has("l_c"))
      reader.error("l_r", "and l_c must both be said", "l_c is twice the bent edge, in m");
    return;
  }
  const bool clac = take.sound_class == SoundClass::kClac || take.sound_class == SoundClass::kCrumple;
  if ((clac || constrained) && lengths) reader.error("l_r", "does not go with a constrained sound", "take l_r and l_c out");
  if (constrained && take.sound_class == SoundClass::kFlap)
    reader.error("constrained", "does not go with a flap", "call it a clac");
  if (clac || constrained) take.point = pack::GridPoint{};
  if (lengths) take.point = pack::GridPoint{*l_r, *l_c};
}

/// What only some classes may say.
void refuse_misplaced(TableReader& reader, const Take& take) {
  const bool slide = take.sound_class == SoundClass::kSlide;
  for (const char* key : {"speed", "speed_track"}) {
    if (!slide && reader.has(key)) reader.error(key, "is said of slides only", "take it out, or correct the class");
  }
  for (const char* key : {"whole", "keep_levels"}) {
    if (slide && reader.has(key)) reader.error(key, "is not said of slides", "take it out, or correct the class");
  }
  if (slide && !take.speed_m_per_s && take.speed_track.empty() && !reader.has("speed"))
    reader.error("speed", "is missing", "say how fast the sheet slides in m/s, or name a speed_track");
  if (slide && take.speed_m_per_s && !take.speed_track.empty())
    reader.error("speed", "and speed_track are both said", "take one out");
}

Take read_take(TableReader& reader, const BuildManifest& manifest) {
  Take take;
  take.place = reader.place();
  take.files = reader.texts("files");
  const std::string named = reader.text("class", true);
  const auto sound_class = sound_class_of(named);
  if (!sound_class && !named.empty()) {
    reader.error("class", fmt::format("is \"{}\"", named), "there are: flap, clac, crumple, slide, tear, cloth");
  }
  take.sound_class = sound_class.value_or(SoundClass::kFlap);
  read_point(reader, take);
  take.speed_m_per_s = reader.number("speed", 1e-4, 100);
  take.speed_track = reader.text("speed_track", false);
  if (const auto span = reader.span("time")) std::tie(take.from_s, take.to_s) = *span;
  take.channel = reader.integer("channel", 0, 0, 64);
  take.gain_db = reader.number("gain_db", 0, -120, 120);
  take.session = reader.text("session", false, "one");
  const bool slide = take.sound_class == SoundClass::kSlide;
  take.geometry = read_geometry(reader, slide ? manifest.pack.friction->geometry : manifest.pack.crumpling->geometry);
  take.whole = reader.flag("whole", false);
  take.keep_levels = reader.flag("keep_levels", take.sound_class != SoundClass::kCrumple);
  take.threshold_db = reader.number("threshold_db", -80, -1);
  take.window_s = reader.number("window_ms", 20, 1, 200) / 1000;
  take.lead_s = reader.number("lead_ms", 50, 0, 10000) / 1000;
  refuse_misplaced(reader, take);
  reader.refuse_unknown();
  return take;
}

void read_sections(TableReader& root, BuildManifest& manifest) {
  const pack::RecordingGeometry geometry = read_geometry(root, {});
  pack::CrumplingSection& crumpling = manifest.pack.crumpling.emplace();
  crumpling.geometry = geometry;
  crumpling.constrained_reference_amplitude_m = 0.004;
  if (auto table = root.table("crumpling")) {
    crumpling.geometry = read_geometry(*table, geometry);
    crumpling.reference_compression = table->number("compression", crumpling.reference_compression, 0.001, 0.95);
    crumpling.constrained_reference_amplitude_m =
        table->number("clac_amplitude_m", crumpling.constrained_reference_amplitude_m, 1e-6, 10);
    manifest.units_per_point = table->integer("units_per_point", manifest.units_per_point, 1, 1000);
    table->refuse_unknown();
  }
  pack::FrictionSection& friction = manifest.pack.friction.emplace();
  friction.geometry = geometry;
  friction.rate_hz = manifest.pack.rate_hz;
  if (auto table = root.table("friction")) {
    friction.geometry = read_geometry(*table, geometry);
    friction.reference_speed_m_per_s = table->number("reference_speed", friction.reference_speed_m_per_s, 1e-4, 100);
    friction.speed_exponent = table->number("speed_exponent", friction.speed_exponent, 0, 4);
    friction.fft_size = static_cast<std::uint32_t>(table->integer("fft_size", 1024, 64, 65536));
    if (friction.fft_size % 4) table->error("fft_size", "is not a multiple of 4", "1024 and 2048 are usual");
    friction.gain_sigma = table->number("gain_sigma", friction.gain_sigma, 0, 2);
    friction.gain_cutoff_hz = table->number("gain_cutoff_hz", friction.gain_cutoff_hz, 0.1, 20000);
    table->refuse_unknown();
  }
}

bool has_error(const pack::Findings& findings, std::size_t from) {
  return std::any_of(findings.begin() + static_cast<std::ptrdiff_t>(from), findings.end(),
                     [](const pack::Finding& f) { return f.severity == pack::Severity::kError; });
}

/// Files below the folder, from it, by name.
std::vector<std::string> listing(const fs::path& folder) {
  std::vector<std::string> files;
  std::error_code failed;
  for (fs::recursive_directory_iterator at(folder, failed), end; !failed && at != end; at.increment(failed)) {
    if (at->is_regular_file(failed)) files.push_back(at->path().lexically_relative(folder).generic_string());
  }
  std::sort(files.begin(), files.end());
  return files;
}

bool matches(const std::string& pattern, const std::string& file) {
  const auto deep = pattern.find("**");
  if (deep == std::string::npos) return fnmatch(pattern.c_str(), file.c_str(), FNM_PATHNAME) == 0;
  // "**" also stands for no folder at all.
  if (fnmatch(pattern.c_str(), file.c_str(), 0) == 0) return true;
  return pattern.compare(deep, 3, "**/") == 0 &&
         fnmatch((pattern.substr(0, deep) + pattern.substr(deep + 3)).c_str(), file.c_str(), 0) == 0;
}

}  // namespace

std::optional<BuildManifest> read_build_manifest(const fs::path& file, pack::Findings& findings) {
  constexpr std::uintmax_t kMostBytes = 16u << 20;
  const std::size_t before = findings.size();
  const auto fail = [&](std::string message, std::string remedy) {
    findings.push_back({pack::Severity::kError, {file.string(), "", std::move(message), std::move(remedy)}});
    return std::nullopt;
  };
  std::error_code failed;
  const auto length = fs::file_size(file, failed);
  if (failed || !fs::is_regular_file(file, failed)) {
    return fail("cannot be read", fmt::format("write one: `rustle pack build --print-manifest > {}`", kBuildManifestName));
  }
  if (length > kMostBytes) return fail(fmt::format("{} bytes is too large", length), "is it a build manifest?");
  toml::table table;
  try {
    table = toml::parse_file(file.string());
  } catch (const toml::parse_error& error) {
    return fail(fmt::format("line {}: {}", error.source().begin.line, error.description()),
                "mend it; `rustle pack build --print-manifest` shows how a manifest is written");
  }
  TableReader root(table, "", file.string(), findings);
  BuildManifest manifest;
  manifest.file = file;
  pack::SoundPack& pack = manifest.pack;
  if (auto about = root.table("pack")) {
    pack.material = about->text("material", true);
    pack.touched_surface = about->text("touched_surface", true);
    pack.name = about->text("name", false, pack.material + "-on-" + pack.touched_surface);
    pack.version = about->text("version", false, "1.0.0");
    pack.licence = about->text("licence", true);
    pack.origin = about->text("origin", true);
    pack.rate_hz = pack.stored_rate_hz = static_cast<std::uint32_t>(about->integer("rate_hz", 48000, 8000, 192000));
    manifest.highpass_hz = about->number("highpass_hz", manifest.highpass_hz, 0, 2000);
    about->refuse_unknown();
  } else if (!root.has("pack")) {
    root.error("pack", "is missing", "add a [pack] with material, touched_surface, licence and origin");
  }
  read_sections(root, manifest);
  for (TableReader& reader : root.tables("recording")) manifest.takes.push_back(read_take(reader, manifest));
  root.refuse_unknown();
  if (has_error(findings, before)) return std::nullopt;
  return manifest;
}

std::vector<TakeFile> files_of(const BuildManifest& manifest, const fs::path& folder, pack::Findings& findings) {
  const std::vector<std::string> present = listing(folder);
  std::vector<TakeFile> result;
  const auto error = [&](const std::string& place, std::string message, std::string remedy) {
    findings.push_back({pack::Severity::kError, {manifest.file.string(), place, std::move(message), std::move(remedy)}});
  };
  for (std::size_t t = 0; t < manifest.takes.size(); ++t) {
    const Take& take = manifest.takes[t];
    for (const std::string& pattern : take.files) {
      const std::size_t before = result.size();
      for (const std::string& file : present) {
        if (file != pattern && !matches(pattern, file)) continue;
        for (const TakeFile& earlier : result) {
          constexpr double kForever_s = std::numeric_limits<double>::infinity();
          const Take& other = manifest.takes[earlier.take];
          if (earlier.file == file && std::max(take.from_s.value_or(0), other.from_s.value_or(0)) <
                                          std::min(take.to_s.value_or(kForever_s), other.to_s.value_or(kForever_s))) {
            error(take.place, fmt::format("names {}, which {} has already", file, other.place),
                  "take it out of one of them, or bound both with time = [from, to]");
          }
        }
        result.push_back({t, file});
      }
      if (result.size() == before) {
        error(take.place, fmt::format("\"{}\" names no file below {}", pattern, folder.string()),
              "correct it; names are relative to the folder");
      }
    }
  }
  return result;
}

std::optional<pack::GridPoint> point_in_name(const std::string& file) {
  const std::string stem = fs::path(file).stem().string();
  for (std::size_t at = 0; at < stem.size(); ++at) {
    if (stem[at] != 'r' || (at > 0 && std::isalnum(static_cast<unsigned char>(stem[at - 1])))) continue;
    int ruling_mm = 0, border_mm = 0, used = 0;
    if (std::sscanf(stem.c_str() + at, "r%4d_c%4d%n", &ruling_mm, &border_mm, &used) != 2) continue;
    if (ruling_mm < 0 || border_mm < 0 || (ruling_mm > 0) != (border_mm > 0)) continue;
    return pack::GridPoint{ruling_mm / 1000.0, border_mm / 1000.0};
  }
  return stem == "flat" || stem.starts_with("flat_") ? std::optional(pack::GridPoint{}) : std::nullopt;
}

}  // namespace rustle::build
