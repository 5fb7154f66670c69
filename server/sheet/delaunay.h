#pragma once

#include <span>
#include <vector>

#include "server/sheet/topology.h"
#include "server/sheet/vector.h"

namespace rustle::sheet {

/// Delaunay triangulation of points in the plane, counter-clockwise: incremental insertion (Bowyer 1981, Watson 1981) with
/// exact predicates on coordinates rounded to 2^-20 of the extent. Of points that round to the same place only the first is
/// used. Covers the convex hull but for slivers thinner than that rounding. About O(N log N); thread safe. \pre points
/// finite
[[nodiscard]] std::vector<Triangle> delaunay(std::span<const Vec2d> points);

}  // namespace rustle::sheet
