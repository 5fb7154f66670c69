#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

namespace rustle::sheets {

/// Delaunay triangulation of points in the plane, by incremental insertion (Bowyer 1981, Watson 1981) along a space-filling
/// order. Triangles are counter-clockwise; together they fill the convex hull. Points are rounded to 2^-26 of the larger
/// extent, and on the rounded points every decision is exact. A point that coincides with an earlier one is in no triangle;
/// fewer than three points, or all on one line, give none. Expected O(N log N). Pure.
/// \pre all coordinates finite
[[nodiscard]] std::vector<std::array<std::uint32_t, 3>> delaunay(std::span<const std::array<double, 2>> points);

}  // namespace rustle::sheets
