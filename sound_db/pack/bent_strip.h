#pragma once

namespace rustle::pack {

/// A strip bent to a circular arc: an edge of length `edge_m` whose chord is (1 - compression) of it, standing on the
/// chord's ends. With x the half angle: sin x / x = 1 - compression, R = edge / 2x.
struct BentStrip {
  double radius_m = 0;         ///< R
  double half_angle_rad = 0;   ///< x
  double rise_m = 0;           ///< R (1 - cos x), of the middle above the chord
  double mean_height_m = 0;    ///< R (sin x / x - cos x)
  double height_spread_m = 0;  ///< standard deviation of the height along the arc
};

/// \pre edge_m > 0; compression is held within [1e-6, 0.99]
BentStrip bent_strip(double edge_m, double compression) noexcept;

}  // namespace rustle::pack
