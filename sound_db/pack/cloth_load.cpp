#include "sound_db/pack/cloth_load.h"

#include <algorithm>
#include <cmath>
#include <mutex>
#include <utility>

#include <fmt/format.h>

#include "sound_db/dsp/level.h"
#include "sound_db/dsp/resample.h"
#include "sound_db/dsp/unit_features.h"
#include "sound_db/pack/audio_file.h"
#include "sound_db/pack/each_index.h"
#include "sound_db/pack/manifest.h"
#include "sound_db/pack/npy.h"
#include "sound_db/pack/spectra.h"

namespace rustle::pack {

namespace {

constexpr const char* kExportAgain = "export it again as WAV or FLAC";
constexpr const char* kMeasureAgain = "`rustle pack calibrate FOLDER` measures the recordings anew";
constexpr double kMostSamples = 1u << 28;

/// What one loading knows: where files are, and where findings go.
class Loading {
 public:
  Loading(const std::filesystem::path& folder, std::uint32_t stored_rate_hz, std::uint32_t rate_hz, Findings& findings)
      : folder_(folder), stored_rate_hz_(stored_rate_hz), rate_hz_(rate_hz), findings_(findings) {}

  std::uint32_t stored_rate_hz() const { return stored_rate_hz_; }
  std::uint32_t rate_hz() const { return rate_hz_; }

  void error(const std::string& file, const std::string& field, std::string message, std::string remedy) const {
    findings_.push_back({Severity::kError, {file, field, std::move(message), std::move(remedy)}});
  }
  void warning(const std::string& file, const std::string& field, std::string message, std::string remedy) const {
    findings_.push_back({Severity::kWarning, {file, field, std::move(message), std::move(remedy)}});
  }

  /// The file's path, or nothing and an error.
  std::optional<std::filesystem::path> find(const std::string& name, const std::string& field) const {
    auto file = resolve(folder_, name);
    if (file) return std::move(*file);
    error((folder_ / kManifestName).string(), field, file.error(), "name a file inside the pack's folder");
    return std::nullopt;
  }

 private:
  const std::filesystem::path& folder_;
  std::uint32_t stored_rate_hz_;
  std::uint32_t rate_hz_;
  Findings& findings_;
};

void warn_of_rate(const Loading& loading, const std::string& file, const std::string& field, std::uint32_t found_hz) {
  if (found_hz == loading.stored_rate_hz()) return;
  loading.warning(file, field, fmt::format("has {} Hz, the pack says {}", found_hz, loading.stored_rate_hz()),
                  "it is resampled; correct rate_hz or the file");
}

/// Whether any file had another rate than the pack, so that stored features do not fit.
bool load_recordings(const Loading& loading, ClothCorpus& corpus) {
  std::mutex reporting;
  bool resampled = false;
  double total = 0;
  for_each_index(corpus.recordings.size(), [&](std::size_t r) {
    SourceRecording& recording = corpus.recordings[r];
    const std::string field = fmt::format("cloth.recordings[{}].file", r);
    std::unique_lock lock(reporting);
    const auto file = loading.find(recording.file, field);
    if (!file) return;
    lock.unlock();
    auto clip = read_multichannel(*file);
    if (clip) {
      for (auto& channel : clip->channels) channel = dsp::resample(channel, clip->rate_hz, loading.rate_hz());
    }
    lock.lock();
    if (!clip) return loading.error(file->string(), field, clip.error(), kExportAgain);
    if (clip->channels.size() != static_cast<std::size_t>(corpus.channels)) {
      return loading.error(file->string(), field,
                           fmt::format("has {} channels, cloth.channels says {}", clip->channels.size(), corpus.channels),
                           "export it with as many, or correct cloth.channels");
    }
    total += static_cast<double>(clip->channels.size()) * static_cast<double>(clip->channels.front().size());
    if (total > kMostSamples) {
      return loading.error(file->string(), field, "brings the pack above 1 GB of samples", "take fewer recordings");
    }
    warn_of_rate(loading, file->string(), field, clip->rate_hz);
    resampled |= clip->rate_hz != loading.stored_rate_hz();
    recording.channels = std::move(clip->channels);
    if (recording.samples() < static_cast<std::size_t>(corpus.unit_samples)) {
      loading.error(file->string(), field, "is shorter than a unit", "take it out, or take a longer recording");
    }
  });
  return resampled;
}

void load_features(const Loading& loading, UnitFeatureSet& set, const std::string& field, std::size_t units,
                   std::size_t dims) {
  const auto file = loading.find(set.file, field);
  if (!file) return;
  auto array = read_npy(*file);
  if (!array) return loading.error(file->string(), field, array.error(), kMeasureAgain);
  if (array->shape != std::vector<std::size_t>{units, dims}) {
    return loading.error(file->string(), field,
                         fmt::format("has shape ({}), the recordings have {} units of {} features",
                                     fmt::join(array->shape, ", "), units, dims),
                         kMeasureAgain);
  }
  set.values = std::move(array->values);
}

void load_warp(const Loading& loading, UnitFeatureSet& set, const std::string& field) {
  if (set.warp_file.empty()) return;
  const auto file = loading.find(set.warp_file, field);
  if (!file) return;
  const auto array = read_npy_double(*file);
  constexpr const char* kFitAgain = "`rustle pack calibrate FOLDER` fits the warp anew";
  if (!array) return loading.error(file->string(), field, array.error(), kFitAgain);
  const auto dims = static_cast<std::size_t>(set.warp.dims);
  if (array->shape.size() != 2 || array->shape[1] != 2 * dims) {
    return loading.error(
        file->string(), field,
        fmt::format("has shape ({}), expected rows of {}: a node and its weights", fmt::join(array->shape, ", "), 2 * dims),
        kFitAgain);
  }
  for (std::size_t i = 0; i < array->values.size(); ++i) {
    (i % (2 * dims) < dims ? set.warp.nodes : set.warp.weights).push_back(array->values[i]);
  }
}

void load_sweep(const Loading& loading, FrictionSweep& sweep, double gain_db) {
  const std::string field = "cloth.friction.file";
  const auto file = loading.find(sweep.file, field);
  if (!file) return;
  const auto array = read_npy(*file);
  if (!array) return loading.error(file->string(), field, array.error(), "save it again with numpy.save as float32");
  const std::size_t speeds = sweep.speeds_m_per_s.size(), bins = sweep.bins();
  if (array->shape != std::vector<std::size_t>{speeds, bins}) {
    return loading.error(
        file->string(), field,
        fmt::format("has shape ({}), expected {} speeds of {} bins", fmt::join(array->shape, ", "), speeds, bins),
        "a row for each of speeds_m_per_s; bins are fft_size / 2 + 1");
  }
  const auto gain = static_cast<float>(dsp::db_to_gain(gain_db));
  const int loaded_size = friction_clip_length(loading.rate_hz());
  for (std::size_t i = 0; i < speeds; ++i) {
    std::vector<float> row(array->values.begin() + static_cast<std::ptrdiff_t>(i * bins),
                           array->values.begin() + static_cast<std::ptrdiff_t>((i + 1) * bins));
    for (float& m : row) {
      m *= gain;
      if (!(m >= 0 && m <= 1e6F)) {
        return loading.error(file->string(), field, "has a magnitude below 0 or beyond all levels",
                             "magnitudes are amplitudes, not dB");
      }
    }
    const bool same = loading.rate_hz() == loading.stored_rate_hz() && loaded_size == static_cast<int>(sweep.fft_size);
    if (!same) row = resampled_spectrum(row, loading.stored_rate_hz(), loaded_size / 2 + 1, loading.rate_hz());
    sweep.rms.push_back(noise_rms(row));
    if (!(sweep.rms.back() > 0)) {
      return loading.error(file->string(), field, fmt::format("is silent at {:g} m/s", sweep.speeds_m_per_s[i]),
                           "measure it again, or take this speed out");
    }
    sweep.magnitudes.insert(sweep.magnitudes.end(), row.begin(), row.end());
  }
  sweep.fft_size = static_cast<std::uint32_t>(loaded_size);
}

void load_pops(const Loading& loading, ClothCrumpling& crumpling, double gain_db) {
  std::mutex reporting;
  const auto gain = static_cast<float>(dsp::db_to_gain(gain_db));
  for_each_index(crumpling.units.size(), [&](std::size_t i) {
    ClothCrumplingUnit& unit = crumpling.units[i];
    const std::string field = fmt::format("cloth.crumpling.units[{}].file", i);
    std::unique_lock lock(reporting);
    const auto file = loading.find(unit.file, field);
    if (!file) return;
    lock.unlock();
    auto clip = read_clip(*file);
    if (clip) {
      unit.samples = dsp::resample(clip->samples, clip->rate_hz, loading.rate_hz());
      for (float& x : unit.samples) {
        x *= gain;
        unit.energy_s += static_cast<double>(x) * x / loading.rate_hz();
      }
    }
    lock.lock();
    if (!clip) return loading.error(file->string(), field, clip.error(), "export it again as mono WAV or FLAC");
    warn_of_rate(loading, file->string(), field, clip->rate_hz);
    const double peak = dsp::peak(unit.samples);
    if (!std::isfinite(peak) || peak > 1e6) {
      loading.error(file->string(), field, "has samples beyond all levels", "lower it or cloth.crumpling.gain_db");
    } else if (!(unit.energy_s > 0)) {
      loading.error(file->string(), field, "is silent", "record it again or take it out");
    }
  });
  std::stable_sort(crumpling.units.begin(), crumpling.units.end(),
                   [](const auto& a, const auto& b) { return a.energy_s < b.energy_s; });
  std::vector<double> energies;
  for (const ClothCrumplingUnit& unit : crumpling.units) energies.push_back(unit.energy_s);
  crumpling.unit_energies = energy_histogram(energies);
}

}  // namespace

std::shared_ptr<const ClothCorpus> load_cloth(const std::filesystem::path& folder, ClothManifest manifest,
                                              const LoadOptions& options, Findings& findings) {
  const std::uint32_t rate_hz = options.rate_hz;
  auto corpus = std::make_shared<ClothCorpus>(std::move(manifest.corpus));
  const Loading loading(folder, corpus->rate_hz, rate_hz, findings);
  const bool stored_rate = corpus->rate_hz == rate_hz;
  const std::size_t findings_before = findings.size();
  corpus->rate_hz = rate_hz;
  corpus->unit_samples = dsp::unit_length(corpus->unit_s, rate_hz);
  const bool resampled = load_recordings(loading, *corpus);
  if (options.measure_units) {
    corpus->causal.warp = corpus->symmetric.warp = dsp::identity_warp(static_cast<int>(corpus->dims()));
  } else {
    load_warp(loading, corpus->causal, "cloth.warp.causal.file");
    load_warp(loading, corpus->symmetric, "cloth.warp.symmetric.file");
  }
  load_sweep(loading, corpus->friction, manifest.friction_gain_db);
  if (corpus->crumpling) load_pops(loading, *corpus->crumpling, manifest.crumpling_gain_db);
  const bool whole = std::none_of(findings.begin() + static_cast<std::ptrdiff_t>(findings_before), findings.end(),
                                  [](const Finding& f) { return f.severity == Severity::kError; });
  if (!whole) return corpus;
  if (!stored_rate || resampled || options.measure_units) {
    measure_units(*corpus);
    return corpus;
  }
  count_units(*corpus);
  load_features(loading, corpus->causal, "cloth.features.causal", corpus->units(), corpus->dims());
  load_features(loading, corpus->symmetric, "cloth.features.symmetric", corpus->units(), corpus->dims());
  return corpus;
}

}  // namespace rustle::pack
