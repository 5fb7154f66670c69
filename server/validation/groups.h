#pragma once

#include <span>
#include <string_view>

#include "server/validation/check.h"

/// Every group of checks. Pure but for wall times: the same setting gives the same figures, whatever its workers.
namespace rustle::validation {

/// Table 1: distances between friction spectra (P12), and what the estimator's noise alone makes.
Findings table1(const Setting& setting);
/// Figs. 12 and 13: friction and flaps of A4, half A4, A5 and A6 sheets, and of a flat one.
Findings sizes(const Setting& setting);
/// Figs. 14 and 15: friction by height above the table, and the comb of a wall.
Findings reflections(const Setting& setting);
/// Figs. 1, 3, 4 and 17 as spectrograms.
Findings scenes(const Setting& setting);
/// P8, P9 and P10 of the synthesis alone: ripple, adding powers, eq. 6 against eq. 5.
Findings synthesis_laws(const Setting& setting);
/// No click: pure tones while everything moves at random.
Findings clicks(const Setting& setting);
/// The pack's units: decays and durations.
Findings units(const Setting& setting);
/// P13 and the merging of dense bursts (P9).
Findings fine_events(const Setting& setting);
/// T4 and T6: the sound of tearing, and Figs. 6 to 8 of its paper.
Findings tearing(const Setting& setting);
/// Fig. 9 of Lejemble et al. 2015: height and lengths of the cone between the hands that tear a sheet.
Findings tear_cone(const Setting& setting);
/// The reference events that fix loudness.
Findings levels(const Setting& setting);
/// Table 2: time per frame.
Findings timing(const Setting& setting);
/// C1, C3 and C4 alone, and what the packs of cloth hold.
Findings cloth_data(const Setting& setting);
/// Cloth through its whole pipeline (C1 - C9), and Fig. 3 of An et al. 2012.
Findings cloth(const Setting& setting);
/// The pack beside recordings, class by class.
Findings recordings(const Setting& setting);

struct Group {
  std::string_view name;  ///< what its checks' names begin with
  std::string_view title;
  std::string_view about;  ///< a sentence
  Findings (*run)(const Setting&);
  double weight = 1;  ///< its part of the time
  bool needs_recordings = false;
};

/// In the order in which they are run and shown.
std::span<const Group> groups();

}  // namespace rustle::validation
