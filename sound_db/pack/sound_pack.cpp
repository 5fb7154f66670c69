#include "sound_db/pack/sound_pack.h"

#include <cmath>
#include <numbers>

#include "sound_db/pack/bent_strip.h"

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

}  // namespace rustle::pack
