#include "sound_db/build/build_manifest.h"

#include <algorithm>
#include <cctype>
#include <cmath>
#include <limits>
#include <set>

#include <fmt/format.h>
#include <fnmatch.h>
#include <toml++/toml.h>

#include "sound_db/build/table_reader.h"
#include "sound_db/dsp/unit_features.h"

namespace rustle::build {

namespace {

namespace fs = std::filesystem;

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

/// What goes with packs of cloth.
void refuse_paper(TableReader& reader, const Take& take) {
  const bool known = take.sound_class == SoundClass::kCloth || take.sound_class == SoundClass::kSlide ||
                     take.sound_class == SoundClass::kCrumple || take.sound_class == SoundClass::kTear;
  if (!known) {
    reader.error("class", fmt::format("is \"{}\", which packs of cloth do not hold", name(take.sound_class)),
                 "there are cloth, slide and crumple; take [cloth] out for a pack of paper");
  }
  for (const char* key : {"l_r", "l_c", "constrained", "lead_ms", "keep_levels"}) {
    if (reader.has(key)) reader.error(key, "is said of paper only", "take it out");
  }
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
  if (manifest.cloth) refuse_paper(reader, take);
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

ClothSettings read_cloth(TableReader& table) {
  ClothSettings cloth;
  cloth.units_per_s = table.number("units_per_s", cloth.units_per_s, 10, 1000);
  cloth.binaural = table.flag("binaural", false);
  pack::SelectionParameters& selection = cloth.selection;
  if (const auto widths = table.integers("widths", dsp::kUnitFeatures, 1, 10000)) selection.filter_widths = *widths;
  selection.lambda = table.number("lambda", selection.lambda, 0, 1e15);
  selection.look_ahead = table.integer("look_ahead", selection.look_ahead, 0, 240);
  selection.greatest_distance = table.number("d_max", selection.greatest_distance, 0, 1e6);
  selection.cool_off = table.integer("cool_off", selection.cool_off, 0, 100000);
  cloth.wale_spacing_m = table.number("wale_spacing", cloth.wale_spacing_m, 0, 1);
  cloth.patch_area_m2 = table.number("patch_area", cloth.patch_area_m2, 1e-6, 100);
  cloth.speed_threshold_m_per_s = table.number("speed_threshold", cloth.speed_threshold_m_per_s, 0, 100);
  cloth.slowest_m_per_s = table.number("slowest", cloth.slowest_m_per_s, 1e-4, 100);
  cloth.fastest_m_per_s = table.number("fastest", cloth.fastest_m_per_s, 1e-4, 100);
  cloth.speeds = table.integer("speeds", cloth.speeds, 2, 1000);
  cloth.tolerance = table.number("speed_tolerance", cloth.tolerance, 0.001, 0.5);
  cloth.pause_below_db = table.number("pause_db", cloth.pause_below_db, 20, 120);
  if (!(cloth.slowest_m_per_s < cloth.fastest_m_per_s)) table.error("fastest", "is not above slowest", "correct it");
  table.refuse_unknown();
  return cloth;
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
    pack.grammage_kg_per_m2 = about->number("grammage_kg_per_m2", pack.grammage_kg_per_m2, 1e-4, 100);
    pack.licence = about->text("licence", true);
    pack.origin = about->text("origin", true);
    pack.rate_hz = pack.stored_rate_hz = static_cast<std::uint32_t>(about->integer("rate_hz", 48000, 8000, 192000));
    manifest.highpass_hz = about->number("highpass_hz", manifest.highpass_hz, 0, 2000);
    about->refuse_unknown();
  } else if (!root.has("pack")) {
    root.error("pack", "is missing", "add a [pack] with material, touched_surface, licence and origin");
  }
  if (auto settings = root.table("cloth")) manifest.cloth = read_cloth(*settings);
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
