#include "server/synthesis/gain.h"

#include <algorithm>

namespace rustle::synthesis {

double gain_db_of(std::span<const Gain> gains, sheet::SheetId sheet, SoundKind kind, std::string_view material) {
  double sum_db = 0;
  for (const Gain& gain : gains) {
    const bool concerned = (!gain.sheet_id || *gain.sheet_id == sheet) && (!gain.kind || *gain.kind == kind) &&
                           (gain.material.empty() || gain.material == material);
    if (concerned) sum_db += gain.gain_db;
  }
  return std::min(sum_db, kMostGainsSum_db);
}

std::vector<Gain> changed(std::vector<Gain> gains, std::span<const Gain> changes) {
  for (const Gain& change : changes) {
    const auto known = std::find_if(gains.begin(), gains.end(), [&](const Gain& g) { return g.same_sounds(change); });
    if (known == gains.end()) {
      gains.push_back(change);
    } else {
      known->gain_db = change.gain_db;
    }
  }
  std::erase_if(gains, [](const Gain& gain) { return gain.gain_db == 0; });
  return gains;
}

}  // namespace rustle::synthesis
