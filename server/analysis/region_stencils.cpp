#include <algorithm>
#include <cmath>
#include <numbers>

#include "server/analysis/regions.h"

namespace rustle::analysis {
namespace {

// The marginal of (1-(d/r)²)² at its centre is 3.2/(π r): with r = 3.2/π · width a sharp fold of angle a peaks at a / width.
constexpr double kRidgeRadiusPerWidth = 3.2 / std::numbers::pi;
constexpr double kNearRadius = 0.75;  // of the tensor's
constexpr double kGradedRatio = 2.5;

bool is_graded(std::vector<double> lengths) {
  if (lengths.size() < 10) return false;
  std::sort(lengths.begin(), lengths.end());
  return lengths[lengths.size() * 19 / 20] > kGradedRatio * lengths[lengths.size() / 20];
}

void index_users(RegionStencils& out) {
  const std::size_t hinges = out.basis.hinges.size();
  out.tensor_user_start.assign(hinges + 1, 0);
  for (std::uint32_t h : out.tensor.source) ++out.tensor_user_start[h + 1];
  for (std::size_t h = 0; h < hinges; ++h) out.tensor_user_start[h + 1] += out.tensor_user_start[h];
  out.tensor_user.resize(out.tensor.source.size());
  out.tensor_user_weight.resize(out.tensor.source.size());
  std::vector<std::uint32_t> next(out.tensor_user_start.begin(), out.tensor_user_start.end() - 1);
  for (std::uint32_t f = 0; f < out.tensor.rows(); ++f) {
    for (std::uint32_t k = out.tensor.start[f]; k < out.tensor.start[f + 1]; ++k) {
      const std::uint32_t at = next[out.tensor.source[k]]++;
      out.tensor_user[at] = f;
      out.tensor_user_weight[at] = out.tensor.weight[k];
    }
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
  std::vector<double> tensor_radius, ridge_radius, near_radius;
  for (const sheet::Triangle& v : out.topology->triangles()) {
    out.centres.at_m.push_back((x[v[0]] + x[v[1]] + x[v[2]]) / 3);
    out.centres.component.push_back(out.plane.component[v[0]]);
    const double edge = ((x[v[0]] - x[v[1]]).norm() + (x[v[1]] - x[v[2]]).norm() + (x[v[2]] - x[v[0]]).norm()) / 3;
    out.edge_length_m.push_back(edge);
    tensor_radius.push_back(std::max(parameters.curvature_radius_m, parameters.curvature_radius_edges * edge));
    near_radius.push_back(kNearRadius * tensor_radius.back());
    out.ridge_width_m.push_back(std::max(parameters.ridge_width_m, parameters.ridge_width_edges * edge));
    ridge_radius.push_back(kRidgeRadiusPerWidth * out.ridge_width_m.back());
  }
  out.tensor = kernel(out.centres, tensor_radius, out.basis.midpoints);
  out.ridge = kernel(out.centres, ridge_radius, out.basis.midpoints);
  out.near = kernel(out.centres, near_radius, out.centres);
  for (std::size_t f = 0; f < out.tensor.rows(); ++f) {
    Eigen::Matrix3d normal_matrix = Eigen::Matrix3d::Zero();
    for (std::uint32_t k = out.tensor.start[f]; k < out.tensor.start[f + 1]; ++k) {
      const std::uint32_t h = out.tensor.source[k];
      normal_matrix += static_cast<double>(out.tensor.weight[k]) * out.basis.weight_m2[h] * out.basis.response[h] *
                       out.basis.response[h].transpose();
    }
    out.normal_matrix.push_back(normal_matrix);
    out.inverse.push_back(inverted_normal_matrix(normal_matrix).cast<float>());
  }
  index_users(out);
  out.graded = out.topology->triangle_count() < 1333 && is_graded(out.edge_length_m);
  return out;
}

}  // namespace rustle::analysis
