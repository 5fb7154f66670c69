#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include <tl/expected.hpp>

#include "sound_db/build/sound_class.h"
#include "sound_db/dsp/features.h"
#include "sound_db/pack/pack_error.h"
#include "sound_db/pack/sound_pack.h"

/// A pack's sounds beside recordings, class by class. Control side; pure but for the reading of recordings.
namespace rustle::build {

/// One sound of a class: a recording or part of one, or one that a pack makes.
struct ClassifiedSound {
  SoundClass sound_class = SoundClass::kFlap;
  std::string name;            ///< "kenney/bookFlip1.ogg", "tear.mp3 0.08-0.42 s", "flap l_r 10 cm, l_c 20 cm (1)"
  std::vector<float> samples;  ///< mono
};

struct ReferenceRecordings {
  std::vector<ClassifiedSound> sounds;  ///< at the rate asked for
  std::vector<std::string> notices;     ///< files whose class was guessed or not found, or that cannot be read
};

/// The recordings below a folder, at a rate: those that `manifest` (or its own, build_manifest.h, kBuildManifestName) names,
/// with their classes and times, or, where there is none, all WAV, FLAC, OGG and MP3 files, classed by guessed_class() with
/// a notice. Error: the folder cannot be read, its manifest is wrong, or nothing in it has a class.
[[nodiscard]] tl::expected<ReferenceRecordings, pack::PackError> read_reference_recordings(
    const std::filesystem::path& folder, double rate_hz = 48000, const std::filesystem::path& manifest = {});

/// What a pack sounds like, class by class, at its rate: every flap and clac as it stands, each friction spectrum as a push
/// by hand of one second, up to the reference speed (sine-window overlap-add of random phases, the slow gain, P8), and six
/// crumplings, clacs of power-law energy with a few small flaps in clustered waiting times. The same pack and seed give the
/// same bits.
std::vector<ClassifiedSound> pack_sounds(const pack::SoundPack& pack, std::uint64_t seed = 1);

/// [least, median, most] of what was measured; all 0 when count is 0.
struct FeatureRange {
  int count = 0;
  double least = 0, median = 0, most = 0;
};

/// One feature of one class. A range of fewer than kFewRecordings recordings is told but decides nothing: `inside` then says
/// whether the median lies within a factor of two of the range.
struct FeatureRow {
  std::string feature;  ///< "centroid_hz", "bandwidth_hz", "decay_s", "kurtosis"
  FeatureRange ours, real;
  double share_inside = 0;  ///< of our sounds that lie within the real range
  bool inside = false;      ///< our median lies within the real range
};
inline constexpr int kFewRecordings = 3;

/// The recording nearest to one of our sounds.
struct NearestReal {
  std::size_t ours = 0;  ///< index into the sounds that were compared
  std::size_t real = 0;
  double mfcc_distance = 0;
};

/// Distances are Euclidean over coefficients 1 to 12 of the mean MFCC (dsp/mfcc.h): level does not count.
struct ClassComparison {
  SoundClass sound_class = SoundClass::kFlap;
  /// Where no clac was recorded, clacs are held against the loudest moments of crumplings, 30 ms each.
  SoundClass compared_with = SoundClass::kFlap;
  int ours = 0, real = 0;  ///< how many sounds
  std::vector<FeatureRow> features;
  double mfcc_distance = 0;          ///< median distance of ours to the nearest recording
  double real_mfcc_distance = 0;     ///< median distance of a recording to the nearest other one; 0: there is one only
  double mean_mfcc_distance = 0;     ///< between the means of the two groups
  std::vector<NearestReal> nearest;  ///< one per sound of ours, in their order
};

struct Comparison {
  std::vector<ClassComparison> classes;  ///< that both sides have, in the order of kSoundClasses
  std::vector<std::string> notices;      ///< classes that only one side has; ranges of few recordings
};

/// Called with the part done in [0, 1].
using Progress = std::function<void(double)>;

/// Our sounds beside real ones of the same rate. Silent sounds are left out with a notice.
Comparison compare(const std::vector<ClassifiedSound>& ours, const std::vector<ClassifiedSound>& real, double rate_hz,
                   const Progress& progress = {});

/// compare(pack_sounds(pack), real).
Comparison compare(const pack::SoundPack& pack, const std::vector<ClassifiedSound>& real, const Progress& progress = {});

/// Two sounds to draw side by side (report::draw_spectrogram), indices into the sounds that were compared. Samples times
/// gain have the same RMS over their loudest 100 ms, -20 dBFS, so that one colour scale serves both.
struct SoundPair {
  SoundClass sound_class = SoundClass::kFlap;
  std::size_t ours = 0, real = 0;
  double our_gain = 1, real_gain = 1;
  double mfcc_distance = 0;
};

/// At most `most` pairs of each class: our sounds at evenly spread ranks of distance to the nearest recording, from the best
/// match to the worst, each with that recording.
std::vector<SoundPair> pairs_to_show(const Comparison& comparison, const std::vector<ClassifiedSound>& ours,
                                     const std::vector<ClassifiedSound>& real, double rate_hz, int most = 2);

}  // namespace rustle::build
