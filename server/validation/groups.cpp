#include "server/validation/groups.h"

#include <array>

namespace rustle::validation {

std::span<const Group> groups() {
  static constexpr std::array<Group, 15> kGroups = {
      {{"table1", "Table 1", "Distances between friction spectra by size, compression and shape", table1, 10},
       {"sizes", "Figures 12 and 13", "Friction and flaps of A4 to A6 sheets", sizes, 10},
       {"reflections", "Figures 14 and 15", "Friction above a table, the comb of a wall", reflections, 4},
       {"scenes", "Figures 1, 3, 4 and 17", "Spectrograms of sheets that are bent, slid, snapped and shaken", scenes, 5},
       {"units", "Units of the pack", "How flaps and clacs decay", units, 2},
       {"fine_events", "Below the mesh", "Energies of the finest events, and dense bursts merged", fine_events, 5},
       {"synthesis", "Synthesis", "Ripple, powers that add, eq. 6 against eq. 5", synthesis_laws, 12},
       {"clicks", "No click", "Pure tones while everything moves at random", clicks, 3},
       {"tearing", "Tearing", "Speed, breaks, colour and level of tears beside Lejemble et al. 2015", tearing, 4},
       {"tear_cone", "Cone of a tear", "Height and lengths of the cone between the hands that tear a sheet", tear_cone, 0.5},
       {"levels", "Levels", "The reference events that fix loudness", levels, 2},
       {"cloth_data", "Cloth's data", "Friction by speed, features, the warp, and what the packs of cloth hold", cloth_data,
        4},
       {"cloth", "Cloth", "A cloth that is rubbed and crumpled, in every material: loudness, joins, repetition, speed",
        cloth, 8},
       {"recordings", "Beside recordings", "The pack's classes of sounds beside real ones", recordings, 10, true},
       {"timing", "Table 2", "Time of the analysis per frame", timing, 2}}};
  return kGroups;
}

}  // namespace rustle::validation
