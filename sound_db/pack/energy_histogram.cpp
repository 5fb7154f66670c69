#include "sound_db/pack/energy_histogram.h"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <numeric>

namespace rustle::pack {

namespace {

double total(const EnergyHistogram& histogram) noexcept {
  return std::accumulate(histogram.counts.begin(), histogram.counts.end(), 0.0);
}

/// Where an energy lies, in bins from the first one's lower edge.
double position(const EnergyHistogram& histogram, double energy) noexcept {
  const double share = std::log(energy / histogram.least) / std::log(histogram.most / histogram.least);
  return share * static_cast<double>(histogram.counts.size());
}

}  // namespace

EnergyHistogram energy_histogram(std::span<const double> energies, std::optional<double> least, int bins) {
  std::vector<double> kept;
  for (const double e : energies) {
    if (e > 0 && e >= least.value_or(0)) kept.push_back(e);
  }
  EnergyHistogram histogram;
  if (kept.empty()) return histogram;
  const auto [low, high] = std::minmax_element(kept.begin(), kept.end());
  histogram.least = *low;
  histogram.most = std::max(*high, *low * (1 + 1e-9));
  histogram.counts.assign(static_cast<std::size_t>(bins), 0.0);
  for (const double e : kept) {
    const double at = position(histogram, e);
    histogram.counts[static_cast<std::size_t>(std::clamp(at, 0.0, static_cast<double>(bins - 1)))] += 1;
  }
  return histogram;
}

double cumulative_share(const EnergyHistogram& histogram, double energy) noexcept {
  assert(!histogram.counts.empty());
  if (!(energy > histogram.least)) return 0;
  if (energy >= histogram.most) return 1;
  const double at = position(histogram, energy);
  const std::size_t bin = std::min(static_cast<std::size_t>(at), histogram.counts.size() - 1);
  double below = 0;
  for (std::size_t k = 0; k < bin; ++k) below += histogram.counts[k];
  return std::min(1.0, (below + (at - static_cast<double>(bin)) * histogram.counts[bin]) / total(histogram));
}

double energy_at(const EnergyHistogram& histogram, double share) noexcept {
  assert(!histogram.counts.empty());
  const double wanted = std::clamp(share, 0.0, 1.0) * total(histogram);
  double below = 0;
  std::size_t bin = 0;
  while (bin + 1 < histogram.counts.size() && below + histogram.counts[bin] < wanted) below += histogram.counts[bin++];
  const double count = histogram.counts[bin];
  const double part = count > 0 ? std::clamp((wanted - below) / count, 0.0, 1.0) : 0.0;
  const double at = (static_cast<double>(bin) + part) / static_cast<double>(histogram.counts.size());
  return histogram.least * std::pow(histogram.most / histogram.least, at);
}

double matched_energy(const EnergyHistogram& events, const EnergyHistogram& units, double event_energy) noexcept {
  return energy_at(units, cumulative_share(events, event_energy));
}

}  // namespace rustle::pack
