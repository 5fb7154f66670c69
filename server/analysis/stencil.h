#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "server/sheet/face_geometry.h"
#include "server/sheet/rest_plane.h"

/// The least-squares fit of the bending tensor M to dihedral angles (P2, P3), prepared as far as topology and rest shape
/// allow.
namespace rustle::analysis {

/// Weights from sources to targets, row by row (CSR).
struct Stencil {
  struct Entry {
    std::uint32_t source;
    float weight;
  };
  std::vector<std::uint32_t> start;  ///< [targets + 1]
  std::vector<Entry> entries;

  std::size_t rows() const { return start.empty() ? 0 : start.size() - 1; }
  std::span<const Entry> row(std::size_t target) const {
    return std::span(entries).subspan(start[target], start[target + 1] - start[target]);
  }
};

/// Puts the rows in order of the places of their targets, and within blocks of 512 in order of length: what is near in space
/// is then near in memory, and the ends of loops over the rows are foreseen. Returns the target of each.
/// \pre place_of_target.size() == rows.rows()
[[nodiscard]] std::vector<std::uint32_t> sort_rows(Stencil& rows, std::span<const std::uint32_t> place_of_target);

/// Points of the rest plane with the piece of the sheet each belongs to: pieces may overlap there and do not see each other.
struct PlanePoints {
  std::vector<sheet::Vec2d> at_m;
  std::vector<std::uint32_t> component;
};

/// Kernel weights (1-(d/r)²)² from the sources within a target's radius; a target with none takes its nearest source.
[[nodiscard]] Stencil kernel(const PlanePoints& targets, std::span<const double> radii_m, const PlanePoints& sources);

/// What a hinge tells about the second fundamental form M of the rest plane: sampled from
/// z = -(Mxx x²/2 + Mxy x y + Myy y²/2) it shows θ = crossing · response·(Mxx, Mxy, Myy), exactly for every quadratic.
/// Slivers and edges with inconsistent triangles weigh 0.
struct HingeBasis {
  std::vector<sheet::Hinge> hinges;       ///< [E]
  PlanePoints midpoints;                  ///< [E]
  std::vector<Eigen::Vector3d> response;  ///< [E]
  std::vector<double> crossing_m;         ///< [E] mean height of the two triangles over the edge
  std::vector<double> weight_m2;          ///< [E] hinge area in the fit
  std::vector<double> length_m;           ///< [E]
  std::vector<double> area_m2;            ///< [E] a third of both triangles
  std::vector<sheet::Vec2d> along;        ///< [E] unit direction of the edge in the rest plane
};
[[nodiscard]] HingeBasis hinge_basis(const sheet::Topology& topology, const sheet::RestPlane& plane);

/// Sums over hinges of what their angles tell: (Kᵀ W θ: xx, xy, yy; Σ |θ||e|), or of constants of the same kind.
using Moment = Eigen::Array4f;

/// A fit's sums over hinges are taken in two steps: a hinge gives half of what it tells to the node of each of its ends, and
/// targets sum over nodes. A node stands for the vertices of one cell much smaller than the kernel; on coarse meshes for
/// one.
struct MomentNodes {
  PlanePoints points;                              ///< [N]
  std::vector<std::uint32_t> of_vertex;            ///< [V]
  std::vector<std::array<std::uint32_t, 2>> ends;  ///< [E] nodes of each hinge
  std::vector<Moment> factor;                      ///< [E] what one radian tells each of them
  std::vector<Eigen::Matrix3d> hinge_normal;       ///< [E] the hinge's part of each node's normal matrix
  std::vector<Eigen::Matrix3d> normal_matrix;      ///< [N] Kᵀ W K
  std::vector<double> area_m2;                     ///< [N] hinge areas
};
[[nodiscard]] MomentNodes moment_nodes(const sheet::RestPlane& plane, const HingeBasis& basis, double cell_m);

/// Puts the hinges in order of their nodes: on a fine mesh what is near in space then is near in memory. Leaves hinge_normal
/// empty.
void sort_by_node(MomentNodes& nodes, std::vector<sheet::Hinge>& hinges);

/// [N] moments of one frame. O(hinges). \pre angles_rad.size() == hinges
void gather_moments(const MomentNodes& nodes, std::span<const float> angles_rad, std::vector<Moment>& out);

/// Σ weight · moment of a row.
[[nodiscard]] inline Moment weighted_sum(std::span<const Stencil::Entry> row, const std::vector<Moment>& moments) {
  Moment even = Moment::Zero(), odd = Moment::Zero();
  std::size_t k = 0;
  for (; k + 1 < row.size(); k += 2) {
    even += row[k].weight * moments[row[k].source];
    odd += row[k + 1].weight * moments[row[k + 1].source];
  }
  if (k < row.size()) even += row[k].weight * moments[row[k].source];
  return even + odd;
}

/// A row's normal matrix.
[[nodiscard]] Eigen::Matrix3d normal_matrix_of(std::span<const Stencil::Entry> row,
                                               const std::vector<Eigen::Matrix3d>& normal_matrices);

/// Normal matrix of the fit at one target, regularised, and inverted. Zero where no hinge speaks.
[[nodiscard]] Eigen::Matrix3d inverted_normal_matrix(const Eigen::Matrix3d& normal_matrix);

}  // namespace rustle::analysis
