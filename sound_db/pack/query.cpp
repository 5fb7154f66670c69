#include "sound_db/pack/query.h"

#include <algorithm>
#include <limits>

namespace rustle::pack {

namespace {

double squared_distance(const GridPoint& a, const GridPoint& b) {
  const double rulings = a.ruling_length_m - b.ruling_length_m;
  const double edges = (a.free_border_length_m - b.free_border_length_m) / 2;
  return rulings * rulings + edges * edges;
}

/// Index of the first entry with the least distance; entries.size() when there is none of the wanted kind.
template <class Entries>
std::size_t nearest(const Entries& entries, const GridPoint& wanted) {
  std::size_t best = entries.size();
  double least = std::numeric_limits<double>::infinity();
  for (std::size_t i = 0; i < entries.size(); ++i) {
    const GridPoint& point = entries[i].point;
    if (point.constrained() != wanted.constrained()) continue;
    const double distance = wanted.constrained() ? 0.0 : squared_distance(point, wanted);
    if (distance < least) {
      least = distance;
      best = i;
    }
  }
  return best;
}

}  // namespace

const Spectrum* nearest_spectrum(const FrictionSection& section, const GridPoint& wanted) {
  const std::size_t best = nearest(section.spectra, wanted);
  return best < section.spectra.size() ? &section.spectra[best] : nullptr;
}

std::vector<std::uint32_t> nearest_variants(const CrumplingSection& section, const GridPoint& wanted) {
  std::vector<std::uint32_t> variants;
  const std::size_t best = nearest(section.units, wanted);
  for (std::size_t i = best; i < section.units.size(); ++i) {
    if (section.units[i].point == section.units[best].point) variants.push_back(static_cast<std::uint32_t>(i));
  }
  return variants;
}

std::uint32_t choose_variant(const std::vector<std::uint32_t>& variants, double uniform, std::uint32_t last) noexcept {
  if (variants.empty()) return kNoUnit;
  const auto repeated = std::find(variants.begin(), variants.end(), last);
  const std::size_t choices = variants.size() - (repeated != variants.end() && variants.size() > 1 ? 1 : 0);
  auto k = std::min(static_cast<std::size_t>(std::max(0.0, uniform) * static_cast<double>(choices)), choices - 1);
  if (choices < variants.size() && k >= static_cast<std::size_t>(repeated - variants.begin())) ++k;
  return variants[k];
}

}  // namespace rustle::pack
