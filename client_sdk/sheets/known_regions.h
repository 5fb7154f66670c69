#pragma once

#include <array>
#include <vector>

#include "client_sdk/sheets/shape.h"

namespace rustle::sheets {

/// What an analysis of the sheet should find there (paper sound 2016, sections 4 and 5).
struct KnownRegion {
  double area_m2 = 0;
  bool constrained = true;     ///< no free curved border
  double ruling_length_m = 0;  ///< l_r, the mean over the region's points of the ruling through each; 0 when constrained
  double free_border_length_m = 0;            ///< l_c; 0 when constrained
  std::array<double, 2> centroid_m = {0, 0};  ///< in the material plane
};

/// The regions of an analytic sheet, largest first, from its formulas: each piece is a region, without its ridges; it is
/// curved where its curvature exceeds flat_bending_per_m, and its free borders are where the border's normal curvature
/// κ (1 - cos²) does, cos between border and ruling. Integrals by midpoints, exact to 1e-3. Pure.
[[nodiscard]] std::vector<KnownRegion> known_regions(const NamedShape& sheet, double flat_bending_per_m = 2);

}  // namespace rustle::sheets
