#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "server/analysis/parameters.h"
#include "server/analysis/stencil.h"
#include "server/sheet/mesh_frame.h"

/// The partition of a sheet into regions that vibrate as one: flat parts and bent parts with one family of rulings, between
/// ridges and inflections (P3).
namespace rustle::analysis {

/// What the partition needs of a topology and rest shape alone.
struct RegionStencils {
  std::shared_ptr<const sheet::Topology> topology;
  sheet::RestPlane plane;
  HingeBasis basis;
  PlanePoints centres;                                        ///< [T] of the triangles, in the rest plane
  std::vector<double> edge_length_m;                          ///< [T] mean side
  std::vector<double> ridge_width_m;                          ///< [T] over which bending is summed
  Stencil tensor;                                             ///< hinges to triangles, for the bending tensor
  std::vector<Eigen::Matrix3f> inverse;                       ///< [T] of the tensor fit's normal matrix
  std::vector<Eigen::Matrix3d> normal_matrix;                 ///< [T]
  std::vector<std::uint32_t> tensor_user_start, tensor_user;  ///< of each hinge, the triangles whose rows hold it,
  std::vector<float> tensor_user_weight;                      ///< and the weights there
  Stencil ridge;                                              ///< hinges to triangles within the ridge width
  Stencil near;         ///< triangles to triangles, to look up the level beside a border
  bool graded = false;  ///< edge lengths vary strongly over a mesh of few triangles
};
[[nodiscard]] RegionStencils region_stencils(std::shared_ptr<const sheet::Topology> topology, sheet::RestPlane plane,
                                             const Parameters& parameters);

inline constexpr std::uint8_t kRidge = 1;

/// One frame's partition, by triangle of the mesh it was made on.
struct RegionMap {
  std::uint32_t region_count = 0;
  std::vector<std::uint32_t> region;          ///< [T] label, < region_count
  std::vector<bool> region_curved;            ///< [R]
  std::vector<std::uint8_t> ridge;            ///< [T] kRidge or 0: a sharp fold runs through
  std::vector<float> bend_rad;                ///< [T] bending over the ridge width; 0 everywhere when no ridge is possible
  std::vector<float> curvature_per_m;         ///< [T] principal curvature of largest size, κ
  std::vector<float> least_curvature_per_m;   ///< [T] the other one
  std::vector<float> ruling_rad;              ///< [T] direction of least bending in the rest plane
  std::vector<sheet::Vec3f> ruling;           ///< [T] and in space, unit length
  std::vector<float> border_curvature_per_m;  ///< [border edges] across the border, free of the kernel's blur
  std::vector<float> free_border;             ///< [border edges] 0: flat, 1: curved; not counting what holds it
  std::vector<sheet::Vec3f> normals;          ///< [T]
  std::vector<float> areas_m2;                ///< [T]
};

/// Flat or curved, as the triangles were last time; shared hysteresis of the frames of one topology.
struct RegionState {
  std::shared_ptr<const sheet::Topology> topology;
  double time_s = 0;
  std::vector<bool> curved;  ///< [T]
};

/// Finds the partition. `state` may be null: no hysteresis.
/// \pre positions_m near the origin; positions_m.size() == vertices of stencils.topology
[[nodiscard]] RegionMap segment(const RegionStencils& stencils, std::span<const sheet::Vec3f> positions_m, double time_s,
                                const Parameters& parameters, RegionState* state);

/// The simulator's own partition, completed by our rulings and border curvature. Triangles in no region get one of their own
/// kind: connected, flat. \pre partition.triangle_regions has an entry per triangle
[[nodiscard]] RegionMap adopt_partition(const sheet::SentPartition& partition, const RegionStencils& stencils,
                                        std::span<const sheet::Vec3f> positions_m, const Parameters& parameters);

}  // namespace rustle::analysis
