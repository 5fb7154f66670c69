#include "server/synthesis/resonator_level.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "sound_db/dsp/level.h"

namespace rustle::synthesis {

double size_factor(Mode mode, double radius_m, double reference_radius_m) noexcept {
  if (mode == Mode::kPublished) return std::pow(std::clamp(radius_m, 0.0, 10.0) / kPublishedRadius_m, 3);
  if (reference_radius_m <= 0 || radius_m <= 0) return 1;
  const double limit = dsp::db_to_gain(kSizeLimit_db);
  return std::clamp(std::pow(radius_m / reference_radius_m, 3), 1 / limit, limit);
}

std::vector<Share> shares(Mode mode, const std::vector<observation::Resonator>& resonators) {
  std::vector<Share> kept(resonators.size());
  for (std::size_t i = 0; i < kept.size(); ++i) kept[i].index = i;
  if (kept.size() > kMaxResonators) {
    std::stable_sort(kept.begin(), kept.end(), [&](const Share& a, const Share& b) {
      return resonators[a.index].area_m2 > resonators[b.index].area_m2;
    });
    kept.resize(kMaxResonators);
    std::sort(kept.begin(), kept.end(), [](const Share& a, const Share& b) { return a.index < b.index; });
  }
  if (mode == Mode::kPublished) return kept;
  double total_m2 = 0;
  for (const Share& share : kept) total_m2 += std::max(0.0, resonators[share.index].area_m2);
  for (Share& share : kept) {
    const double part =
        total_m2 > 0 ? std::max(0.0, resonators[share.index].area_m2) / total_m2 : 1.0 / static_cast<double>(kept.size());
    share.amplitude = std::sqrt(part);
  }
  return kept;
}

spatial::Emitter emitter_of(Mode mode, const observation::Resonator& resonator) noexcept {
  spatial::Emitter emitter;
  emitter.position_m = resonator.position_m;
  emitter.normal = spatial::normalized(resonator.normal, {0, 0, 1});
  if (mode == Mode::kPublished) {
    emitter.cosine_floor = 0;
    emitter.fades_when_touching = false;
    return emitter;
  }
  // Normals spread evenly about their mean: seen edge-on, the mean square of cos θ is half of that of the sine of the
  // spread.
  emitter.cosine_floor = std::clamp(resonator.normal_spread / std::numbers::sqrt2, spatial::kMinCosineFloor, 1.0);
  emitter.covariance_m2 = resonator.covariance_m2;
  return emitter;
}

observation::Resonator bare_resonator(const sheet::Vec3d& position_m, double area_m2) {
  observation::Resonator resonator;
  resonator.position_m = position_m;
  resonator.area_m2 = area_m2;
  resonator.disc_radius_m = std::sqrt(std::max(0.0, area_m2) / std::numbers::pi);
  return resonator;
}

}  // namespace rustle::synthesis
