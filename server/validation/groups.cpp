#include "server/validation/groups.h"

#include <array>

namespace rustle::validation {

std::span<const Group> groups() {
  static constexpr std::array<Group, 11> kGroups = {
      {{"table1", "Table 1", "Distances between friction spectra by size, compression and shape", table1, 10},
       {"sizes", "Figures 12 and 13", "Friction and flaps of A4 to A6 sheets", sizes, 10},
       {"reflections", "Figures 14 and 15", "Friction above a table, the comb of a wall", reflections, 4},
       {"scenes", "Figures 1, 3, 4 and 17", "Spectrograms of sheets that are bent, slid, snapped and shaken", scenes, 5},
       {"units", "Units of the pack", "How flaps and clacs decay", units, 2},
       {"fine_events", "Below the mesh", "Energies of the finest events, and dense bursts merged", fine_events, 5},
       {"synthesis", "Synthesis", "Ripple, powers that add, eq. 6 against eq. 5", synthesis_laws, 12},
       {"clicks", "No click", "Pure tones while everything moves at random", clicks, 3},
       {"levels", "Levels", "The reference events that fix loudness", levels, 2},
       {"recordings", "Beside recordings", "The pack's classes of sounds beside real ones", recordings, 10, true},
       {"timing", "Table 2", "Time of the analysis per frame", timing, 2}}};
  return kGroups;
}

}  // namespace rustle::validation
