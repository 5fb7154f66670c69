#include "sound_db/pack/cloth_write.h"

#include <algorithm>
#include <cmath>
#include <fstream>
#include <optional>

#include "sound_db/dsp/level.h"
#include "sound_db/pack/audio_file.h"
#include "sound_db/pack/manifest.h"
#include "sound_db/pack/npy.h"

namespace rustle::pack {

namespace {

namespace fs = std::filesystem;

constexpr double kStoredPeak_db = -1.0;

/// Nodes and weights side by side.
std::vector<double> warp_rows(const dsp::ThinPlateSpline& warp) {
  const auto dims = static_cast<std::size_t>(warp.dims);
  std::vector<double> rows;
  for (std::size_t k = 0; k < warp.node_count(); ++k) {
    const auto of = [&](const std::vector<double>& values) {
      const auto from = values.begin() + static_cast<std::ptrdiff_t>(k * dims);
      rows.insert(rows.end(), from, from + warp.dims);
    };
    of(warp.nodes);
    of(warp.weights);
  }
  return rows;
}

/// What pack.json holds of a corpus: names and numbers.
ClothCorpus described(const ClothCorpus& corpus) {
  ClothCorpus result;
  result.rate_hz = corpus.rate_hz;
  result.unit_s = corpus.unit_s;
  result.unit_samples = corpus.unit_samples;
  result.channels = corpus.channels;
  for (const SourceRecording& recording : corpus.recordings) result.recordings.push_back({recording.file, {}});
  result.selection = corpus.selection;
  const auto set = [](const UnitFeatureSet& from) {
    UnitFeatureSet to{from.file, {}, from.warp.node_count() ? from.warp_file : std::string(), from.warp};
    to.warp.nodes.clear();
    to.warp.weights.clear();
    return to;
  };
  result.causal = set(corpus.causal);
  result.symmetric = set(corpus.symmetric);
  result.gain_db = corpus.gain_db;
  result.friction = corpus.friction;
  result.friction.magnitudes.clear();
  result.wale_spacing_m = corpus.wale_spacing_m;
  if (!corpus.crumpling) return result;
  result.crumpling.emplace();
  for (const ClothCrumplingUnit& unit : corpus.crumpling->units) result.crumpling->units.push_back({unit.file, {}, 0});
  result.crumpling->event_amplitudes = corpus.crumpling->event_amplitudes;
  return result;
}

/// Writes files below a folder up to the first error.
class Writing {
 public:
  explicit Writing(const fs::path& folder) : folder_(folder) {}

  /// Calls `writer` with the file's path, its folder made.
  template <class Writer>
  void operator()(const std::string& name, const Writer& writer) {
    if (wrong_) return;
    const fs::path file = folder_ / name;
    std::error_code failed;
    fs::create_directories(file.parent_path(), failed);
    if (const auto done = writer(file); !done) {
      wrong_ = PackError{file.string(), "", done.error(), "choose a folder that can be written"};
    }
  }
  const std::optional<PackError>& wrong() const { return wrong_; }

 private:
  const fs::path& folder_;
  std::optional<PackError> wrong_;
};

void write_features(const ClothCorpus& corpus, Writing& write) {
  for (const UnitFeatureSet* set : {&corpus.causal, &corpus.symmetric}) {
    write(set->file,
          [&](const fs::path& file) { return write_npy_rows(file, std::span<const float>(set->values), corpus.dims()); });
    if (set->warp.node_count() == 0) continue;
    const std::vector<double> rows = warp_rows(set->warp);
    write(set->warp_file,
          [&](const fs::path& file) { return write_npy_rows(file, std::span<const double>(rows), 2 * corpus.dims()); });
  }
}

}  // namespace

tl::expected<ClothManifest, PackError> write_cloth(const ClothCorpus& corpus, const fs::path& folder) {
  Writing write(folder);
  ClothManifest manifest{described(corpus), 0, 0};
  for (const SourceRecording& recording : corpus.recordings) {
    write(recording.file,
          [&](const fs::path& file) { return write_multichannel(file, recording.channels, corpus.rate_hz); });
  }
  write_features(corpus, write);
  write(corpus.friction.file, [&](const fs::path& file) {
    return write_npy_rows(file, std::span<const float>(corpus.friction.magnitudes), corpus.friction.bins());
  });
  if (corpus.crumpling) {
    double peak = 0;
    for (const ClothCrumplingUnit& unit : corpus.crumpling->units) peak = std::max(peak, dsp::peak(unit.samples));
    // Whole tenths: the manifest is read by people.
    const double up_db = peak > 0 ? std::floor(10 * (kStoredPeak_db - dsp::gain_to_db(peak))) / 10 : 0.0;
    manifest.crumpling_gain_db = -up_db;
    const auto up = static_cast<float>(dsp::db_to_gain(up_db));
    for (const ClothCrumplingUnit& unit : corpus.crumpling->units) {
      std::vector<float> samples = unit.samples;
      for (float& x : samples) x *= up;
      write(unit.file, [&](const fs::path& file) { return write_clip(file, samples, corpus.rate_hz); });
    }
  }
  if (write.wrong()) return tl::unexpected(*write.wrong());
  return manifest;
}

tl::expected<void, PackError> write_calibration(const ClothCorpus& corpus, const fs::path& folder) {
  Findings findings;
  auto manifest = read_manifest(folder, findings);
  if (!manifest || !manifest->cloth) {
    return tl::unexpected(findings.empty() ? PackError{(folder / kManifestName).string(), "cloth", "is missing",
                                                       "only packs of cloth are calibrated"}
                                           : findings.front().what);
  }
  const ClothCorpus now = described(corpus);
  ClothCorpus& stored = manifest->cloth->corpus;
  stored.selection = now.selection;
  stored.causal = now.causal;
  stored.symmetric = now.symmetric;
  stored.friction.compression = now.friction.compression;
  if (stored.crumpling && now.crumpling) stored.crumpling->event_amplitudes = now.crumpling->event_amplitudes;
  Writing write(folder);
  write_features(corpus, write);
  const std::string text = manifest_text(*manifest);
  write(kManifestName, [&](const fs::path& file) -> tl::expected<void, std::string> {
    fs::path beside = file;
    beside += ".partial";
    std::ofstream stream(beside, std::ios::binary);
    stream << text;
    stream.close();
    std::error_code failed;
    if (stream) fs::rename(beside, file, failed);
    if (!stream || failed) return tl::unexpected(std::string("cannot be written (disk full, or no permission)"));
    return {};
  });
  if (write.wrong()) return tl::unexpected(*write.wrong());
  return {};
}

}  // namespace rustle::pack
