#pragma once

#include <cstdint>
#include <limits>
#include <span>
#include <vector>

#include "server/sheet/face_geometry.h"
#include "server/sheet/rest_plane.h"

namespace rustle::analysis {

/// Weights from sources to targets, row by row (CSR).
struct Stencil {
  std::vector<std::uint32_t> start;  ///< [targets + 1]
  std::vector<std::uint32_t> source;
  std::vector<float> weight;

  std::size_t rows() const { return start.empty() ? 0 : start.size() - 1; }
};

/// Points of the rest plane with the piece of the sheet each belongs to: pieces may overlap there and do not see each other.
struct PlanePoints {
  std::vector<sheet::Vec2d> at_m;
  std::vector<std::uint32_t> component;
};

/// Kernel weights (1-(d/r)²)² from the sources within a target's radius; a target with none takes its nearest source.
/// A row with more than `most` sources keeps that many, evenly spread over the neighbourhood.
[[nodiscard]] Stencil kernel(const PlanePoints& targets, std::span<const double> radii_m, const PlanePoints& sources,
                             std::size_t most = std::numeric_limits<std::size_t>::max());

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
};
[[nodiscard]] HingeBasis hinge_basis(const sheet::Topology& topology, const sheet::RestPlane& plane);

/// Normal matrix of the fit at one target, regularised, and inverted. Zero where no hinge speaks.
[[nodiscard]] Eigen::Matrix3d inverted_normal_matrix(const Eigen::Matrix3d& normal_matrix);

}  // namespace rustle::analysis
