#include "sound_db/pack/cloth_check.h"

#include <algorithm>
#include <cmath>
#include <set>

#include <fmt/format.h>

#include "sound_db/dsp/filter.h"
#include "sound_db/dsp/level.h"
#include "sound_db/dsp/unit_features.h"
#include "sound_db/pack/manifest.h"
#include "sound_db/pack/warnings.h"

namespace rustle::pack {

namespace {

constexpr double kSameFeature = 0.02;  ///< rounding of 16-bit files is far below
constexpr double kLongPause_s = 1.0;
constexpr double kPause_db = -80.0;  ///< RMS in a unit
constexpr double kRumble_hz = 60.0;
constexpr double kFewestCorpus_s = 20.0;
constexpr std::size_t kFewestPops = 20;

double longest_pause_s(const std::vector<float>& samples, const ClothCorpus& corpus) {
  const auto length = static_cast<std::size_t>(corpus.unit_samples);
  std::size_t run = 0, longest = 0;
  for (std::size_t at = 0; at + length <= samples.size(); at += length) {
    run = dsp::rms_dbfs(std::span(samples).subspan(at, length)) < kPause_db ? run + 1 : 0;
    longest = std::max(longest, run);
  }
  return static_cast<double>(longest * length) / corpus.rate_hz;
}

void check_recording(const SourceRecording& recording, const ClothCorpus& corpus, Warnings& warn) {
  for (const std::vector<float>& channel : recording.channels) {
    if (dsp::peak(channel) >= 0.9999) {
      warn(recording.file, "", "reaches full scale: it may be clipped", "record it lower");
    }
    if (const double pause = longest_pause_s(channel, corpus); pause > kLongPause_s) {
      warn(recording.file, "", fmt::format("has a pause of {:.1f} s", pause),
           "cut the recording there into two files; units never go across");
    }
    std::vector<float> low = channel;
    dsp::CascadeState state;
    dsp::filter(dsp::butterworth_lowpass(4, kRumble_hz, corpus.rate_hz), state, low);
    if (dsp::rms_dbfs(low) > dsp::rms_dbfs(channel) - 10) {
      warn(recording.file, "", fmt::format("has most of its sound below {} Hz", kRumble_hz),
           "filter it with a high-pass at 100 Hz");
    }
  }
}

void check_features(const ClothCorpus& corpus, Warnings& warn) {
  ClothCorpus measured = corpus;
  measure_units(measured);
  const auto compare = [&](const UnitFeatureSet& stored, const UnitFeatureSet& now) {
    std::size_t differ = 0;
    const std::size_t count = std::min(stored.values.size(), now.values.size());
    for (std::size_t i = 0; i < count; ++i) differ += std::abs(stored.values[i] - now.values[i]) > kSameFeature;
    if (differ == 0) return;
    warn(stored.file, "cloth.features",
         fmt::format("{} of {} values are not those of the recordings: they were replaced", differ, count),
         "`rustle pack calibrate FOLDER` measures them anew");
  };
  compare(corpus.causal, measured.causal);
  compare(corpus.symmetric, measured.symmetric);
}

void check_sweep(const FrictionSweep& sweep, Warnings& warn) {
  if (sweep.speeds_m_per_s.size() == 1) {
    warn(sweep.file, "cloth.friction", "has one speed: the sound does not change with it", "measure several");
  }
  for (std::size_t i = 1; i < sweep.rms.size(); ++i) {
    if (sweep.rms[i] >= sweep.rms[i - 1] * 0.7) continue;
    warn(sweep.file, "cloth.friction",
         fmt::format("is quieter at {:g} m/s than at {:g}", sweep.speeds_m_per_s[i], sweep.speeds_m_per_s[i - 1]),
         "check the speed track, and that the cloth kept touching");
  }
}

void check_pops(const ClothCrumpling& crumpling, Warnings& warn) {
  if (crumpling.units.empty()) {
    warn(kManifestName, "cloth.crumpling.units", "are none: crumpling is silent", "add units, or take crumpling out");
    return;
  }
  if (crumpling.units.size() < kFewestPops) {
    warn(kManifestName, "cloth.crumpling.units",
         fmt::format("are {}: repetition will be heard, and few energies can be met", crumpling.units.size()),
         fmt::format("add up to {} or more", kFewestPops));
  }
  const EnergyHistogram& energies = crumpling.unit_energies;
  if (energies.most < 10 * energies.least) {
    warn(kManifestName, "cloth.crumpling.units", "are about equally loud: small and large events sound alike",
         "record softer and harder crumpling; energies span four decades");
  }
  if (crumpling.event_amplitudes.counts.empty()) {
    warn(kManifestName, "cloth.crumpling.events", "is missing: every event takes a middle unit",
         "`rustle pack calibrate` with the events of a calibration animation");
  }
}

}  // namespace

void check_cloth(const ClothCorpus& corpus, const ClothManifest& manifest, const std::filesystem::path& folder,
                 Findings& findings) {
  Warnings warn(folder, findings);
  std::set<std::string> files;
  for (const std::string& file : named_files(manifest)) {
    if (!files.insert(file).second) warn(file, "cloth", "is named twice", "take one entry out");
  }
  for (const SourceRecording& recording : corpus.recordings) check_recording(recording, corpus, warn);
  const double seconds = static_cast<double>(corpus.units()) * corpus.unit_s;
  if (seconds < kFewestCorpus_s) {
    warn(kManifestName, "cloth.recordings", fmt::format("last {:.0f} s: repetition will be heard", seconds),
         "a minute or more of varied motion is usual");
  }
  check_features(corpus, warn);
  if (corpus.causal.warp.identity() || corpus.symmetric.warp.identity()) {
    warn(kManifestName, "cloth.warp", "is missing: targets are looked for as they are", "`rustle pack calibrate` fits one");
  }
  check_sweep(corpus.friction, warn);
  if (corpus.crumpling) check_pops(*corpus.crumpling, warn);
}

}  // namespace rustle::pack
