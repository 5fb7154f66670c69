#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "server/sheet/topology.h"
#include "server/sheet/vector.h"

namespace rustle::sheet {

/// Mean of the positions, summed in double. Zero for none.
[[nodiscard]] Vec3f mean_position_m(std::span<const Vec3f> positions_m);

/// Positions relative to `origin_m`, which is a float itself: differences are rounded once, as if made in double, and what
/// follows may use float even far from the origin.
void relative_positions_m(std::span<const Vec3f> positions_m, const Vec3f& origin_m, std::vector<Vec4f>& out_m);

/// Areas of the triangles. Allocates nothing once `out_m2` has its size. [T]
void face_areas_m2(const Topology& topology, std::span<const Vec4f> positions_m, std::vector<float>& out_m2);

/// Of some of them. [triangles]
void face_areas_m2(const Topology& topology, std::span<const Vec4f> positions_m, std::span<const std::uint32_t> triangles,
                   std::vector<float>& out_m2);

/// Barycentric dual areas: a third of every triangle around a vertex. [V]
void vertex_areas_m2(const Topology& topology, std::span<const float> face_areas_m2, std::vector<float>& out_m2);

/// The four vertices of every interior edge: start, end, the apex of the left and of the right triangle. An edge whose
/// triangles are oriented against each other repeats its left apex: its angle is 0.
using Hinge = std::array<std::uint32_t, 4>;
[[nodiscard]] std::vector<Hinge> hinges(const Topology& topology);

/// Signed dihedral angle θ of every hinge, in radians within ±π, > 0 where normals spread (a dome seen from the normals'
/// side):
///   θ = atan2((n_l x n_r)·e/|e|, n_l·n_r)
/// Hinges with a triangle without area are 0. Relative error below 1e-6. Pure, allocates nothing. O(hinges).
/// \pre out_rad.size() == hinges.size(); positions near the origin (relative_positions_m)
void dihedral_angles_rad(std::span<const Hinge> hinges, std::span<const Vec4f> positions_m, std::span<float> out_rad);

/// Mean length of the edges around every vertex, 0 without any. [V]
template <class Point>
std::vector<double> local_edge_lengths_m(const Topology& topology, std::span<const Point> positions_m);
extern template std::vector<double> local_edge_lengths_m<Vec2d>(const Topology&, std::span<const Vec2d>);
extern template std::vector<double> local_edge_lengths_m<Vec3d>(const Topology&, std::span<const Vec3d>);

}  // namespace rustle::sheet
