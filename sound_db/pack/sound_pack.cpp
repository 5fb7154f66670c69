#include "sound_db/pack/sound_pack.h"

#include <cmath>
#include <numbers>
#include <tuple>

#include "sound_db/pack/bent_strip.h"
#include "sound_db/pack/cloth_corpus.h"

namespace rustle::pack {

double GridPoint::disc_radius_m() const {
  return constrained() ? 0.0 : std::sqrt(ruling_length_m * free_border_length_m / 2 / std::numbers::pi);
}

double CrumplingSection::reference_amplitude_m(const GridPoint& point) const {
  if (point.constrained()) return constrained_reference_amplitude_m;
  // H goes from 1/2R to -1/2R on the whole area.
  const double edge_m = point.free_border_length_m / 2;
  return point.ruling_length_m * edge_m / bent_strip(edge_m, reference_compression).radius_m;
}

bool operator==(const SoundPack& a, const SoundPack& b) {
  const auto members = [](const SoundPack& p) {
    return std::tie(p.name, p.version, p.material, p.touched_surface, p.grammage_kg_per_m2, p.licence, p.origin, p.rate_hz,
                    p.stored_rate_hz, p.crumpling, p.friction, p.folder, p.notices);
  };
  const bool same_cloth = a.cloth == b.cloth || (a.cloth && b.cloth && *a.cloth == *b.cloth);
  return same_cloth && members(a) == members(b);
}

}  // namespace rustle::pack
