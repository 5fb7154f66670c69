#include "server/analysis/curvature.h"

#include <algorithm>

#include <catch2/catch.hpp>

#include "moving_sheet.h"

namespace curvature_test {

using namespace rustle;
using sheets::MeshKind;

namespace {

std::vector<float> curvature_of(const analysis::CurvatureStencils& stencils, const sheet::MeshFrame& frame) {
  std::vector<sheet::Vec4f> relative;
  sheet::relative_positions_m(frame.positions_m, sheet::mean_position_m(frame.positions_m), relative);
  std::vector<float> angles(stencils.hinges.size());
  sheet::dihedral_angles_rad(stencils.hinges, relative, angles);
  analysis::Curvature curvature;
  analysis::measure_curvature(stencils, angles, curvature);
  return curvature.mean_per_m;
}

double worst(const std::vector<float>& values, double expected) {
  double out = 0;
  for (float v : values) out = std::max(out, std::abs(static_cast<double>(v) - expected));
  return out;
}

}  // namespace

TEST_CASE("H of a cylinder is half its curvature at every vertex, size, triangulation and rest shape") {
  const analysis::Parameters parameters;
  for (MeshKind kind : {MeshKind::kStructured, MeshKind::kDelaunay, MeshKind::kGraded}) {
    for (std::size_t triangles : {446, 1333, 20000}) {
      for (bool material : {true, false}) {
        const auto mesh = sheets::make_rectangle(kind, 0.297, 0.210, triangles);
        const auto topology = test::topology_of(mesh, material);
        for (double curvature : {5.0, -9.0}) {
          const auto frame = test::frame_of(mesh, topology, test::arc(curvature));
          const auto stencils =
              analysis::curvature_stencils(topology, sheet::rest_plane(*topology, frame.positions_m), parameters);
          CAPTURE(static_cast<int>(kind), triangles, material, curvature);
          CHECK(worst(curvature_of(stencils, frame), curvature / 2) < 0.05 * std::abs(curvature / 2));
        }
      }
    }
  }
}

TEST_CASE("H does not depend on where the sheet is, and changes sign with its orientation") {
  const auto mesh = sheets::make_rectangle(MeshKind::kDelaunay, 0.297, 0.210, 1333);
  const auto topology = test::topology_of(mesh);
  const auto stencils = analysis::curvature_stencils(topology, sheet::rest_plane(*topology, {}), {});
  const Eigen::Quaterniond turn(Eigen::AngleAxisd(1.1, sheet::Vec3d(1, 2, -1).normalized()));
  const auto h = curvature_of(stencils, test::frame_of(mesh, topology, test::moved(test::arc(6), turn, {7, -6, 4})));
  CHECK(worst(h, 3) < 0.15);
  auto flipped = mesh;
  for (auto& t : flipped.triangles) std::swap(t[1], t[2]);
  const auto other = test::topology_of(flipped);
  const auto other_stencils = analysis::curvature_stencils(other, sheet::rest_plane(*other, {}), {});
  CHECK(worst(curvature_of(other_stencils, test::frame_of(flipped, other, test::arc(6))), -3) < 0.15);
}

TEST_CASE("local bending of a cylinder is of the order of its curvature") {
  const auto mesh = sheets::make_rectangle(MeshKind::kDelaunay, 0.297, 0.210, 1333);
  const auto topology = test::topology_of(mesh);
  const auto stencils = analysis::curvature_stencils(topology, sheet::rest_plane(*topology, {}), {});
  const auto frame = test::frame_of(mesh, topology, test::arc(8));
  std::vector<float> angles(stencils.hinges.size());
  std::vector<sheet::Vec4f> relative;
  sheet::relative_positions_m(frame.positions_m, sheet::mean_position_m(frame.positions_m), relative);
  sheet::dihedral_angles_rad(stencils.hinges, relative, angles);
  analysis::Curvature curvature;
  analysis::measure_curvature(stencils, angles, curvature);
  double mean = 0;
  for (const float k : curvature.bending_per_m) mean += static_cast<double>(k);
  mean /= static_cast<double>(frame.positions_m.size());
  CHECK(mean > 3.6);
  CHECK(mean < 8.0);  // hinges of either sign count, those along the rulings add noise
}

}  // namespace curvature_test
