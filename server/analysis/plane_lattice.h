#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "server/analysis/stencil.h"

namespace rustle::analysis {

/// Where a field that is smooth over a length is evaluated instead of at every vertex of a mesh finer than that: the corners
/// of square cells of the rest plane, piece by piece, between which it is bilinear. A vertex that wants a wider kernel than
/// the lattice is made for is a point of its own.
struct PlaneLattice {
  struct Place {
    std::array<std::uint32_t, 4> point{};
    std::array<float, 4> share{};  ///< sums to 1
  };
  PlanePoints points;            ///< [P]
  std::vector<double> radius_m;  ///< [P] of the kernel there
  std::vector<Place> places;     ///< [V]
};

/// The lattice of cells of `cell_m` for vertices whose kernel has the radius `radius_m` exactly.
[[nodiscard]] PlaneLattice plane_lattice(const PlanePoints& vertices, std::span<const double> radii_m, double radius_m,
                                         double cell_m);

/// Two fields of the points, [P] each, at the vertices, [V] each.
void interpolate(const PlaneLattice& lattice, std::span<const float> a_at_points, std::span<const float> b_at_points,
                 std::span<float> a, std::span<float> b);

}  // namespace rustle::analysis
