#include "server/analysis/curvature.h"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <utility>

#include "server/sheet/simd.h"

namespace rustle::analysis {
namespace {

constexpr double kCellsPerRadius = 3.5;      // nodes of a fine mesh are cells of the kernel radius over this
constexpr std::size_t kFineVertices = 8192;  // from there on the order of hinges in memory counts

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

/// H and K of every row's target.
RUSTLE_SIMD void sum_rows(const CurvatureStencils& stencils, Curvature& out) {
  float *const mean_per_m = out.mean_per_m.data(), *const bending_per_m = out.bending_per_m.data();
  for (std::size_t i = 0; i < stencils.targets.size(); ++i) {
    const Moment seen = weighted_sum(stencils.rows.row(i), out.moments) * stencils.response[i];
    mean_per_m[stencils.targets[i]] = seen[0] + seen[1] + seen[2];
    bending_per_m[stencils.targets[i]] = seen[3];
  }
}

}  // namespace

CurvatureStencils curvature_stencils(std::shared_ptr<const sheet::Topology> topology, sheet::RestPlane plane,
                                     const Parameters& parameters) {
  CurvatureStencils out;
  out.topology = std::move(topology);
  out.plane = std::move(plane);
  out.edge_length_m = sheet::local_edge_lengths_m<sheet::Vec2d>(*out.topology, out.plane.coordinates_m);
  HingeBasis basis = hinge_basis(*out.topology, out.plane);
  out.nodes = moment_nodes(out.plane, basis, parameters.event_radius_m / kCellsPerRadius);
  out.node_area_m2.assign(out.nodes.area_m2.begin(), out.nodes.area_m2.end());
  for (double edge : out.edge_length_m) {
    out.radius_m.push_back(std::max(parameters.event_radius_m, parameters.event_radius_edges * edge));
  }
  out.rows = kernel({out.plane.coordinates_m, out.plane.component}, out.radius_m, out.nodes.points);
  out.targets = sort_rows(out.rows, out.nodes.of_vertex);
  out.response.reserve(out.rows.rows());
  for (std::size_t i = 0; i < out.rows.rows(); ++i) {
    const auto row = out.rows.row(i);
    double area_m2 = 0;
    for (const auto& [node, weight] : row) area_m2 += static_cast<double>(weight) * out.nodes.area_m2[node];
    const Eigen::Vector3d trace =
        inverted_normal_matrix(normal_matrix_of(row, out.nodes.normal_matrix)) * Eigen::Vector3d(0.5, 0, 0.5);
    out.response.push_back(Eigen::Array4d(trace[0], trace[1], trace[2], 0.5 / std::max(area_m2, 1e-30)).cast<float>());
  }
  out.hinges = std::move(basis.hinges);
  out.in_edge_order = out.plane.coordinates_m.size() < kFineVertices;
  if (!out.in_edge_order) sort_by_node(out.nodes, out.hinges);
  link_neighbours(out);
  return out;
}

void measure_curvature(const CurvatureStencils& stencils, std::span<const float> angles_rad, Curvature& out) {
  gather_moments(stencils.nodes, angles_rad, out.moments);
  out.mean_per_m.resize(stencils.targets.size());
  out.bending_per_m.resize(stencils.targets.size());
  sum_rows(stencils, out);
}

}  // namespace rustle::analysis
