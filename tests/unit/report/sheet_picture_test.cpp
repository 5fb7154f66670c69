#include "server/report/sheet_picture.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <numbers>

#include <catch2/catch.hpp>

#include "server/report/obstacle_wires.h"
#include "tests/unit/report/synthetic_input.h"

namespace rustle::report::sheet_picture_test {
namespace {

std::size_t pixels_of(const Image& image, const Colour& colour) {
  return static_cast<std::size_t>(std::count(image.pixels.begin(), image.pixels.end(), pixel_of(colour)));
}

}  // namespace

TEST_CASE("the picture has its size and shows both regions in their colours") {
  const SheetView view = rolled_sheet(31, 22);
  const Image image = sheet_picture(view);
  CHECK(image.width == 1400);
  CHECK(image.height == 860);
  const std::vector<int> categories = region_categories(view);
  REQUIRE(categories.size() == 2);
  CHECK(categories[0] != categories[1]);
  const std::size_t left = pixels_of(image, category_colour(categories[0])),
                    right = pixels_of(image, category_colour(categories[1]));
  CHECK(left > 5000);
  CHECK(right > 5000);
  CHECK(image.pixels == sheet_picture(view).pixels);
}

TEST_CASE("neighbouring regions differ in colour, whatever their numbers") {
  SheetView view = rolled_sheet(36, 36);
  for (std::size_t t = 0; t < view.triangles.size(); ++t) {
    const std::size_t cell = t / 2, i = cell % 36 / 3, j = cell / 36 / 3;
    view.triangle_regions[t] = static_cast<std::uint32_t>(12 * (i + 12 * j) % 1440 / 12 * 12 % 144 + (i + j) % 12);
  }
  const std::vector<int> categories = region_categories(view);
  std::map<std::pair<std::uint32_t, std::uint32_t>, std::vector<std::uint32_t>> edges;
  for (std::size_t t = 0; t < view.triangles.size(); ++t) {
    for (std::size_t k = 0; k < 3; ++k) {
      edges[std::minmax({view.triangles[t][k], view.triangles[t][(k + 1) % 3]})].push_back(view.triangle_regions[t]);
    }
  }
  for (const auto& [edge, regions] : edges) {
    if (regions.size() == 2 && regions[0] != regions[1]) CHECK(categories[regions[0]] != categories[regions[1]]);
  }
}

TEST_CASE("nearer parts hide farther ones") {
  SheetView view;
  for (const float z : {0.0f, 0.1f}) {
    for (const auto& [x, y] : {std::pair{0.0f, 0.0f}, {1.0f, 0.0f}, {1.0f, 1.0f}, {0.0f, 1.0f}})
      view.positions_m.push_back({x, y, z});
  }
  view.triangles = {{4, 5, 6}, {4, 6, 7}, {0, 1, 2}, {0, 2, 3}};
  view.triangle_regions = {0, 0, 1, 1};
  const auto seen = [&](double elevation_deg) {
    ImageCanvas canvas(1400, 860, light_theme());
    draw_sheet(canvas, {0, 0, 1400, 860}, view, ViewDirection{-90, elevation_deg});
    const std::uint32_t pixel = canvas.pixels().pixels[430 * 1400 + 460];
    const std::vector<int> categories = region_categories(view);
    const auto distance = [&](int category) {
      const std::uint32_t other = pixel_of(category_colour(category));
      double sum = 0;
      for (int shift = 0; shift < 24; shift += 8)
        sum += std::abs(double((pixel >> shift) & 0xff) - double((other >> shift) & 0xff));
      return sum;
    };
    return distance(categories[0]) < distance(categories[1]) ? 0 : 1;
  };
  CHECK(seen(90) == 0);
  CHECK(seen(-90) == 1);
}

TEST_CASE("best_view looks at a standing sheet from its broad side") {
  SheetView view;
  view.positions_m = {{0, 0, 0}, {0, 1, 0}, {0, 1, 1}, {0, 0, 1}};
  view.triangles = {{0, 1, 2}, {0, 2, 3}};
  const double azimuth = best_view(std::span(&view, 1), {90, 30}).azimuth_deg;
  CHECK(std::abs(std::cos(azimuth * std::numbers::pi / 180)) == Approx(1));
}

TEST_CASE("marks appear when given and only then") {
  SheetView view = rolled_sheet(31, 22);
  const Image plain = sheet_picture(view);
  const auto differs = [&](const SheetView& changed) { return sheet_picture(changed).pixels != plain.pixels; };
  SheetView v = view;
  v.ridge_triangles.assign(v.triangles.size(), false);
  v.ridge_triangles[100] = true;
  CHECK(differs(v));
  v = view;
  v.rulings_m = {{{0, 0, 0}, {0, 0.2, 0}}};
  CHECK(differs(v));
  v = view;
  v.ruling_directions.assign(v.triangles.size(), {0, 1, 0});
  CHECK(differs(v));
  v = view;
  v.borders = {{0, 1, 1.0}};
  CHECK(differs(v));
  v = view;
  v.contacts = {{{0.1, 0.1, 0.2}, std::nullopt, true}};
  CHECK(differs(v));
  const Image sliding = sheet_picture(v);
  v.contacts[0].sliding = false;
  CHECK(differs(v));
  CHECK(sheet_picture(v).pixels != sliding.pixels);
  v = view;
  v.resonators = {{false, false, 0.21, 0.3, 0.03}, {true, false, 0, 0, 0.03}};
  CHECK(differs(v));
  const Image exact = sheet_picture(v);
  v.resonators[0].coarse = true;
  CHECK(sheet_picture(v).pixels != exact.pixels);
  v = view;
  v.anchored.assign(v.positions_m.size(), false);
  v.anchored[0] = true;
  CHECK(differs(v));
  v = view;
  v.events = {crumple(1, 0, 0.1)};
  CHECK(differs(v));
  v = view;
  v.listener_m = Vec3d(0, -1, 1);
  CHECK(differs(v));
  v = view;
  v.obstacles.push_back({});
  CHECK(differs(v));
}

TEST_CASE("no sheet, indices that do not exist and points that are not finite come through") {
  CHECK(sheet_picture({}).width == 1400);
  SheetView view = rolled_sheet(6, 4);
  view.positions_m[3].x() = std::numeric_limits<float>::quiet_NaN();
  view.triangles.push_back({0, 1, 999});
  view.triangle_regions.push_back(77777777);
  view.triangle_regions[0] = sheet::kNone;
  view.borders = {{0, 999, 1}};
  view.contacts = {{Vec3d::Constant(std::numeric_limits<double>::quiet_NaN()), std::nullopt, true}};
  view.resonators.assign(3, {});
  view.region_colours = {3, 4};
  view.anchored.assign(500, true);
  view.ridge_edges = {{999, 0}};
  view.rulings_m = {{{0, 0, 0}, {std::numeric_limits<double>::infinity(), 0, 0}}};
  view.curvature_per_m[2] = std::numeric_limits<float>::quiet_NaN();
  view.curvature_per_m.push_back(1);
  EventMark lost = crumple(1, 0, 0.1);
  lost.position_m.setConstant(std::numeric_limits<double>::quiet_NaN());
  view.events = {lost};
  view.listener_m = Vec3d::Constant(std::numeric_limits<double>::quiet_NaN());
  CHECK(sheet_picture(view).height == 860);
  view.material_coordinates_m.clear();
  CHECK(sheet_picture(view, {700, 400, 1, true}).width == 700);
  const auto refused = write_sheet_png("/nowhere/frame.png", view);
  REQUIRE_FALSE(refused);
  CHECK(refused.error().find("/nowhere/frame.png") != std::string::npos);
}

TEST_CASE("colours stay with their regions, whatever their labels and the mesh") {
  SheetView before = rolled_sheet(30, 20);
  before.region_colours = {7, 2};
  SheetView after = before;
  for (auto& region : after.triangle_regions) region = 1 - region;
  CHECK(continued_categories(before, after) == std::vector<int>{2, 7});

  SheetView other_mesh = rolled_sheet(23, 17);
  for (auto& region : other_mesh.triangle_regions) region = 1 - region;
  CHECK(continued_categories(before, other_mesh) == std::vector<int>{2, 7});
  for (auto& p : other_mesh.positions_m) p += sheet::Vec3f(5, 6, 7);
  other_mesh.material_coordinates_m.clear();
  CHECK(continued_categories(before, other_mesh) == std::vector<int>{2, 7});

  SheetView split = before;  // the left region falls into a larger and a smaller part: the larger keeps the colour
  for (std::size_t t = 0; t < split.triangles.size(); ++t) {
    if (t / 2 % 30 < 4) split.triangle_regions[t] = 2;
  }
  const std::vector<int> categories = continued_categories(before, split);
  REQUIRE(categories.size() == 3);
  CHECK(categories[0] == 7);
  CHECK(categories[1] == 2);
  CHECK(categories[2] != 7);
  CHECK(categories[2] != 2);
  CHECK(categories[2] < kCategories);
}

TEST_CASE("the largest regions come first") {
  SheetView view;
  view.resonators = {{true, false, 0, 0, 0.1}, {true, false, 0, 0, 0.3}, {true, false, 0, 0, 0.2}};
  CHECK(largest_regions(view, 2) == std::vector<std::size_t>{1, 2});
  CHECK(largest_regions(view, 9).size() == 3);
  CHECK(largest_regions({}, 3).empty());
}

TEST_CASE("wires lie on their obstacle") {
  scene::Obstacle obstacle;
  obstacle.pose.position_m = {0.1, -0.2, 0.3};
  obstacle.pose.orientation = Eigen::AngleAxisd(0.7, Vec3d(1, 2, 3).normalized());
  const auto own = [&](const Vec3d& world) -> Vec3d {
    return obstacle.pose.orientation.conjugate() * (world - obstacle.pose.position_m);
  };
  const auto check_all = [&](auto&& distance) {
    const std::vector<Segment> wires = obstacle_wires(obstacle, obstacle.pose.position_m, 0.2);
    REQUIRE_FALSE(wires.empty());
    for (const auto& [from, to] : wires) {
      CHECK(distance(own(from)) == Approx(0).margin(1e-9));
      CHECK(distance(own(to)) == Approx(0).margin(1e-9));
    }
  };
  obstacle.shape = scene::PlaneShape{};
  check_all([](const Vec3d& p) { return p.z(); });
  obstacle.shape = scene::SphereShape{0.05};
  check_all([](const Vec3d& p) { return p.norm() - 0.05; });
  obstacle.shape = scene::CapsuleShape{0.05, 0.1};
  check_all([](const Vec3d& p) { return (p - Vec3d(0, 0, std::clamp(p.z(), -0.1, 0.1))).norm() - 0.05; });
  obstacle.shape = scene::BoxShape{{0.1, 0.2, 0.3}};
  check_all([](const Vec3d& p) { return (p.cwiseAbs() - Vec3d(0.1, 0.2, 0.3)).norm(); });
  CHECK(obstacle_wires(obstacle, Vec3d::Zero(), 0.2).size() == 12);
  obstacle.shape = scene::MeshShape{{{0, 1, 2}, {0, 2, 3}, {0, 1, 9}}, {{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}}};
  CHECK(obstacle_wires(obstacle, Vec3d::Zero(), 0.2).size() == 5);
}

}  // namespace rustle::report::sheet_picture_test
