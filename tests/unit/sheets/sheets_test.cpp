#include <cmath>
#include <cstring>
#include <map>
#include <numeric>

#include <catch2/catch.hpp>

#include "client_sdk/sheets/delaunay.h"
#include "client_sdk/sheets/demos.h"
#include "client_sdk/sheets/motions.h"

namespace sheets_test {

namespace {

using namespace rustle::sheets;

double area_of(const SheetMesh& mesh) {
  double area = 0;
  for (const auto& t : mesh.triangles) {
    const auto& a = mesh.material_coordinates[t[0]];
    const auto& b = mesh.material_coordinates[t[1]];
    const auto& c = mesh.material_coordinates[t[2]];
    const double twice = (static_cast<double>(b[0]) - a[0]) * (static_cast<double>(c[1]) - a[1]) -
                         (static_cast<double>(b[1]) - a[1]) * (static_cast<double>(c[0]) - a[0]);
    CHECK(twice > 0);
    area += twice / 2;
  }
  return area;
}

std::map<std::pair<std::uint32_t, std::uint32_t>, int> edges_of(const std::vector<std::array<std::uint32_t, 3>>& triangles) {
  std::map<std::pair<std::uint32_t, std::uint32_t>, int> edges;
  for (const auto& t : triangles) {
    for (std::size_t k = 0; k < 3; ++k) ++edges[std::minmax(t[k], t[(k + 1) % 3])];
  }
  return edges;
}

std::vector<float> positions_at(const AnimatedSheet& sheet, double time_s) {
  std::vector<float> xyz(3 * sheet.mesh().material_coordinates.size());
  sheet.positions(time_s, xyz);
  return xyz;
}

double distance(const std::vector<float>& xyz, std::uint32_t a, std::uint32_t b) {
  double sum = 0;
  for (std::size_t k = 0; k < 3; ++k) {
    const double d = static_cast<double>(xyz[3 * a + k]) - static_cast<double>(xyz[3 * b + k]);
    sum += d * d;
  }
  return std::sqrt(sum);
}

/// The greatest relative change of an edge's length from the material plane to space.
double worst_strain(const SheetMesh& mesh, const std::vector<float>& xyz) {
  double worst = 0;
  for (const auto& [edge, count] : edges_of(mesh.triangles)) {
    const auto& a = mesh.material_coordinates[edge.first];
    const auto& b = mesh.material_coordinates[edge.second];
    const double rest = std::hypot(static_cast<double>(a[0]) - b[0], static_cast<double>(a[1]) - b[1]);
    worst = std::max(worst, std::abs(distance(xyz, edge.first, edge.second) / rest - 1));
  }
  return worst;
}

}  // namespace

TEST_CASE("Random points are triangulated so that no point lies in a circumcircle", "[delaunay]") {
  std::uint64_t state = 7;
  const auto unit = [&] {
    state = state * 6364136223846793005u + 1442695040888963407u;
    return static_cast<double>(state >> 40) / static_cast<double>(1u << 24);
  };
  std::vector<std::array<double, 2>> points;
  for (int k = 0; k < 400; ++k) {
    const double x = unit();
    points.push_back({x, unit()});
  }
  const auto triangles = delaunay(points);
  for (const auto& t : triangles) {
    const auto &a = points[t[0]], &b = points[t[1]], &c = points[t[2]];
    for (const auto& d : points) {
      const double ax = a[0] - d[0], ay = a[1] - d[1], bx = b[0] - d[0], by = b[1] - d[1], cx = c[0] - d[0],
                   cy = c[1] - d[1];
      const double inside = (ax * ax + ay * ay) * (bx * cy - by * cx) + (bx * bx + by * by) * (cx * ay - cy * ax) +
                            (cx * cx + cy * cy) * (ax * by - ay * bx);
      REQUIRE(inside < 1e-7);
    }
  }
  std::size_t border = 0;
  for (const auto& [edge, count] : edges_of(triangles)) {
    CHECK(count <= 2);
    border += count == 1 ? 1 : 0;
  }
  CHECK(triangles.size() == 2 * points.size() - 2 - border);
}

TEST_CASE("Grids, repeated points and lines are triangulated or refused", "[delaunay]") {
  std::vector<std::array<double, 2>> grid;
  for (int j = 0; j < 30; ++j) {
    for (int i = 0; i < 30; ++i) grid.push_back({0.01 * i, 0.01 * j});
  }
  CHECK(delaunay(grid).size() == 2 * 29 * 29);
  grid.insert(grid.end(), grid.begin(), grid.begin() + 100);
  CHECK(delaunay(grid).size() == 2 * 29 * 29);
  std::vector<std::array<double, 2>> line;
  for (int i = 0; i < 10; ++i) line.push_back({0.1 * i, 0.1 * i});
  CHECK(delaunay(line).empty());
  CHECK(delaunay(std::vector<std::array<double, 2>>{{0, 0}, {1, 1}}).empty());
  CHECK(delaunay(std::vector<std::array<double, 2>>(5, {1, 1})).empty());
}

TEST_CASE("Rectangles are covered by about as many triangles as asked for", "[rectangle]") {
  for (const MeshKind kind : {MeshKind::kStructured, MeshKind::kDelaunay, MeshKind::kGraded}) {
    for (const std::size_t wanted : {183u, 446u, 1333u, 20000u}) {
      const SheetMesh mesh = make_rectangle(kind, 0.297, 0.210, wanted, 3);
      INFO(static_cast<int>(kind) << ": " << mesh.triangles.size() << " of " << wanted);
      CHECK(area_of(mesh) == Approx(0.297 * 0.210).epsilon(1e-5));
      const double share = static_cast<double>(mesh.triangles.size()) / static_cast<double>(wanted);
      CHECK(std::abs(share - 1) <= (kind == MeshKind::kStructured ? 0.12 : 0.0));
      std::vector<bool> used(mesh.material_coordinates.size(), false);
      for (const auto& t : mesh.triangles) {
        for (const auto v : t) used[v] = true;
      }
      CHECK(std::count(used.begin(), used.end(), false) == 0);
    }
  }
  const SheetMesh a = make_rectangle(MeshKind::kDelaunay, 0.3, 0.2, 500, 1);
  CHECK(a.triangles == make_rectangle(MeshKind::kDelaunay, 0.3, 0.2, 500, 1).triangles);
  CHECK(a.triangles != make_rectangle(MeshKind::kDelaunay, 0.3, 0.2, 500, 2).triangles);
}

TEST_CASE("A graded rectangle has four times longer edges on its right", "[rectangle]") {
  const SheetMesh mesh = make_rectangle(MeshKind::kGraded, 0.297, 0.210, 5000, 1);
  double left = 0, right = 0;
  int lefts = 0, rights = 0;
  for (const auto& [edge, count] : edges_of(mesh.triangles)) {
    const auto& a = mesh.material_coordinates[edge.first];
    const auto& b = mesh.material_coordinates[edge.second];
    const double length = std::hypot(static_cast<double>(a[0]) - b[0], static_cast<double>(a[1]) - b[1]);
    if (a[0] < 0.015f) left += length, ++lefts;
    if (a[0] > 0.282f) right += length, ++rights;
  }
  CHECK(right / rights / (left / lefts) == Approx(4.0 * 0.925 / 1.04).epsilon(0.15));
}

TEST_CASE("Every shape of the zoo keeps lengths and bends as it says", "[shape]") {
  CHECK(shape_zoo().size() == 16);
  CHECK(find_shape("cone") != nullptr);
  CHECK(find_shape("sphere") == nullptr);
  for (const NamedShape& named : shape_zoo()) {
    INFO(named.name);
    const double step = 1e-4;
    for (double u = 0.021; u < named.width_m - 0.01; u += named.width_m / 7) {
      for (double v = 0.013; v < named.height_m - 0.01; v += named.height_m / 5) {
        const Point3 p = named.shape->at(u, v);
        for (const auto& [du, dv] : {std::pair{step, 0.0}, {0.0, step}, {step / 2, step / 2}}) {
          const Point3 q = named.shape->at(u + du, v + dv);
          CHECK(std::hypot(q[0] - p[0], q[1] - p[1], q[2] - p[2]) == Approx(std::hypot(du, dv)).epsilon(2e-3));
        }
        // Laplacian in the material plane = (trace of the curvature) times the normal, for a developable surface.
        const double h = 1e-3;
        const Point3 e = named.shape->at(u + h, v), w = named.shape->at(u - h, v);
        const Point3 n = named.shape->at(u, v + h), s = named.shape->at(u, v - h);
        const double x[3] = {(e[0] - w[0]) / (2 * h), (e[1] - w[1]) / (2 * h), (e[2] - w[2]) / (2 * h)};
        const double y[3] = {(n[0] - s[0]) / (2 * h), (n[1] - s[1]) / (2 * h), (n[2] - s[2]) / (2 * h)};
        const double normal[3] = {x[1] * y[2] - x[2] * y[1], x[2] * y[0] - x[0] * y[2], x[0] * y[1] - x[1] * y[0]};
        double trace = 0;
        for (std::size_t k = 0; k < 3; ++k) trace -= (e[k] + w[k] + n[k] + s[k] - 4 * p[k]) / (h * h) * normal[k];
        const bool smooth = std::abs(named.shape->curvature_per_m(u + 2 * h, v) - named.shape->curvature_per_m(u, v)) < 1 &&
                            std::abs(named.shape->curvature_per_m(u - 2 * h, v) - named.shape->curvature_per_m(u, v)) < 1;
        const bool has_ridge = named.name.find("ridge") != std::string::npos;
        if (smooth && !has_ridge && named.name != "folded" && named.name != "fold3mm" && named.name != "dogear") {
          CHECK(trace == Approx(named.shape->curvature_per_m(u, v)).margin(0.1).epsilon(0.02));
        }
      }
    }
  }
  CHECK(2 * std::sin(0.297 / 2 / radius_from_compression_m(0.297, 0.3)) * radius_from_compression_m(0.297, 0.3) ==
        Approx(0.7 * 0.297));
}

TEST_CASE("A reversal is straight at its zero moment and opposite on either side", "[motions]") {
  ReversalOptions options;
  const auto sheet = make_reversal(make_rectangle(MeshKind::kDelaunay, 0.297, 0.21, 446), options);
  CHECK(options.curvature_at_per_m(0) == options.curvature_per_m);
  CHECK(options.curvature_at_per_m(options.zero_time_s()) == Approx(0).margin(1e-12));
  CHECK(options.curvature_at_per_m(9) == -options.curvature_per_m);
  const auto flat = positions_at(*sheet, options.zero_time_s());
  const auto before = positions_at(*sheet, options.zero_time_s() - 0.03);
  const auto after = positions_at(*sheet, options.zero_time_s() + 0.03);
  for (std::size_t i = 2; i < flat.size(); i += 3) {
    CHECK(std::abs(flat[i]) < 1e-7f);
    CHECK(before[i] == Approx(-after[i]).margin(1e-7));
  }
}

TEST_CASE("A slide travels the integral of its speed and stays on the table", "[motions]") {
  SlideOptions options;
  options.duration_s = 0.8;
  for (const double curvature : {0.0, 6.0, -6.0}) {
    options.curvature_per_m = curvature;
    const auto sheet = make_slide(make_rectangle(MeshKind::kStructured, 0.297, 0.21, 5000), options);
    const auto start = positions_at(*sheet, 0);
    for (const double t : {0.05, 0.3, 0.75, 0.8}) {
      const auto now = positions_at(*sheet, t);
      double travelled = 0;
      for (int k = 0; k < 10000; ++k) travelled += options.speed_at_m_per_s(t * (k + 0.5) / 10000) * t / 10000;
      CHECK(static_cast<double>(now[0]) - static_cast<double>(start[0]) == Approx(travelled).margin(1e-6));
      float lowest = 1;
      for (std::size_t i = 2; i < now.size(); i += 3) lowest = std::min(lowest, now[i]);
      CHECK(lowest == Approx(0.0).margin(1e-4));
    }
  }
}

TEST_CASE("Rigid motion keeps all distances", "[motions]") {
  const NamedShape* cone = find_shape("cone");
  RigidMotionOptions options;
  options.velocity_m_per_s = {0.3, -0.2, 0.1};
  options.angular_velocity_rad_per_s = {2, 1, -3};
  const auto sheet = make_rigid_motion(make_rectangle(MeshKind::kDelaunay, 0.297, 0.21, 183), cone->shape, options);
  const auto a = positions_at(*sheet, 0);
  const auto b = positions_at(*sheet, 0.7);
  const auto count = static_cast<std::uint32_t>(sheet->mesh().material_coordinates.size());
  for (std::uint32_t i = 1; i < count; ++i) CHECK(distance(a, 0, i) == Approx(distance(b, 0, i)).margin(1e-6));
}

TEST_CASE("The wave reverses the bend of every place but the held border", "[motions]") {
  const WaveOptions wave;
  for (const double s : {0.1, 0.2, 0.29}) {
    int reversals = 0;
    double last = 0;
    for (double t = wave.start_s + wave.ramp_s; t < wave.end_s; t += 0.001) {
      const double now = wave_curvature_per_m(wave, 0.297, s, t);
      if (now * last < 0) ++reversals;
      last = now;
    }
    CHECK(reversals == Approx(2 * wave.frequency_hz * (wave.end_s - wave.start_s - wave.ramp_s)).margin(1));
  }
  CHECK(wave_curvature_per_m(wave, 0.297, 0.0, 1.0) == 0);
}

TEST_CASE("Every demo keeps lengths within 1 %, moves continuously and never sinks into its table", "[demos]") {
  CHECK(make_demo("dance") == nullptr);
  for (const std::string_view name : demo_names()) {
    const auto sheet = make_demo(name);
    REQUIRE(sheet);
    INFO(name);
    CHECK(sheet->mesh().triangles.size() == Approx(1333).epsilon(0.02));
    auto before = positions_at(*sheet, 0);
    double fastest = 0;
    const double step = 1.0 / 240;
    for (double t = step; t < sheet->duration_s(); t += step) {
      const auto now = positions_at(*sheet, t);
      float lowest = 1;
      for (std::size_t i = 0; i < now.size(); i += 3) {
        const double speed =
            std::hypot(static_cast<double>(now[i]) - before[i], static_cast<double>(now[i + 1]) - before[i + 1],
                       static_cast<double>(now[i + 2]) - before[i + 2]) /
            step;
        fastest = std::max(fastest, speed);
        lowest = std::min(lowest, now[i + 2]);
      }
      REQUIRE(lowest > -1e-4f);
      before = now;
    }
    CHECK(fastest > 0.1);
    CHECK(fastest < 10);
    for (double t = 0; t < sheet->duration_s(); t += 0.05) {
      INFO(t);
      REQUIRE(worst_strain(sheet->mesh(), positions_at(*sheet, t)) < 0.01);
    }
    const auto once = positions_at(*sheet, 1.2345);
    const auto again = positions_at(*make_demo(name), 1.2345);
    CHECK(std::memcmp(once.data(), again.data(), once.size() * sizeof(float)) == 0);
  }
}

TEST_CASE("The whole demo holds, releases and lifts its edges", "[demos]") {
  const auto sheet = make_demo("bend_slide_snap_shake");
  CHECK(sheet->duration_s() >= 6);
  CHECK(sheet->duration_s() <= 8);
  CHECK(sheet->on_table());
  std::vector<std::uint8_t> mask(sheet->mesh().material_coordinates.size());
  sheet->anchored(1.0, mask);
  const int held_before = std::accumulate(mask.begin(), mask.end(), 0);
  sheet->anchored(3.5, mask);
  const int held_after = std::accumulate(mask.begin(), mask.end(), 0);
  CHECK(held_after > 0);
  CHECK(held_before > held_after);
  const auto front_is_still = [&](double from_s, double to_s) {
    const auto a = positions_at(*sheet, from_s);
    const auto b = positions_at(*sheet, to_s);
    double moved = 0;
    for (std::size_t i = 0; i < mask.size(); ++i) {
      if (mask[i]) moved = std::max(moved, std::abs(static_cast<double>(a[3 * i]) - static_cast<double>(b[3 * i])));
    }
    return moved < 1e-5;
  };
  CHECK_FALSE(front_is_still(0.4, 1.5));  // it slides toward the back edge
  CHECK(front_is_still(3.1, 3.8));        // the sheet stands up on it
}

}  // namespace sheets_test
