#pragma once

#include <vector>

#include "sound_db/dsp/random.h"

namespace rustle::generate {

/// How a piece of cloth is moved by hand.
struct ClothMotion {
  double step_s = 0.005;
  std::vector<double> speed_m_per_s;  ///< of sliding, one per step
  std::vector<double> crumpling;      ///< how much it is crumpled, 0 to 1
  double duration_s() const { return step_s * static_cast<double>(speed_m_per_s.size()); }
  /// Straight between steps, constant beyond the ends.
  double speed_at(double time_s) const;
};

/// Varied motion: strokes with a bell-shaped speed, back and forth, shakes and rests, 0.3 to 1.5 s each, the fastest drawn
/// between 0.04 and `fastest_m_per_s` in equal ratios.
ClothMotion varied_motion(double seconds, dsp::Random random, double fastest_m_per_s = 1.6);

/// The roller of An et al. 2012 (section 2): from fast to slow, speed falling exponentially.
ClothMotion roller_motion(double seconds, double fastest_m_per_s = 2.0, double slowest_m_per_s = 0.03);

/// The same speed throughout.
ClothMotion steady_motion(double seconds, double speed_m_per_s);

}  // namespace rustle::generate
