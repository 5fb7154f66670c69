#include "sound_db/pack/cloth_corpus.h"

#include <algorithm>
#include <cmath>

#include "sound_db/dsp/unit_features.h"

namespace rustle::pack {

std::optional<std::size_t> crumpling_unit_for(const ClothCrumpling& crumpling, double event_amplitude_m) noexcept {
  const auto& units = crumpling.units;
  if (units.empty() || !(event_amplitude_m > 0)) return std::nullopt;
  if (crumpling.event_amplitudes.counts.empty()) return units.size() / 2;
  if (event_amplitude_m < crumpling.event_amplitudes.least) return std::nullopt;
  const double wanted = std::log(matched_energy(crumpling.event_amplitudes, crumpling.unit_energies, event_amplitude_m));
  const auto louder = std::lower_bound(units.begin(), units.end(), wanted,
                                       [](const ClothCrumplingUnit& unit, double e) { return std::log(unit.energy_s) < e; });
  auto nearest = static_cast<std::size_t>(louder - units.begin());
  if (nearest == units.size()) --nearest;
  const auto gap = [&](std::size_t k) { return std::abs(std::log(units[k].energy_s) - wanted); };
  while (nearest > 0 && gap(nearest - 1) <= gap(nearest)) --nearest;
  return nearest;
}

std::size_t ClothCorpus::dims() const noexcept {
  return static_cast<std::size_t>(channels) * dsp::kUnitFeatures;
}

std::size_t ClothCorpus::recording_of(std::size_t unit) const noexcept {
  return static_cast<std::size_t>(std::upper_bound(first_unit.begin(), first_unit.end(), unit) - first_unit.begin()) - 1;
}

void count_units(ClothCorpus& corpus) {
  corpus.unit_samples = dsp::unit_length(corpus.unit_s, corpus.rate_hz);
  const auto length = static_cast<std::size_t>(corpus.unit_samples);
  corpus.first_unit = {0};
  for (const SourceRecording& recording : corpus.recordings) {
    corpus.first_unit.push_back(corpus.first_unit.back() + static_cast<std::uint32_t>(recording.samples() / length));
  }
}

void measure_units(ClothCorpus& corpus) {
  count_units(corpus);
  const std::size_t dims = corpus.dims();
  std::vector<float> raw(corpus.units() * dims);
  for (std::size_t r = 0; r < corpus.recordings.size(); ++r) {
    for (std::size_t c = 0; c < corpus.recordings[r].channels.size(); ++c) {
      const auto& samples = corpus.recordings[r].channels[c];
      const std::vector<float> features = dsp::unit_features(samples, corpus.unit_samples, corpus.rate_hz);
      for (std::size_t i = 0; i < features.size(); ++i) {
        const std::size_t row = corpus.first_unit[r] + i / dsp::kUnitFeatures;
        raw[row * dims + c * dsp::kUnitFeatures + i % dsp::kUnitFeatures] = features[i];
      }
    }
  }
  const auto& widths = corpus.selection.filter_widths;
  const auto columns = static_cast<int>(dims);
  corpus.causal.values = dsp::filtered_features(raw, columns, widths, corpus.first_unit, true);
  corpus.symmetric.values = dsp::filtered_features(raw, columns, widths, corpus.first_unit, false);
}

}  // namespace rustle::pack
