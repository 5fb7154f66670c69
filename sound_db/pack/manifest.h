#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include <tl/expected.hpp>

#include "sound_db/pack/cloth_manifest.h"
#include "sound_db/pack/pack_error.h"
#include "sound_db/pack/sound_pack.h"

/// pack.json, the table of contents of a pack:
///
///   {"format": "rustle-pack", "format_version": 1,
///    "name", "version", "material", "touched_surface", "grammage_kg_per_m2", "licence", "origin", "rate_hz",
///    "crumpling": {"version": 1, "geometry": {"distance_m", "elevation_deg", "plane", "compression"}, "gain_db",
///                  "reference_compression", "constrained_reference_amplitude_m",
///                  "units": [{"l_r_m", "l_c_m", "radius_m", "file"}]},
///    "friction": {"version": 1, "geometry", "gain_db", "reference_speed_m_per_s", "speed_exponent", "fft_size",
///                 "gain_sigma", "gain_cutoff_hz", "spectra": [{"l_r_m", "l_c_m", "radius_m", "file", "row"}]},
///    "cloth": {"version": 1, ...: cloth_manifest.h}}
///
/// grammage_kg_per_m2, the sheet's mass per area, may be left out: 0.080, printer paper's. Tears grow louder with it.
/// gain_db is added to a section's sounds when they are loaded. radius_m may be left out: √(l_r (l_c/2) / π). A `row` names
/// a line of a two-dimensional array. Other sections, and sections of a later version, are left alone with a notice.
namespace rustle::pack {

inline constexpr int kFormatVersion = 1;
inline constexpr const char* kManifestName = "pack.json";

struct Manifest {
  SoundPack pack;  ///< without samples and magnitudes; rate_hz == stored_rate_hz
  double crumpling_gain_db = 0;
  double friction_gain_db = 0;
  std::vector<std::int64_t> rows;  ///< of each spectrum in its file; -1: the file is one spectrum
  std::optional<ClothManifest> cloth;
};

/// Reads folder/pack.json. Everything wrong goes to `findings`; nothing is returned when one of them is an error.
std::optional<Manifest> read_manifest(const std::filesystem::path& folder, Findings& findings);

/// The text of pack.json for a manifest; ends with a newline.
std::string manifest_text(const Manifest& manifest);

/// Every file that the manifest names, as it names them.
std::vector<std::string> named_files(const Manifest& manifest);

/// The file a manifest entry names, inside the folder, or what is wrong with the name: absolute, leading out of the pack,
/// missing, not a file.
[[nodiscard]] tl::expected<std::filesystem::path, std::string> resolve(const std::filesystem::path& folder,
                                                                       const std::string& name);

}  // namespace rustle::pack
