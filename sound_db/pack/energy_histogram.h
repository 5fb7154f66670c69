#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

namespace rustle::pack {

inline constexpr int kEnergyBins = 20;

/// Distribution of energies in bins that are equally wide in log E from `least` to `most` (C2: 20 linear bins would put 92 %
/// of the events in the first). Its CDF is piecewise linear in log E.
struct EnergyHistogram {
  double least = 0;            ///< E_min; above 0
  double most = 0;             ///< E_max; above least
  std::vector<double> counts;  ///< of each bin; empty: nothing is known
  friend bool operator==(const EnergyHistogram&, const EnergyHistogram&) = default;
};

/// Histogram of the energies that are at least `least` (absent: of all), from the least of them to the most. Equal energies
/// give a narrow step. Empty without any.
EnergyHistogram energy_histogram(std::span<const double> energies, std::optional<double> least = {}, int bins = kEnergyBins);

/// CDF, held to 0 below and to 1 above the range. \pre counts is not empty
double cumulative_share(const EnergyHistogram& histogram, double energy) noexcept;

/// The least energy whose CDF reaches `share`, held within the range. \pre counts is not empty
double energy_at(const EnergyHistogram& histogram, double share) noexcept;

/// The histogram matching of An et al. 2012, section 3 (after Heeger and Bergen 1995): E_s = c_s⁻¹(c_e(E_e)).
/// \pre both hold counts
double matched_energy(const EnergyHistogram& events, const EnergyHistogram& units, double event_energy) noexcept;

}  // namespace rustle::pack
