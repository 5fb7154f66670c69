#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "sound_db/build/sound_class.h"
#include "sound_db/pack/cloth_corpus.h"
#include "sound_db/pack/pack_error.h"
#include "sound_db/pack/sound_pack.h"

/// recordings.toml: what a folder of recordings holds and what pack is to be made of it. example_manifest() explains every
/// field; lengths are in m, speeds in m/s, times in s.
namespace rustle::build {

inline constexpr const char* kBuildManifestName = "recordings.toml";

/// One `[[recording]]`: files that were recorded alike.
struct Take {
  std::string place;               ///< "recording[2] (line 40)", for messages
  std::vector<std::string> files;  ///< names or patterns (* and ? inside a folder, ** across folders), from the folder
  SoundClass sound_class = SoundClass::kFlap;
  /// Of the sheet; (0,0): constrained. Absent: told by each file's name, r100_c200 in mm.
  std::optional<pack::GridPoint> point;
  std::optional<double> speed_m_per_s;  ///< slides: constant
  std::string speed_track;              ///< slides: a CSV file of time,speed from the folder; empty: constant
  std::optional<double> from_s, to_s;   ///< of the file; absent: from its start, to its end
  int channel = 0;                      ///< counted from 1; 0: the mean of all
  double gain_db = 0;                   ///< added to what is in the file
  std::string session;                  ///< recordings of one session keep their levels relative to each other
  pack::RecordingGeometry geometry;
  bool whole = false;                  ///< crumpling: already cut, the file is one unit
  bool keep_levels = false;            ///< clacs found in crumpling: keep their levels instead of making them equally loud
  std::optional<double> threshold_db;  ///< below the loudest window; absent: chosen from the recording
  double window_s = 0.020;
  double lead_s = 0.050;  ///< flaps: at most so much rustle before the loudest sample
  bool measures_pack() const { return sound_class != SoundClass::kTear && sound_class != SoundClass::kCloth; }
};

/// `[cloth]`: a pack of cloth is to be made (cloth_build.h).
struct ClothSettings {
  double units_per_s = 240;
  bool binaural = false;  ///< two channels at once; else each is a source of its own
  pack::SelectionParameters selection;
  double wale_spacing_m = 0;
  double patch_area_m2 = 0.01;  ///< that slides were recorded with
  double speed_threshold_m_per_s = 0.02;
  double slowest_m_per_s = 0.05, fastest_m_per_s = 2;  ///< of the sweep's speeds
  int speeds = 14;
  double tolerance = 0.06;     ///< of a clip's speed, as a share
  double pause_below_db = 60;  ///< below the loudest 5 ms of a recording
};

struct BuildManifest {
  std::filesystem::path file;
  /// Name, material and the like, rates, geometry and reference values of both sections; no units and no spectra.
  pack::SoundPack pack;
  double highpass_hz = 100;  ///< 5th-order Butterworth against rumble and offset (An et al. 2012); 0: only the offset
  int units_per_point = 12;  ///< at most, those that stand out of the noise most
  std::vector<Take> takes;
  std::optional<ClothSettings> cloth;  ///< then takes are cloth, slides and crumpling
};

/// Reads a manifest. Everything wrong goes to `findings`, with its line; nothing is returned when one of them is an error.
std::optional<BuildManifest> read_build_manifest(const std::filesystem::path& file, pack::Findings& findings);

/// A file that a take names.
struct TakeFile {
  std::size_t take = 0;
  std::string file;  ///< from the folder, with /
};

/// The files of all takes, in the manifest's order and by name within a pattern. Errors (findings): a take that names
/// nothing, a way out of the folder, the same part of a file named twice.
std::vector<TakeFile> files_of(const BuildManifest& manifest, const std::filesystem::path& folder, pack::Findings& findings);

/// r100_c200 in a file's name: l_r 0.1 m, l_c 0.2 m; flat or r0_c0: (0,0).
std::optional<pack::GridPoint> point_in_name(const std::string& file);

/// A manifest with every field explained, to start from; reads as it stands.
std::string example_manifest();

}  // namespace rustle::build
