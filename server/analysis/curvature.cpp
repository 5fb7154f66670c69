#include "server/analysis/curvature.h"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <utility>

namespace rustle::analysis {
namespace {

void link_neighbours(CurvatureStencils& out) {
  const sheet::Topology& topology = *out.topology;
  out.neighbour_start.assign(topology.vertex_count() + 1, 0);
  const auto each = [&](auto&& visit) {
    for (const auto& e : topology.interior_edges()) visit(e.start, e.end);
    for (const auto& e : topology.border_edges()) visit(e.start, e.end);
  };
  each([&](std::uint32_t a, std::uint32_t b) { ++out.neighbour_start[a + 1], ++out.neighbour_start[b + 1]; });
  for (std::size_t i = 0; i < topology.vertex_count(); ++i) out.neighbour_start[i + 1] += out.neighbour_start[i];
  out.neighbour.resize(out.neighbour_start.back());
  std::vector<std::uint32_t> next(out.neighbour_start.begin(), out.neighbour_start.end() - 1);
  each([&](std::uint32_t a, std::uint32_t b) { out.neighbour[next[a]++] = b, out.neighbour[next[b]++] = a; });
}

}  // namespace

CurvatureStencils curvature_stencils(std::shared_ptr<const sheet::Topology> topology, sheet::RestPlane plane,
                                     const Parameters& parameters) {
  CurvatureStencils out;
  out.topology = std::move(topology);
  out.plane = std::move(plane);
  out.edge_length_m = sheet::local_edge_lengths_m<sheet::Vec2d>(*out.topology, out.plane.coordinates_m);
  HingeBasis basis = hinge_basis(*out.topology, out.plane);
  for (double edge : out.edge_length_m) {
    out.radius_m.push_back(std::max(parameters.event_radius_m, parameters.event_radius_edges * edge));
  }
  Stencil stencil =
      kernel({out.plane.coordinates_m, out.plane.component}, out.radius_m, basis.midpoints, parameters.event_stencil_hinges);
  out.mean_curvature_weight.resize(stencil.source.size());
  out.bending_weight.resize(stencil.source.size());
  for (std::size_t i = 0; i < stencil.rows(); ++i) {
    Eigen::Matrix3d normal_matrix = Eigen::Matrix3d::Zero();
    double area = 0;
    for (std::uint32_t k = stencil.start[i]; k < stencil.start[i + 1]; ++k) {
      const std::uint32_t h = stencil.source[k];
      normal_matrix +=
          static_cast<double>(stencil.weight[k]) * basis.weight_m2[h] * basis.response[h] * basis.response[h].transpose();
      area += static_cast<double>(stencil.weight[k]) * basis.area_m2[h];
    }
    const Eigen::Vector3d trace = inverted_normal_matrix(normal_matrix) * Eigen::Vector3d(0.5, 0, 0.5);
    for (std::uint32_t k = stencil.start[i]; k < stencil.start[i + 1]; ++k) {
      const std::uint32_t h = stencil.source[k];
      const double w = static_cast<double>(stencil.weight[k]);
      out.mean_curvature_weight[k] =
          static_cast<float>(w * basis.weight_m2[h] * trace.dot(basis.response[h]) / basis.crossing_m[h]);
      out.bending_weight[k] = static_cast<float>(w * basis.length_m[h] / std::max(2 * area, 1e-30));
    }
  }
  out.hinges = std::move(basis.hinges);
  out.start = std::move(stencil.start);
  out.hinge = std::move(stencil.source);
  link_neighbours(out);
  return out;
}

void mean_curvature_per_m(const CurvatureStencils& stencils, std::span<const float> angles_rad, std::span<float> out_per_m) {
  assert(angles_rad.size() == stencils.hinges.size());
  assert(out_per_m.size() + 1 == stencils.start.size());
  const float* angle = angles_rad.data();
  const float* weight = stencils.mean_curvature_weight.data();
  const std::uint32_t* hinge = stencils.hinge.data();
  for (std::size_t i = 0; i < out_per_m.size(); ++i) {
    const std::uint32_t end = stencils.start[i + 1];
    std::uint32_t k = stencils.start[i];
    float a = 0, b = 0, c = 0, d = 0;  // four sums hide the latency of one
    for (; k + 4 <= end; k += 4) {
      a += weight[k] * angle[hinge[k]];
      b += weight[k + 1] * angle[hinge[k + 1]];
      c += weight[k + 2] * angle[hinge[k + 2]];
      d += weight[k + 3] * angle[hinge[k + 3]];
    }
    for (; k < end; ++k) a += weight[k] * angle[hinge[k]];
    out_per_m[i] = (a + b) + (c + d);
  }
}

float bending_per_m(const CurvatureStencils& stencils, std::span<const float> angles_rad, std::uint32_t vertex) {
  float sum = 0;
  for (std::uint32_t k = stencils.start[vertex]; k < stencils.start[vertex + 1]; ++k) {
    sum += stencils.bending_weight[k] * std::fabs(angles_rad[stencils.hinge[k]]);
  }
  return sum;
}

}  // namespace rustle::analysis
