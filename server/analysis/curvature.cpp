#include "server/analysis/curvature.h"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <utility>

#include "server/analysis/plane_lattice.h"
#include "server/analysis/plane_order.h"
#include "server/sheet/simd.h"

namespace rustle::analysis {
namespace {

constexpr double kCellsPerRadius = 3.0;    // nodes of a fine mesh are cells of the kernel radius over this
constexpr double kLatticePerRadius = 4.0;  // H and K are smooth over the radius: where vertices lie closer, so many corners
constexpr std::size_t kFineVertices = 8192;  // from there on the order of hinges in memory counts
constexpr std::size_t kManySources = 16;     // of a vertex on average: from there on, on fine meshes, blocks cost less

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

/// What a target's sum is multiplied by. `each(visit)` calls visit(node, weight) for its sources.
template <class Each>
Moment response_of(const MomentNodes& nodes, Each&& each) {
  double area_m2 = 0;
  Eigen::Matrix3d normal_matrix = Eigen::Matrix3d::Zero();
  each([&](std::uint32_t node, float weight) {
    area_m2 += static_cast<double>(weight) * nodes.area_m2[node];
    normal_matrix += static_cast<double>(weight) * nodes.normal_matrix[node];
  });
  const Eigen::Vector3d trace = inverted_normal_matrix(normal_matrix) * Eigen::Vector3d(0.5, 0, 0.5);
  return Eigen::Array4d(trace[0], trace[1], trace[2], 0.5 / std::max(area_m2, 1e-30)).cast<float>();
}

/// The sums of a mesh much finer than the kernel: in blocks, and at the corners of a lattice where those are fewer.
void prepare_blocks(CurvatureStencils& out, const PlanePoints& vertices, const Stencil& rows, double event_radius_m) {
  out.lattice = plane_lattice(vertices, out.radius_m, event_radius_m, event_radius_m / kLatticePerRadius);
  if (2 * out.lattice.radius_m.size() > vertices.at_m.size()) out.lattice = {};
  const bool direct = out.lattice.places.empty();
  const PlanePoints& points = direct ? vertices : out.lattice.points;
  const std::vector<double>& radius_m = direct ? out.radius_m : out.lattice.radius_m;
  out.targets = along_hilbert_curve(points);
  out.blocks =
      direct ? kernel_blocks(rows, out.targets, points, radius_m, out.nodes.points)
             : kernel_blocks(kernel(points, radius_m, out.nodes.points), out.targets, points, radius_m, out.nodes.points);
  for (const KernelBlocks::Block& block : out.blocks.blocks) {
    for (std::size_t lane = 0; lane < block.targets; ++lane) {
      out.response.push_back(response_of(out.nodes, [&](auto&& visit) {
        for (const std::uint32_t node : out.blocks.sources_of(block)) visit(node, out.blocks.weight(block, lane, node));
      }));
    }
  }
}

void prepare_sums(CurvatureStencils& out, double event_radius_m) {
  const PlanePoints vertices{out.plane.coordinates_m, out.plane.component};
  const std::size_t count = vertices.at_m.size();
  Stencil rows = kernel(vertices, out.radius_m, out.nodes.points);
  out.response.reserve(count);
  if (count < kFineVertices || rows.entries.size() < kManySources * count) {
    out.targets = sort_rows(rows, out.nodes.of_vertex);
    out.rows = std::move(rows);
    for (std::size_t i = 0; i < count; ++i) {
      out.response.push_back(response_of(out.nodes, [&](auto&& visit) {
        for (const auto& [node, weight] : out.rows.row(i)) visit(node, weight);
      }));
    }
    return;
  }
  prepare_blocks(out, vertices, rows, event_radius_m);
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
  prepare_sums(out, parameters.event_radius_m);
  out.hinges = std::move(basis.hinges);
  out.in_edge_order = out.plane.coordinates_m.size() < kFineVertices;
  if (!out.in_edge_order) sort_by_node(out.nodes, out.hinges);
  link_neighbours(out);
  return out;
}

void measure_curvature(const CurvatureStencils& stencils, std::span<const float> angles_rad, Curvature& out) {
  gather_moments(stencils.nodes, angles_rad, out.moments);
  const std::size_t vertices = stencils.radius_m.size();
  out.mean_per_m.resize(vertices);
  out.bending_per_m.resize(vertices);
  if (stencils.blocks.blocks.empty()) return sum_rows(stencils, out);
  const bool direct = stencils.lattice.places.empty();
  std::vector<float>&mean_per_m = direct ? out.mean_per_m : out.mean_at_lattice_per_m,
  &bending_per_m = direct ? out.bending_per_m : out.bending_at_lattice_per_m;
  mean_per_m.resize(stencils.targets.size());
  bending_per_m.resize(stencils.targets.size());
  sum_blocks(stencils.blocks, out.moments, stencils.targets, stencils.response, mean_per_m, bending_per_m);
  if (!direct) interpolate(stencils.lattice, mean_per_m, bending_per_m, out.mean_per_m, out.bending_per_m);
}

}  // namespace rustle::analysis
