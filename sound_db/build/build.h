#pragma once

#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "sound_db/build/build_manifest.h"
#include "sound_db/pack/pack_error.h"
#include "sound_db/pack/sound_pack.h"

/// Sound packs from recordings (C10, P6).
namespace rustle::build {

/// Level that clacs of a session without flaps are brought to: the mean of their peaks at 1 m on the axis for an event of
/// the section's constrained_reference_amplitude_m.
inline constexpr double kReferenceClacPeak_dbfs = -30.0;
/// RMS at 0.1 m/s that flat slides of a session without bent ones are brought to: 11 dB below the bent reference sheet.
inline constexpr double kReferenceFlatFriction_dbfs = -43.0;

/// A part of a file and what became of it.
struct SegmentReport {
  double from_s = 0, to_s = 0;  ///< in the file
  double seconds = 0;           ///< of sound; less than to_s - from_s where parts of slides were left out
  double level_dbfs = 0;        ///< peak of a unit, RMS of a slide, as in the file with its gain
  std::string kept_as;          ///< the pack's file; empty: left out
  std::string reason;           ///< why it was left out; empty: kept
};

/// What was found in one file.
struct SourceReport {
  std::string file;
  SoundClass sound_class = SoundClass::kFlap;
  pack::GridPoint point;
  std::uint32_t rate_hz = 0;
  int channels = 0;
  double duration_s = 0;
  double threshold_dbfs = 0;  ///< RMS that counted as sound
  std::vector<SegmentReport> segments;
};

/// What a session's recordings were changed by to meet the reference levels.
struct SessionReport {
  std::string session;
  bool friction = false;  ///< else crumpling
  double gain_db = 0;
};

struct BuildReport {
  std::vector<SourceReport> sources;
  std::vector<SessionReport> sessions;
  std::vector<std::string> missing;  ///< what the pack lacks, and what will sound instead
  int units = 0, spectra = 0;
  int left_out = 0;  ///< segments
};

struct BuiltPack {
  pack::SoundPack pack;
  BuildReport report;
};

/// Called with the part done in [0, 1].
using Progress = std::function<void(double)>;

/// Makes a pack of the recordings that a manifest names below `folder`, of cloth where it says so (cloth_build.h), else of
/// paper:
///   crumpling  find_units, without those 20 dB (made equally loud: 30 dB) below the loudest of their session, brought to
///   the section's recording geometry (emission_gain); clacs found in crumpling made
///              equally loud; the units_per_point of each grid point that stand most out of the noise
///   friction   average_friction over all slides of a grid point, brought to the geometry (reference_transfer)
/// and each session brought to the reference events (pack/levels.h), then the pack as a whole. A section without any sound
/// is left out. Errors go to `findings`: a file that cannot be read, a slide whose speed track cannot, no sound at all.
/// The same files give the same bits. Control side; reads one file at a time.
std::optional<BuiltPack> build_pack(const BuildManifest& manifest, const std::filesystem::path& folder,
                                    pack::Findings& findings, const Progress& progress = {});

}  // namespace rustle::build
