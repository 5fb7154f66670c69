#include <algorithm>
#include <cmath>
#include <numbers>
#include <tuple>
#include <utility>

#include <Eigen/Geometry>

#include "server/analysis/plane_order.h"
#include "server/analysis/regions.h"

namespace rustle::analysis {
namespace {

using sheet::Triangle;
using sheet::Vec2d;

// The marginal of (1-(d/r)²)² at its centre is 3.2/(π r): with r = 3.2/π · width a sharp fold of angle a peaks at a / width.
constexpr double kRidgeRadiusPerWidth = 3.2 / std::numbers::pi;
constexpr double kCellsPerRadius = 4.5;  // nodes of the tensor fit: the cells of those of H
constexpr double kNearRadius = 0.62;     // of the tensor's
constexpr double kGradedRatio = 2.5;

bool is_graded(std::vector<double> lengths) {
  if (lengths.size() < 10) return false;
  std::sort(lengths.begin(), lengths.end());
  return lengths[lengths.size() * 19 / 20] > kGradedRatio * lengths[lengths.size() / 20];
}

sheet::Vec2f twice(const Vec2d& direction) {
  const double squared = direction.squaredNorm();
  if (!(squared > 0)) return {1, 0};
  return sheet::Vec2d((direction.x() * direction.x() - direction.y() * direction.y()) / squared,
                      2 * direction.x() * direction.y() / squared)
      .cast<float>();
}

void fit_tensor(RegionStencils& out, const Parameters& parameters) {
  const auto& x = out.plane.coordinates_m;
  std::vector<double> tensor_radius, near_radius;
  for (const double edge : sheet::local_edge_lengths_m<Vec2d>(*out.topology, x)) {
    tensor_radius.push_back(std::max(parameters.curvature_radius_m, parameters.curvature_radius_edges * edge));
    near_radius.push_back(kNearRadius * tensor_radius.back());
  }
  out.nodes = moment_nodes(out.plane, out.basis, parameters.curvature_radius_m / kCellsPerRadius);
  const PlanePoints vertices{x, out.plane.component};
  out.tensor = kernel(vertices, tensor_radius, out.nodes.points);
  out.near = kernel(vertices, near_radius, vertices);
  const std::size_t count = out.near.rows();
  out.near_start.assign(1, 0);
  for (std::size_t first = 0; first < count; first += RegionStencils::kNearLanes) {
    std::size_t longest = 0;
    for (std::size_t i = 0; i < RegionStencils::kNearLanes && first + i < count; ++i) {
      longest = std::max(longest, out.near.row(first + i).size());
    }
    for (std::size_t k = 0; k < longest; ++k) {
      auto& lanes = out.near_lanes.emplace_back();
      for (std::size_t i = 0; i < RegionStencils::kNearLanes; ++i) {
        const auto row = out.near.row(std::min(first + i, count - 1));
        lanes[i] = row.empty() ? 0 : row[std::min(k, row.size() - 1)].source;
      }
    }
    out.near_start.push_back(static_cast<std::uint32_t>(out.near_lanes.size()));
  }
  out.inverse.reserve(out.tensor.rows());
  for (std::size_t i = 0; i < out.tensor.rows(); ++i) {
    out.inverse.push_back(
        inverted_normal_matrix(normal_matrix_of(out.tensor.row(i), out.nodes.normal_matrix)).cast<float>());
  }
}

void prepare_ridges(RegionStencils& out, const Parameters& parameters) {
  PlanePoints centres{out.centres_m, {}};
  const auto edge_m = sheet::local_edge_lengths_m<Vec2d>(*out.topology, out.plane.coordinates_m);
  std::vector<double> radius;
  double widest = 0;
  for (std::size_t f = 0; f < out.centres_m.size(); ++f) {
    const Triangle& v = out.topology->triangles()[f];
    const double edge = (edge_m[v[0]] + edge_m[v[1]] + edge_m[v[2]]) / 3;
    const double width = std::max(parameters.ridge_width_m, parameters.ridge_width_edges * edge);
    centres.component.push_back(out.plane.component[v[0]]);
    radius.push_back(kRidgeRadiusPerWidth * width);
    out.ridge_width_m.push_back(static_cast<float>(width));
    widest = std::max(widest, width);
  }
  out.ridge = kernel(centres, radius, out.basis.midpoints);
  for (std::size_t f = 0; f < out.ridge.rows(); ++f) {
    double area = 0;
    for (const auto& [hinge, weight] : out.ridge.row(f)) area += static_cast<double>(weight) * out.basis.area_m2[hinge];
    out.ridge_scale.push_back(area > 0 ? static_cast<float>(1 / area) : 0.0f);
  }
  for (std::size_t k = 0; k < out.basis.hinges.size(); ++k) {
    const Vec2d& u = out.basis.along[k];
    const double length = out.basis.length_m[k];
    out.ridge_factor.push_back(
        Eigen::Array4d(length * u.y() * u.y(), -length * u.x() * u.y(), length * u.x() * u.x(), 0).cast<float>());
    const Eigen::Vector3d response = out.basis.crossing_m[k] / 2 * out.basis.response[k];
    out.hinge_response.push_back(Eigen::Array4d(response[0], response[1], response[2], 0).cast<float>());
  }
  for (const double area : out.nodes.area_m2)
    out.node_ridge_share.push_back(static_cast<float>(widest / std::max(area, 1e-30)));
}

void order_triangles(RegionStencils& out) {
  PlanePoints centres{out.centres_m, {}};
  for (const Triangle& t : out.topology->triangles()) centres.component.push_back(out.plane.component[t[0]]);
  out.order = along_hilbert_curve(centres);
  Eigen::AlignedBox2d box;
  for (const Vec2d& centre : out.centres_m) box.extend(centre);
  const Vec2d middle_m = box.isEmpty() ? Vec2d(Vec2d::Zero()) : box.center();
  for (const Vec2d& x : out.plane.coordinates_m) out.rest_m.push_back((x - middle_m).cast<float>());
}

void index_triangles(RegionStencils& out) {
  const auto triangles = out.topology->triangles();
  out.triangle_start.assign(out.topology->vertex_count() + 1, 0);
  for (const Triangle& t : triangles) {
    for (const std::uint32_t v : t) ++out.triangle_start[v + 1];
  }
  for (std::size_t v = 0; v < out.topology->vertex_count(); ++v) out.triangle_start[v + 1] += out.triangle_start[v];
  out.triangles_around.resize(out.triangle_start.back());
  std::vector<std::uint32_t> next(out.triangle_start.begin(), out.triangle_start.end() - 1);
  for (std::uint32_t f = 0; f < triangles.size(); ++f) {
    for (const std::uint32_t v : triangles[f]) out.triangles_around[next[v]++] = f;
  }
}

void link_sides(RegionStencils& out) {
  const auto& triangle_edges = out.topology->triangle_edges();
  const auto edges = out.topology->interior_edges();
  out.beyond.assign(3 * triangle_edges.size(), sheet::kNone);
  for (std::uint32_t f = 0; f < triangle_edges.size(); ++f) {
    for (std::size_t k = 0; k < 3; ++k) {
      const std::uint32_t edge = triangle_edges[f][k];
      if (edge == sheet::kNone) continue;
      const std::uint32_t other = edges[edge].left == f ? edges[edge].right : edges[edge].left;
      const auto& sides = triangle_edges[other];
      const auto there = static_cast<std::uint32_t>(std::find(sides.begin(), sides.end(), edge) - sides.begin());
      out.beyond[3 * f + k] = 3 * other + there;
    }
  }
}

void grow_tree(RegionStencils& out) {
  const auto edges = out.topology->interior_edges();
  const auto triangle_edges = out.topology->triangle_edges();
  std::vector<bool> reached(triangle_edges.size(), false), used(edges.size(), false);
  for (const std::uint32_t root : out.order) {
    if (reached[root]) continue;
    reached[root] = true;
    out.tree.push_back({root, sheet::kNone, sheet::kNone});
    for (std::size_t at = out.tree.size() - 1; at < out.tree.size(); ++at) {
      const std::uint32_t f = out.tree[at].triangle;
      for (const std::uint32_t k : triangle_edges[f]) {
        if (k == sheet::kNone) continue;
        const std::uint32_t g = edges[k].left == f ? edges[k].right : edges[k].left;
        if (reached[g]) continue;
        reached[g] = used[k] = true;
        out.tree.push_back({g, f, k});
      }
    }
  }
  for (std::uint32_t k = 0; k < edges.size(); ++k) {
    if (!used[k]) out.links.push_back(k);
  }
}

void link_border(RegionStencils& out) {
  const auto borders = out.topology->border_edges();
  std::vector<std::uint32_t> starting(out.topology->vertex_count(), sheet::kNone);
  for (std::uint32_t k = 0; k < borders.size(); ++k) starting[borders[k].start] = k;
  for (std::uint32_t k = 0; k < borders.size(); ++k) {
    const std::uint32_t next = starting[borders[k].end];
    if (next != sheet::kNone) out.border_neighbours.push_back({k, next});
  }
}

}  // namespace

RegionStencils region_stencils(std::shared_ptr<const sheet::Topology> topology, sheet::RestPlane plane,
                               const Parameters& parameters) {
  RegionStencils out;
  out.topology = std::move(topology);
  out.plane = std::move(plane);
  out.basis = hinge_basis(*out.topology, out.plane);
  const auto& x = out.plane.coordinates_m;
  for (const Triangle& v : out.topology->triangles()) {
    out.centres_m.push_back((x[v[0]] + x[v[1]] + x[v[2]]) / 3);
    out.edge_length_m.push_back(((x[v[0]] - x[v[1]]).norm() + (x[v[1]] - x[v[2]]).norm() + (x[v[2]] - x[v[0]]).norm()) / 3);
  }
  fit_tensor(out, parameters);
  prepare_ridges(out, parameters);
  order_triangles(out);
  index_triangles(out);
  link_sides(out);
  grow_tree(out);
  link_border(out);
  for (const auto& e : out.topology->interior_edges()) {
    const double distance = (out.centres_m[e.left] - out.centres_m[e.right]).norm();
    const double turn = parameters.ruling_agree_rad * std::max(1.0, distance / parameters.ruling_agree_m);
    out.agree_cosine.push_back(turn >= std::numbers::pi / 2 ? -2.0f : static_cast<float>(std::cos(2 * turn)));
  }
  for (const auto& e : out.topology->border_edges()) out.border_twice.push_back(twice(x[e.end] - x[e.start]));
  out.graded = out.topology->triangle_count() < 1333 && is_graded(out.edge_length_m);
  return out;
}

}  // namespace rustle::analysis
