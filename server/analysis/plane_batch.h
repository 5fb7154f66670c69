#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "server/sheet/vector.h"

namespace rustle::analysis {

/// Triangles over which the distance is linear, corners in order of distance, each in a lane: what they are and what they
/// add to their corners. Distances are taken from that of the lowest corner. With the corners at 0 <= d1 <= d2
///   dA/ds = 2A s / (d1 d2) below d1,  2A (d2 - s) / ((d2 - d1) d2) above
struct PlaneBatch {
  static constexpr std::size_t kLanes = 32;
  using Lanes = float[kLanes];
  struct alignas(16) Vectors {
    float at[kLanes][4] = {};

    void put(std::size_t lane, const sheet::Vec4f& vector) { sheet::Vec4f::MapAligned(at[lane]) = vector; }
    sheet::Vec4f operator[](std::size_t lane) const { return sheet::Vec4f::MapAligned(at[lane]); }
  };
  struct Triangle {
    std::array<std::uint32_t, 3> corners;
    std::uint32_t partner_triangle;
  };
  std::size_t count = 0;
  std::array<Triangle, kLanes> triangles{};
  Lanes area_m2 = {}, middle_m = {}, rise_m = {};   ///< A, d1, d2
  Lanes lowest_m = {}, full_m = {}, radius_m = {};  ///< limits of the weight
  Lanes reached[3] = {};                            ///< 1: the corner is within reach, else 0
  Vectors slip_m_per_s[3];
  Lanes contact_m2[3] = {};  ///< ∫ w φ dA of each corner,
  Vectors moved[3];          ///< and with the slip v: ∫ w φ v dA, and of |v| last
  Lanes beyond = {};         ///< contact area where no corner is within reach
};

/// By Gauss-Legendre points between the kinks of the weight, which falls from 1 to 0 over `fade_m` (1 - 3x² + 2x³), exactly
/// for the area and its first moments; the slip is that in the middle of each line of equal distance. What is not put in a
/// lane is of no matter as long as its area is 0.
void integrate_lines(PlaneBatch& batch, float fade_m);

}  // namespace rustle::analysis
