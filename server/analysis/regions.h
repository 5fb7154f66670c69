#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "server/analysis/parameters.h"
#include "server/analysis/stencil.h"
#include "server/sheet/disjoint_sets.h"
#include "server/sheet/mesh_frame.h"

/// The partition of a sheet into regions that vibrate as one: flat parts and bent parts with one family of rulings, between
/// ridges and inflections (P3).
namespace rustle::analysis {

/// What the partition needs of a topology and rest shape alone.
struct RegionStencils {
  std::shared_ptr<const sheet::Topology> topology;
  sheet::RestPlane plane;
  HingeBasis basis;
  std::vector<sheet::Vec2d> centres_m;  ///< [T] of the triangles, in the rest plane
  std::vector<double> edge_length_m;    ///< [T] mean side
  std::vector<sheet::Vec2f> rest_m;     ///< [V] in the rest plane, from its middle
  std::vector<std::uint32_t> order;     ///< [T] triangles along a Hilbert curve over the rest plane: near ones come together
  bool graded = false;                  ///< edge lengths vary strongly over a mesh of few triangles

  MomentNodes nodes;
  Stencil tensor;                        ///< nodes to vertices, for the bending tensor
  std::vector<Eigen::Matrix3f> inverse;  ///< [V] of the tensor fit's normal matrix
  Stencil near;                          ///< vertices to vertices, to look up the level beside a border
  static constexpr std::size_t kNearLanes = 16;
  std::vector<std::uint32_t> near_start;                          ///< [V / 16, rounded up, + 1] of rows of near_lanes
  std::vector<std::array<std::uint32_t, kNearLanes>> near_lanes;  ///< the same for so many vertices side by side

  Stencil ridge;                        ///< hinges to triangles within the ridge width
  std::vector<Moment> hinge_response;   ///< [E] of θ to the tensors of both ends in a smooth bend
  std::vector<Moment> ridge_factor;     ///< [E] |e| n nᵀ (xx, xy, yy) of the direction n across the edge
  std::vector<float> ridge_width_m;     ///< [T]
  std::vector<float> ridge_scale;       ///< [T] one over the hinge areas of a row
  std::vector<float> node_ridge_share;  ///< [N] widest ridge width over the hinge areas of a node

  std::vector<float> agree_cosine;         ///< [interior edges] cos 2Δ of rulings that still agree across it
  std::vector<sheet::Vec2f> border_twice;  ///< [border edges] (cos 2ψ, sin 2ψ) of their directions in the rest plane
  std::vector<std::array<std::uint32_t, 2>> border_neighbours;  ///< border edges of which one ends where the other starts
  std::vector<std::uint32_t> triangle_start, triangles_around;  ///< triangles of each vertex
  struct Step {
    std::uint32_t triangle, parent, edge;  ///< no parent and no edge: a piece begins
  };
  std::vector<Step> tree;             ///< [T] triangles after those they hang on, across interior edges
  std::vector<std::uint32_t> links;   ///< the interior edges that the tree leaves out
  std::vector<std::uint32_t> beyond;  ///< [3 T] of each side its other self, 3 · triangle + side; kNone at the border
};
[[nodiscard]] RegionStencils region_stencils(std::shared_ptr<const sheet::Topology> topology, sheet::RestPlane plane,
                                             const Parameters& parameters);

inline constexpr std::uint8_t kRidge = 1;

/// One frame's partition, by triangle of the mesh it was made on.
struct RegionMap {
  std::uint32_t region_count = 0;
  std::vector<std::uint32_t> region;          ///< [T] label, < region_count
  std::vector<std::uint32_t> cuts;            ///< interior edges between two regions, ascending
  std::vector<bool> region_curved;            ///< [R]
  std::vector<double> region_area_m2;         ///< [R]
  std::vector<double> region_perimeter_m;     ///< [R]
  std::vector<std::uint8_t> ridge;            ///< [T] kRidge or 0: a sharp fold runs through
  std::vector<float> bend_rad;                ///< [T] bending over the ridge width; 0 everywhere when no ridge is possible
  std::vector<float> curvature_per_m;         ///< [T] principal curvature of largest size, κ
  std::vector<float> least_curvature_per_m;   ///< [T] the other one
  std::vector<sheet::Vec2f> ruling_twice;     ///< [T] (cos 2φ, sin 2φ), φ the rest-plane direction of least bending
  std::vector<float> border_curvature_per_m;  ///< [border edges] across the border, free of the kernel's blur
  std::vector<float> free_border;             ///< [border edges] 0: flat, 1: curved; not counting what holds it
  /// Regions follow triangle edges; along the border they end in between: so much of an edge of `from` is `to`'s.
  struct BorderShift {
    std::uint32_t from, to;
    float length_m;
    std::uint32_t edge;
  };
  std::vector<BorderShift> border_shifts;
  std::vector<float> areas_m2;  ///< [T] of the triangles
};

/// Direction of a triangle's rulings in the rest plane, unit length.
[[nodiscard]] sheet::Vec2d ruling_direction(const RegionMap& map, std::size_t triangle);
/// And in space. \pre positions_m: those that the map was made of
[[nodiscard]] sheet::Vec3f ruling_in_space(const RegionStencils& stencils, const RegionMap& map,
                                           std::span<const sheet::Vec4f> positions_m, std::size_t triangle);

/// Flat or curved, as the triangles were last time; shared hysteresis of the frames of one topology.
struct RegionState {
  std::shared_ptr<const sheet::Topology> topology;
  double time_s = 0;
  std::vector<std::uint8_t> curved;  ///< [T]
};

/// One frame of the mesh of the partition.
struct RegionFrame {
  std::span<const sheet::Vec4f> positions_m;  ///< [V] near the origin
  std::span<const float> angles_rad;          ///< [E] dihedral, if they are known already; else empty
  std::span<const Moment> moments = {};       ///< [N] of these angles at the stencils' nodes, likewise
};

/// Kept between frames, so that a warm one allocates nothing. Holds no history.
struct RegionScratch {
  std::vector<float> angles_rad;  ///< [E], without those inside folds
  std::vector<Moment> moments;    ///< [N]
  std::vector<Moment> tensor;     ///< [V] M: xx, xy, yy
  std::vector<Moment> ridge_moments;
  std::vector<std::uint8_t> skirt, grown, hidden, changed, bent;
  std::vector<Eigen::Matrix3d> removed;
  struct Level {
    float up = 0, down = 0;
  };
  std::vector<float> vertex_curvature_per_m;
  std::vector<Level> level_per_m;    ///< [V] largest bending of each sign nearby
  std::vector<std::int8_t> sign;     ///< [T]
  std::vector<std::uint8_t> curved;  ///< [T]
  std::vector<double> curved_area_m2;
  std::vector<std::uint32_t> ridges, numbers, renumbered;
  sheet::DisjointSets sets{0};
  struct Beside {
    std::uint32_t region;
    double tie_m, length_m;
  };
  struct Part {
    double area_m2, perimeter_m, coarse_m3, width_m;
    bool alive, sliver;
    std::vector<Beside> beside;
  };
  std::vector<Part> parts;
};

/// Finds the partition. `state` may be null: no hysteresis. O(triangles · kernel), plus the slivers' joining.
/// \pre scratch and out may be of any frame and topology before
void segment(const RegionStencils& stencils, const RegionFrame& frame, double time_s, const Parameters& parameters,
             RegionState* state, RegionScratch& scratch, RegionMap& out);

/// Whether a frame's partition says something of every triangle.
[[nodiscard]] bool usable(const sheet::SentPartition& partition, const sheet::Topology& topology);

/// The simulator's own partition, completed by our rulings and border curvature. Triangles in no region get one of their own
/// kind: connected, flat. \pre usable(partition, *stencils.topology)
void adopt_partition(const sheet::SentPartition& partition, const RegionStencils& stencils, const RegionFrame& frame,
                     const Parameters& parameters, RegionScratch& scratch, RegionMap& out);

}  // namespace rustle::analysis
