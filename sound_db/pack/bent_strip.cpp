#include "sound_db/pack/bent_strip.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace rustle::pack {

BentStrip bent_strip(double edge_m, double compression) noexcept {
  const double chord = 1.0 - std::clamp(compression, 1e-6, 0.99);
  double low = 0, high = std::numbers::pi;
  for (int i = 0; i < 60; ++i) {
    const double x = (low + high) / 2;
    (std::sin(x) > chord * x ? low : high) = x;
  }
  const double x = (low + high) / 2, radius_m = edge_m / (2 * x);
  const double mean_cosine = std::sin(x) / x;
  const double variance = 0.5 + std::sin(2 * x) / (4 * x) - mean_cosine * mean_cosine;
  return {radius_m, x, radius_m * (1 - std::cos(x)), radius_m * (mean_cosine - std::cos(x)),
          radius_m * std::sqrt(std::max(0.0, variance))};
}

}  // namespace rustle::pack
