#include "server/analysis/plane_lattice.h"

#include <algorithm>
#include <cmath>

#include <catch2/catch.hpp>

#include "moving_sheet.h"
#include "server/analysis/curvature.h"

namespace plane_lattice_test {

using namespace rustle;

namespace {

/// H of every vertex from the sum over all nodes within its radius.
std::vector<double> summed_directly(const analysis::CurvatureStencils& stencils,
                                    const std::vector<analysis::Moment>& moments) {
  const analysis::PlanePoints vertices{stencils.plane.coordinates_m, stencils.plane.component};
  const analysis::Stencil rows = analysis::kernel(vertices, stencils.radius_m, stencils.nodes.points);
  std::vector<double> out;
  for (std::size_t i = 0; i < rows.rows(); ++i) {
    Eigen::Matrix3d normal = Eigen::Matrix3d::Zero();
    Eigen::Vector3d told = Eigen::Vector3d::Zero();
    for (const auto& [node, weight] : rows.row(i)) {
      normal += static_cast<double>(weight) * stencils.nodes.normal_matrix[node];
      told += static_cast<double>(weight) * moments[node].head<3>().matrix().cast<double>();
    }
    const Eigen::Vector3d tensor = analysis::inverted_normal_matrix(normal) * told;
    out.push_back((tensor[0] + tensor[2]) / 2);
  }
  return out;
}

}  // namespace

TEST_CASE("on a fine mesh H is told from a lattice as well as from every vertex's own sum") {
  const auto mesh = sheets::make_rectangle(sheets::MeshKind::kDelaunay, 0.15, 0.12, 40000);
  const auto topology = test::topology_of(mesh);
  const auto stencils = analysis::curvature_stencils(topology, sheet::rest_plane(*topology, {}), {});
  REQUIRE_FALSE(stencils.lattice.places.empty());
  CHECK(stencils.targets.size() < topology->vertex_count() / 2);

  const double wave_per_m = 2 * M_PI / 0.06;
  const auto frame = test::frame_of(mesh, topology, [=](double u, double v) {
    return sheet::Vec3d(u, v, 1e-4 * std::sin(wave_per_m * u) * std::cos(wave_per_m * v));
  });
  std::vector<sheet::Vec4f> relative;
  sheet::relative_positions_m(frame.positions_m, sheet::mean_position_m(frame.positions_m), relative);
  std::vector<float> angles(stencils.hinges.size());
  sheet::dihedral_angles_rad(stencils.hinges, relative, angles);
  analysis::Curvature curvature;
  analysis::measure_curvature(stencils, angles, curvature);
  const std::vector<double> direct = summed_directly(stencils, curvature.moments);
  REQUIRE(curvature.mean_per_m.size() == direct.size());
  double largest = 0, worst = 0;
  for (std::size_t i = 0; i < direct.size(); ++i) {
    largest = std::max(largest, std::abs(direct[i]));
    worst = std::max(worst, std::abs(direct[i] - static_cast<double>(curvature.mean_per_m[i])));
  }
  CHECK(largest > 0.5);
  CHECK(worst < 0.02 * largest);
}

TEST_CASE("a lattice carries linear fields exactly, and keeps pieces and wider kernels apart") {
  analysis::PlanePoints vertices;
  std::vector<double> radii;
  for (int i = 0; i < 400; ++i) {
    vertices.at_m.push_back({0.0007 * (i % 20) - 0.003, 0.0011 * (i / 20)});
    vertices.component.push_back(i % 2);
    radii.push_back(i % 7 == 0 ? 0.02 : 0.01);
  }
  const auto lattice = analysis::plane_lattice(vertices, radii, 0.01, 0.0025);
  std::vector<float> a, b;
  for (std::size_t p = 0; p < lattice.radius_m.size(); ++p) {
    a.push_back(static_cast<float>(3 * lattice.points.at_m[p].x() - 2 * lattice.points.at_m[p].y() + 1));
    b.push_back(static_cast<float>(lattice.points.component[p]));
  }
  std::vector<float> at_a(400), at_b(400);
  analysis::interpolate(lattice, a, b, at_a, at_b);
  for (std::size_t i = 0; i < 400; ++i) {
    CAPTURE(i);
    CHECK(at_a[i] == Approx(3 * vertices.at_m[i].x() - 2 * vertices.at_m[i].y() + 1).epsilon(1e-5));
    CHECK(at_b[i] == Approx(vertices.component[i]));
    CHECK(lattice.radius_m[lattice.places[i].point[0]] == radii[i]);
  }
}

}  // namespace plane_lattice_test
