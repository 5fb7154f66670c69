#include "server/synthesis/unit_loudness.h"

#include <algorithm>
#include <cmath>

namespace rustle::synthesis {

const UnitLoudness::Figures& UnitLoudness::of(const float* unit, std::uint32_t samples) {
  const auto [known, fresh] = known_.try_emplace(unit);
  if (fresh) {
    for (std::uint32_t n = 0; n < samples; ++n) {
      const auto x = static_cast<double>(unit[n]);
      known->second.energy += x * x;
      known->second.peak = std::max(known->second.peak, std::abs(x));
    }
  }
  return known->second;
}

void UnitLoudness::forget(const Material& material) {
  if (const auto& crumpling = material.pack().crumpling) {
    for (const pack::Unit& unit : crumpling->units) known_.erase(unit.samples.data());
  }
  for (const auto& slip : material.slips()) known_.erase(slip.data());
}

}  // namespace rustle::synthesis
