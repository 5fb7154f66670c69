#include "sound_db/pack/load.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <map>
#include <tuple>

#include <fmt/format.h>

#include "sound_db/dsp/level.h"
#include "sound_db/dsp/resample.h"
#include "sound_db/pack/audio_file.h"
#include "sound_db/pack/cloth_load.h"
#include "sound_db/pack/each_index.h"
#include "sound_db/pack/manifest.h"
#include "sound_db/pack/npy.h"
#include "sound_db/pack/spectra.h"

namespace rustle::pack {

namespace {

constexpr std::uint64_t kMostSamples = 1u << 28;

bool before(const GridPoint& a, const GridPoint& b) {
  return std::tie(a.ruling_length_m, a.free_border_length_m) < std::tie(b.ruling_length_m, b.free_border_length_m);
}

void load_units(const std::filesystem::path& folder, CrumplingSection& section, double gain_db, std::uint32_t stored_rate_hz,
                std::uint32_t rate_hz, Findings& findings) {
  std::vector<Findings> per_unit(section.units.size());
  std::atomic<std::uint64_t> total{0};
  const auto gain = static_cast<float>(dsp::db_to_gain(gain_db));
  for_each_index(section.units.size(), [&](std::size_t i) {
    Unit& unit = section.units[i];
    const auto note = [&](Severity severity, const std::string& file, std::string message, std::string remedy) {
      const std::string field = fmt::format("crumpling.units[{}].file", i);
      per_unit[i].push_back({severity, {file, field, std::move(message), std::move(remedy)}});
    };
    const auto file = resolve(folder, unit.file);
    if (!file) {
      return note(Severity::kError, (folder / kManifestName).string(), file.error(), "name a file inside the pack's folder");
    }
    auto clip = read_clip(*file);
    if (!clip) return note(Severity::kError, file->string(), clip.error(), "export it again as mono WAV or FLAC");
    const double length = std::ceil(static_cast<double>(clip->samples.size()) * rate_hz / clip->rate_hz);
    if (total += static_cast<std::uint64_t>(length); total > kMostSamples) {
      return note(Severity::kError, file->string(), "brings the pack above 1 GB of samples", "take shorter or fewer units");
    }
    if (clip->rate_hz != stored_rate_hz) {
      note(Severity::kWarning, file->string(), fmt::format("has {} Hz, the pack says {}", clip->rate_hz, stored_rate_hz),
           "it is resampled; correct rate_hz or the file");
    }
    unit.samples = dsp::resample(clip->samples, clip->rate_hz, rate_hz);
    for (float& x : unit.samples) x *= gain;
    const float peak = static_cast<float>(dsp::peak(unit.samples));
    if (!std::isfinite(peak) || peak > 1e6f) {
      note(Severity::kError, file->string(), "has samples beyond all levels", "lower it or crumpling.gain_db");
    }
  });
  for (Findings& found : per_unit) findings.insert(findings.end(), found.begin(), found.end());
}

void load_spectra(const std::filesystem::path& folder, const Manifest& manifest, FrictionSection& section,
                  const LoadOptions& options, Findings& findings) {
  std::map<std::string, tl::expected<Array, std::string>> arrays;
  const std::size_t stored_bins = section.fft_size / 2 + 1;
  const std::uint32_t fft_size = options.fft_size ? options.fft_size : section.fft_size;
  const auto gain = static_cast<float>(dsp::db_to_gain(manifest.friction_gain_db));
  for (std::size_t i = 0; i < section.spectra.size(); ++i) {
    Spectrum& spectrum = section.spectra[i];
    const auto error = [&](const std::string& file, std::string message, std::string remedy) {
      const std::string field = fmt::format("friction.spectra[{}].file", i);
      findings.push_back({Severity::kError, {file, field, std::move(message), std::move(remedy)}});
    };
    const auto file = resolve(folder, spectrum.file);
    if (!file) {
      error((folder / kManifestName).string(), file.error(), "name a file inside the pack's folder");
      continue;
    }
    auto known = arrays.find(spectrum.file);
    if (known == arrays.end()) known = arrays.emplace(spectrum.file, read_npy(*file)).first;
    if (!known->second) {
      error(file->string(), known->second.error(), "save it again with numpy.save as float32");
      continue;
    }
    const Array& array = *known->second;
    const bool by_row = manifest.rows[i] >= 0;
    if (array.shape.back() != stored_bins || array.shape.size() != (by_row ? 2u : 1u)) {
      error(file->string(),
            fmt::format("has shape ({}), expected {}{} bins", fmt::join(array.shape, ", "), by_row ? "rows of " : "",
                        stored_bins),
            "bins are friction.fft_size / 2 + 1; give a row for a two-dimensional array");
      continue;
    }
    const auto row = static_cast<std::size_t>(std::max<std::int64_t>(0, manifest.rows[i]));
    if (by_row && row >= array.shape[0]) {
      error(file->string(), fmt::format("has {} rows, row {} is asked for", array.shape[0], row), "rows count from 0");
      continue;
    }
    std::vector<float> magnitudes(array.values.begin() + static_cast<std::ptrdiff_t>(row * stored_bins),
                                  array.values.begin() + static_cast<std::ptrdiff_t>((row + 1) * stored_bins));
    bool sane = true;
    for (float& m : magnitudes) {
      m *= gain;
      sane = sane && m >= 0 && m <= 1e6f;
    }
    if (!sane) {
      error(file->string(), "has a magnitude below 0 or beyond all levels", "magnitudes are amplitudes, not dB");
      continue;
    }
    const bool same = options.rate_hz == section.rate_hz && fft_size == section.fft_size;
    spectrum.magnitudes =
        same ? std::move(magnitudes)
             : resampled_spectrum(magnitudes, section.rate_hz, static_cast<int>(fft_size / 2 + 1), options.rate_hz);
  }
  section.rate_hz = options.rate_hz;
  section.fft_size = fft_size;
}

}  // namespace

std::shared_ptr<const SoundPack> load_with_findings(const std::filesystem::path& folder, const LoadOptions& options,
                                                    Findings& findings) {
  if (options.rate_hz < 8000 || options.rate_hz > 192000 || options.fft_size % 2 || options.fft_size > 65536) {
    findings.push_back(
        {Severity::kError,
         {folder.string(), "", fmt::format("cannot be loaded at {} Hz with FFT {}", options.rate_hz, options.fft_size),
          "8000 to 192000 Hz; an even FFT up to 65536"}});
    return nullptr;
  }
  const std::size_t before_loading = findings.size();
  std::optional<Manifest> manifest = read_manifest(folder, findings);
  if (!manifest) return nullptr;
  SoundPack& pack = manifest->pack;
  if (pack.crumpling) {
    load_units(folder, *pack.crumpling, manifest->crumpling_gain_db, pack.stored_rate_hz, options.rate_hz, findings);
    std::stable_sort(pack.crumpling->units.begin(), pack.crumpling->units.end(),
                     [](const Unit& a, const Unit& b) { return before(a.point, b.point); });
  }
  if (pack.friction) {
    load_spectra(folder, *manifest, *pack.friction, options, findings);
    std::stable_sort(pack.friction->spectra.begin(), pack.friction->spectra.end(),
                     [](const Spectrum& a, const Spectrum& b) { return before(a.point, b.point); });
  }
  if (manifest->cloth) pack.cloth = load_cloth(folder, std::move(*manifest->cloth), options, findings);
  pack.rate_hz = options.rate_hz;
  for (std::size_t i = before_loading; i < findings.size(); ++i) {
    if (findings[i].severity == Severity::kError) return nullptr;
  }
  return std::make_shared<const SoundPack>(std::move(pack));
}

tl::expected<std::shared_ptr<const SoundPack>, PackError> load(const std::filesystem::path& folder,
                                                               const LoadOptions& options) {
  Findings findings;
  if (auto pack = load_with_findings(folder, options, findings)) return pack;
  const auto first = std::find_if(findings.begin(), findings.end(),
                                  [](const Finding& finding) { return finding.severity == Severity::kError; });
  return tl::unexpected(first->what);
}

tl::expected<std::shared_ptr<const SoundPack>, PackError> load(const std::filesystem::path& folder, std::uint32_t rate_hz) {
  return load(folder, LoadOptions{rate_hz, 0});
}

}  // namespace rustle::pack
