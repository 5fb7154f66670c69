#include <Eigen/Geometry>
#include <cmath>
#include <numbers>
#include <set>

#include <catch2/catch.hpp>

#include "meshes.h"
#include "server/sheet/face_geometry.h"
#include "server/sheet/point_grid.h"
#include "server/sheet/proxy.h"
#include "server/sheet/rest_plane.h"

namespace geometry_test {

using namespace rustle;
using sheet::Vec2d;
using sheet::Vec2f;
using sheet::Vec3d;
using sheet::Vec3f;

namespace {

double uniform(std::uint64_t i) {
  i = (i + 1) * 0x9e3779b97f4a7c15u;
  i = (i ^ (i >> 30)) * 0xbf58476d1ce4e5b9u;
  i = (i ^ (i >> 27)) * 0x94d049bb133111ebu;
  return static_cast<double>((i ^ (i >> 31)) >> 11) * 0x1.0p-53;
}

std::vector<sheet::Vec4f> padded(const std::vector<Vec3f>& points) {
  std::vector<sheet::Vec4f> out;
  sheet::relative_positions_m(points, Vec3f::Zero(), out);
  return out;
}

double cross(const Vec2d& a, const Vec2d& b) {
  return a.x() * b.y() - a.y() * b.x();
}

}  // namespace

TEST_CASE("the dihedral angle is that of the fold, signed, from flat to closed") {
  const auto t = test::topology(4, {{0, 1, 2}, {1, 0, 3}});
  const auto hinges = sheet::hinges(*t);
  REQUIRE(hinges.size() == 1);
  for (int degrees = -179; degrees <= 179; ++degrees) {
    const double fold = degrees * std::numbers::pi / 180;
    std::vector<Vec3f> p = {{0, 0, 0}, {0.01f, 0, 0}, {0.003f, 0.008f, 0}, {0.007f, 0, 0}};
    p[3].y() = static_cast<float>(-0.012 * std::cos(fold));
    p[3].z() = static_cast<float>(-0.012 * std::sin(fold));
    float angle = 99;
    sheet::dihedral_angles_rad(hinges, padded(p), std::span(&angle, 1));
    CHECK(static_cast<double>(angle) == Approx(fold).margin(2e-6));
  }
}

TEST_CASE("hinges without area or against each other are flat, never NaN") {
  const auto t = test::topology(5, {{0, 1, 2}, {1, 0, 3}, {1, 2, 4}, {2, 1, 0}});
  for (const auto& p : {std::vector<Vec3f>(5, Vec3f::Zero()), std::vector<Vec3f>(5, Vec3f(1, 2, 3))}) {
    const auto hinges = sheet::hinges(*t);
    std::vector<float> angles(hinges.size(), 1.0f);
    sheet::dihedral_angles_rad(hinges, padded(p), angles);
    for (float a : angles) CHECK(a == 0.0f);
    std::vector<float> areas;
    sheet::face_areas_m2(*t, padded(p), areas);
    REQUIRE(areas.size() == 4);
    for (const float a : areas) CHECK(a == 0.0f);
  }
}

TEST_CASE("mean and differences of positions are those in double, rounded once, for any count, far from the origin") {
  for (std::size_t count = 0; count < 23; ++count) {
    std::vector<Vec3f> points;
    Vec3d sum = Vec3d::Zero();
    for (std::uint64_t i = 0; i < count; ++i) {
      const Vec3d p(1000 + uniform(3 * i), uniform(3 * i + 1) - 2000, 0.1 * uniform(3 * i + 2));
      points.push_back(p.cast<float>());
      sum += points.back().cast<double>();
    }
    const Vec3f mean = sheet::mean_position_m(points);
    const auto expected = count > 0 ? Vec3d(sum / static_cast<double>(count)) : Vec3d(Vec3d::Zero());
    for (int d = 0; d < 3; ++d) CHECK(std::abs(mean[d] - expected.cast<float>()[d]) <= 1.3e-7f * std::abs(mean[d]));
    std::vector<sheet::Vec4f> relative;
    sheet::relative_positions_m(points, mean, relative);
    REQUIRE(relative.size() == count);
    for (std::size_t i = 0; i < count; ++i) {
      CHECK(relative[i].head<3>() == (points[i].cast<double>() - mean.cast<double>()).cast<float>());
      CHECK(relative[i].w() == 0);
    }
  }
}

TEST_CASE("dual areas sum to the area of the sheet") {
  const test::Grid grid(9, 7, 0.3f, 0.2f);
  const auto t = test::topology(grid.uv_m.size(), grid.triangles);
  std::vector<float> face_areas, areas;
  sheet::face_areas_m2(*t, padded(grid.mapped([](Vec2f p) { return Vec3f(p.x(), p.y(), 0); })), face_areas);
  sheet::vertex_areas_m2(*t, face_areas, areas);
  double sum = 0;
  for (float a : areas) sum += static_cast<double>(a);
  CHECK(sum == Approx(0.06).epsilon(1e-5));
}

TEST_CASE("the grid finds the neighbours that brute force finds") {
  std::vector<Vec3d> points;
  for (std::uint64_t i = 0; i < 400; ++i) points.emplace_back(uniform(3 * i), uniform(3 * i + 1), 0.02 * uniform(3 * i + 2));
  const sheet::PointGrid<3> grid(points, 0.05);
  for (std::uint64_t q = 0; q < 60; ++q) {
    const Vec3d centre(3 * uniform(5000 + q) - 1, 3 * uniform(6000 + q) - 1, uniform(7000 + q) - 0.5);
    std::uint32_t best = 0;
    std::set<std::uint32_t> near, found;
    for (std::uint32_t i = 0; i < points.size(); ++i) {
      if ((points[i] - centre).squaredNorm() < (points[best] - centre).squaredNorm()) best = i;
      if ((points[i] - centre).norm() <= 0.4) near.insert(i);
    }
    CHECK(grid.nearest(centre).index == best);
    grid.within(centre, 0.4, [&](std::uint32_t i, double) { found.insert(i); });
    CHECK(found == near);
  }
}

TEST_CASE("a sheet first seen bent is laid out with its own lengths") {
  const test::Grid grid(24, 16, 0.297f, 0.210f);
  const auto t = test::topology(grid.uv_m.size(), grid.triangles);
  const float radius = 0.06f;  // nearly three quarters of a full turn
  const auto plane = sheet::rest_plane(*t, grid.mapped([&](Vec2f p) { return test::rolled(p, radius); }));
  CHECK(plane.component_count == 1);
  CHECK(plane.distortion < 0.005);
  const Vec2d corner = plane.coordinates_m.back() - plane.coordinates_m.front();
  CHECK(corner.norm() == Approx(std::hypot(0.297, 0.210)).epsilon(0.01));
  for (const auto& v : t->triangles()) {
    const auto& x = plane.coordinates_m;
    CHECK(cross(x[v[1]] - x[v[0]], x[v[2]] - x[v[0]]) > 0);
  }
}

TEST_CASE("material coordinates are the layout; pieces are told apart") {
  test::Grid grid(3, 3, 0.1f, 0.1f);
  const auto n = static_cast<std::uint32_t>(grid.uv_m.size());
  auto triangles = grid.triangles;
  for (auto v : grid.triangles) triangles.push_back({v[0] + n, v[1] + n, v[2] + n});
  auto uv = grid.uv_m;
  uv.insert(uv.end(), grid.uv_m.begin(), grid.uv_m.end());
  const auto t = test::topology(2 * n, triangles, uv);
  const auto plane = sheet::rest_plane(*t, {});
  CHECK(plane.component_count == 2);
  CHECK(plane.component[0] != plane.component[n]);
  CHECK((plane.coordinates_m[5] - uv[5].cast<double>()).norm() == 0);
  CHECK_FALSE(sheet::coarse_proxy(*t, plane, 8).has_value());
}

TEST_CASE("the proxy of a fine sheet covers it with the triangles asked for") {
  const test::Grid grid(120, 90, 0.297f, 0.210f);
  const auto t = test::topology(grid.uv_m.size(), grid.triangles, grid.uv_m);
  const auto proxy = sheet::coarse_proxy(*t, sheet::rest_plane(*t, {}), 1333);
  REQUIRE(proxy.has_value());
  CHECK(proxy->topology->triangle_count() > 1000);
  CHECK(proxy->topology->triangle_count() < 2000);
  double area = 0;
  const auto x = proxy->topology->material_coordinates_m();
  for (const auto& v : proxy->topology->triangles())
    area += cross((x[v[1]] - x[v[0]]).cast<double>(), (x[v[2]] - x[v[0]]).cast<double>()) / 2;
  CHECK(area == Approx(0.297 * 0.210).epsilon(1e-3));
  for (std::uint32_t i = 0; i < grid.uv_m.size(); ++i) {
    CHECK((grid.uv_m[proxy->vertices[proxy->nearest[i]]] - grid.uv_m[i]).norm() < 0.015f);
  }
}

TEST_CASE("a hole stays open in the proxy, and a crack makes none") {
  test::Grid grid(100, 100, 0.2f, 0.2f);
  auto holed = grid.triangles;
  std::erase_if(holed, [&](const sheet::Triangle& v) {
    const Vec2f c = (grid.uv_m[v[0]] + grid.uv_m[v[1]] + grid.uv_m[v[2]]) / 3.0f;
    return std::fabs(c.x() - 0.1f) < 0.05f && std::fabs(c.y() - 0.1f) < 0.05f;
  });
  const auto t = test::topology(grid.uv_m.size(), holed, grid.uv_m);
  const auto proxy = sheet::coarse_proxy(*t, sheet::rest_plane(*t, {}), 1333);
  REQUIRE(proxy.has_value());
  double border = 0;
  const auto x = proxy->topology->material_coordinates_m();
  for (const auto& e : proxy->topology->border_edges()) border += static_cast<double>((x[e.start] - x[e.end]).norm());
  CHECK(border == Approx(0.8 + 0.4).epsilon(0.01));

  // the vertices of a line from the middle to the border are doubled for the triangles above it
  auto cut = grid.triangles;
  auto uv = grid.uv_m;
  for (std::uint32_t i = 51; i <= 100; ++i) {
    const std::uint32_t old = 50 * 101 + i, twin = static_cast<std::uint32_t>(uv.size());
    uv.push_back(uv[old]);
    for (auto& v : cut) {
      const float y = (grid.uv_m[v[0] < 10201 ? v[0] : old].y() + grid.uv_m[v[1] < 10201 ? v[1] : old].y() +
                       grid.uv_m[v[2] < 10201 ? v[2] : old].y()) /
                      3;
      for (auto& k : v) {
        if (k == old && y > 0.1f) k = twin;
      }
    }
  }
  const auto cracked = test::topology(uv.size(), cut, uv);
  CHECK(cracked->border_edges().size() == 400 + 100);
  CHECK_FALSE(sheet::coarse_proxy(*cracked, sheet::rest_plane(*cracked, {}), 1333).has_value());
}

}  // namespace geometry_test
