#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "server/synthesis/cloth/feature_rows.h"

/// Which unit of a database sounds in the place of each unit of a target (An et al. 2012, section 4.4, Algorithm 1; C5).
/// Here as it is written, over the whole table: what UnitIndex chooses in less time is this, unit for unit.
namespace rustle::cloth {

struct SelectionRules {
  std::size_t look_ahead = 5;  ///< L, units
  double d_max = 2.0;          ///< D1 beyond which no unit is taken, as long as there are others
  std::size_t cool_off = 20;   ///< L_c, units
};

inline constexpr std::uint32_t kNoUnit = 0xffffffffU;

struct Choice {
  std::uint32_t unit = kNoUnit;
  bool far = false;  ///< no free unit was within d_max: the nearest free one by D1

  friend bool operator==(const Choice&, const Choice&) = default;
};

/// D1 = |f - g| (eq. 10), added up in double in the order of the dimensions.
inline double feature_distance(const float* f, const float* g, std::size_t dimensions) noexcept {
  double sum = 0;
  for (std::size_t k = 0; k < dimensions; ++k) {
    const double e = static_cast<double>(f[k]) - static_cast<double>(g[k]);
    sum += e * e;
  }
  return std::sqrt(sum);
}

/// D2 (eq. 11) of as many units as `window` has rows, from unit `unit` on, added up in their order.
/// \pre that many units follow in the database
double window_distance(const FeatureRows& window, const FeatureRows& database, std::size_t unit) noexcept;

/// How many units follow each unit in its own recording.
std::vector<std::uint32_t> units_left(const FeatureRows& database);

/// Algorithm 1 for one target unit, by going through the whole database:
///   argmin D2 over the units within d_max that are free and have the look-ahead's successors in their recording (eq. 12);
///   else argmin D1 over the free units; else, when all cool off, the one chosen longest ago. Ties go to the lower index.
/// \param window   the unit and its look-ahead, 1 + L rows or fewer at the target's end
/// \param left     units_left(database)
/// \param cooling  chosen in the last L_c units, the oldest first
/// \pre the database has a unit
Choice choose_by_table(const FeatureRows& window, const FeatureRows& database, std::span<const std::uint32_t> left,
                       double d_max, std::span<const std::uint32_t> cooling);

/// The same for a whole target. O(units x database x L); any thread.
std::vector<Choice> select_by_table(const FeatureRows& target, const FeatureRows& database, const SelectionRules& rules);

/// The choices of least total cost over a whole target, offline (the paper's future work):
///   Σ_i D1(i, J(i)) + kJoinCost · (number of joins), units beyond d_max costing kFarCost more
/// by dynamic programming over all units: exact, but for the cool-off, which is held against the history of the best path
/// so far, from which alone a join departs. O(units x database), one bit each; any thread. \pre the database has a unit
std::vector<Choice> select_globally(const FeatureRows& target, const FeatureRows& database, const SelectionRules& rules);
inline constexpr double kJoinCost = 1.0;
inline constexpr double kFarCost = 1000.0;

/// That total for any choices.
double selection_cost(const FeatureRows& target, const FeatureRows& database, std::span<const Choice> choices, double d_max);

}  // namespace rustle::cloth
