#include "server/scene/proximity.h"

#include <cmath>
#include <random>

#include <catch2/catch.hpp>

namespace proximity_test {

namespace {

using namespace rustle::scene;

Vec3d random_point(std::mt19937& random, double half_extent) {
  const auto unit = [&] { return static_cast<double>(random()) / static_cast<double>(std::mt19937::max()); };
  const double x = 2 * unit() - 1;
  const double y = 2 * unit() - 1;
  return half_extent * Vec3d(x, y, 2 * unit() - 1);
}

/// Least distance to a dense sampling of the surface; it exceeds the true one by at most the sample spacing.
template <class Surface>
double sampled_distance(const Vec3d& query, Surface&& surface) {
  double best = 1e9;
  constexpr int kSteps = 300;
  for (int i = 0; i <= kSteps; ++i) {
    for (int j = 0; j <= kSteps; ++j) {
      best = std::min(best, (query - surface(static_cast<double>(i) / kSteps, static_cast<double>(j) / kSteps)).norm());
    }
  }
  return best;
}

void check_closest(const SurfacePoint& point, const Vec3d& query, double sampled, bool inside, double spacing) {
  CHECK(std::abs(point.distance_m) <= sampled + 1e-9);
  CHECK(std::abs(point.distance_m) >= sampled - spacing);
  CHECK((point.distance_m < 0) == inside);
  CHECK(point.normal.norm() == Approx(1.0));
  CHECK((point.position_m + point.distance_m * point.normal - query).norm() < 1e-9);
}

MeshShape cube_mesh(double half) {
  MeshShape mesh;
  for (int k = 0; k < 8; ++k) {
    mesh.vertices_m.emplace_back((k & 1) ? half : -half, (k & 2) ? half : -half, (k & 4) ? half : -half);
  }
  mesh.triangles = {{0, 2, 1}, {1, 2, 3}, {4, 5, 6}, {5, 7, 6}, {0, 1, 4}, {1, 5, 4},
                    {2, 6, 3}, {3, 6, 7}, {0, 4, 2}, {2, 4, 6}, {1, 3, 5}, {3, 7, 5}};
  return mesh;
}

/// A bumpy square of n x n cells.
MeshShape bumpy_mesh(int n, double phase) {
  MeshShape mesh;
  for (int j = 0; j <= n; ++j) {
    for (int i = 0; i <= n; ++i) {
      const double x = static_cast<double>(i) / n - 0.5;
      const double y = static_cast<double>(j) / n - 0.5;
      mesh.vertices_m.push_back(Vec3d(x, y, 0.05 * std::sin(9 * x + phase) * std::cos(7 * y)).cast<float>());
    }
  }
  const auto at = [&](int i, int j) { return static_cast<std::uint32_t>(j * (n + 1) + i); };
  for (int j = 0; j < n; ++j) {
    for (int i = 0; i < n; ++i) {
      mesh.triangles.push_back({at(i, j), at(i + 1, j), at(i + 1, j + 1)});
      mesh.triangles.push_back({at(i, j), at(i + 1, j + 1), at(i, j + 1)});
    }
  }
  return mesh;
}

ObstacleTrack track_of(Shape shape, Pose pose = {}) {
  Obstacle obstacle;
  obstacle.shape = std::move(shape);
  obstacle.pose = pose;
  return {obstacle, 0.0, 1};
}

double brute_distance(const MeshShape& mesh, const Vec3d& query) {
  double best = 1e9;
  for (const Triangle& t : mesh.triangles) {
    const auto on = closest_on_triangle(query, mesh.vertices_m[t[0]].cast<double>(), mesh.vertices_m[t[1]].cast<double>(),
                                        mesh.vertices_m[t[2]].cast<double>());
    best = std::min(best, (query - on.position_m).norm());
  }
  return best;
}

}  // namespace

TEST_CASE("The distance to every analytic shape is that of its sampled surface", "[proximity]") {
  std::mt19937 random(1);
  const BoxShape box{Vec3d(0.3, 0.2, 0.1)};
  const SphereShape sphere{0.25};
  const CapsuleShape capsule{0.1, 0.2};
  for (int k = 0; k < 40; ++k) {
    const Vec3d query = random_point(random, 0.5);
    CHECK(closest_point(PlaneShape{}, query).distance_m == query.z());

    double sampled = 1e9;
    for (int axis = 0; axis < 3; ++axis) {
      for (const double side : {-1.0, 1.0}) {
        sampled = std::min(sampled, sampled_distance(query, [&](double a, double b) {
                             Vec3d p;
                             p[axis] = side * box.half_extents_m[axis];
                             p[(axis + 1) % 3] = (2 * a - 1) * box.half_extents_m[(axis + 1) % 3];
                             p[(axis + 2) % 3] = (2 * b - 1) * box.half_extents_m[(axis + 2) % 3];
                             return p;
                           }));
      }
    }
    check_closest(closest_point(box, query), query, sampled, (query.cwiseAbs() - box.half_extents_m).maxCoeff() < 0, 2e-3);

    sampled = sampled_distance(query, [&](double a, double b) {
      return Vec3d(0.25 * Vec3d(std::sin(M_PI * a) * std::cos(2 * M_PI * b), std::sin(M_PI * a) * std::sin(2 * M_PI * b),
                                std::cos(M_PI * a)));
    });
    check_closest(closest_point(sphere, query), query, sampled, query.norm() < 0.25, 4e-3);

    sampled = sampled_distance(query, [&](double a, double b) {
      const double s = 1.5 * a;  // caps take a quarter each of the way from pole to pole
      const double turn = 2 * M_PI * b;
      if (s < 0.5)
        return Vec3d(0.1 * std::sin(M_PI * s) * std::cos(turn), 0.1 * std::sin(M_PI * s) * std::sin(turn),
                     0.2 + 0.1 * std::cos(M_PI * s));
      if (s > 1.0)
        return Vec3d(0.1 * std::sin(M_PI * (s - 0.5)) * std::cos(turn), 0.1 * std::sin(M_PI * (s - 0.5)) * std::sin(turn),
                     -0.2 + 0.1 * std::cos(M_PI * (s - 0.5)));
      return Vec3d(0.1 * std::cos(turn), 0.1 * std::sin(turn), 0.2 - 0.4 * (s - 0.5) / 0.5);
    });
    const Vec3d on_axis(0, 0, std::clamp(query.z(), -0.2, 0.2));
    check_closest(closest_point(capsule, query), query, sampled, (query - on_axis).norm() < 0.1, 4e-3);
  }
}

TEST_CASE("The tree finds what brute force finds, refitted as well", "[proximity]") {
  std::mt19937 random(2);
  const MeshShape mesh = bumpy_mesh(24, 0);
  ObstacleTrack track = track_of(mesh);
  ObstacleSurface surface;
  surface.update(track, 0, 0);
  for (int k = 0; k < 300; ++k) {
    const Vec3d query = random_point(random, 0.6);
    const auto found = surface.closest(query, 0.15);
    const double brute = brute_distance(mesh, query);
    REQUIRE(found.has_value() == (brute <= 0.15));
    if (found) CHECK(std::abs(found->distance_m) == Approx(brute).margin(1e-12));
  }
  SceneState scene;
  SceneUpdate update;
  Obstacle obstacle;
  obstacle.id = 1;
  obstacle.shape = mesh;
  update.obstacles = {obstacle};
  REQUIRE(scene.apply(update));
  surface = {};
  surface.update(*scene.find(1), 0, 0);
  const MeshShape moved = bumpy_mesh(24, 2.0);
  SceneUpdate change;
  change.time_s = 0.1;
  change.vertices = {{1, moved.vertices_m}};
  REQUIRE(scene.apply(change));
  surface.update(*scene.find(1), 0.1, 0.1);
  for (int k = 0; k < 300; ++k) {
    const Vec3d query = random_point(random, 0.5);
    const auto found = surface.closest(query, 10);
    REQUIRE(found);
    CHECK(std::abs(found->distance_m) == Approx(brute_distance(moved, query)).margin(1e-12));
    const Triangle& t = mesh.triangles[found->triangle];
    Vec3d chord = Vec3d::Zero();
    for (std::size_t c = 0; c < 3; ++c) {
      chord +=
          found->barycentric[static_cast<int>(c)] * (moved.vertices_m[t[c]] - mesh.vertices_m[t[c]]).cast<double>() / 0.1;
    }
    CHECK((surface.velocity_m_per_s(*found) - chord).norm() < 1e-4);
  }
}

TEST_CASE("A closed mesh has the signed distance of the box it is", "[proximity]") {
  std::mt19937 random(3);
  ObstacleSurface mesh;
  const ObstacleTrack track = track_of(cube_mesh(0.25));
  mesh.update(track, 0, 0);
  for (int k = 0; k < 500; ++k) {
    const Vec3d query = random_point(random, 0.5);
    const SurfacePoint box = closest_point(BoxShape{Vec3d::Constant(0.25)}, query);
    const auto found = mesh.closest(query, 2);
    REQUIRE(found);
    CHECK(found->distance_m == Approx(box.distance_m).margin(1e-9));
    CHECK((found->normal - box.normal).norm() < 1e-6);
  }
}

TEST_CASE("Distances follow an obstacle's pose", "[proximity]") {
  std::mt19937 random(4);
  const Pose pose{Vec3d(0.3, -0.2, 1.0), Eigen::Quaterniond(Eigen::AngleAxisd(0.8, Vec3d(1, -2, 0.5).normalized()))};
  const std::vector<Shape> shapes = {PlaneShape{}, BoxShape{Vec3d(0.1, 0.2, 0.3)}, SphereShape{0.2}, CapsuleShape{0.1, 0.2},
                                     cube_mesh(0.2)};
  for (const Shape& shape : shapes) {
    ObstacleSurface posed, own;
    const ObstacleTrack posed_track = track_of(shape, pose);
    const ObstacleTrack own_track = track_of(shape);
    posed.update(posed_track, 0, 0);
    own.update(own_track, 0, 0);
    for (int k = 0; k < 100; ++k) {
      const Vec3d query = random_point(random, 0.5);
      const Vec3d world = pose.orientation * query + pose.position_m;
      const auto a = own.closest(query, 0.2);
      const auto b = posed.closest(world, 0.2);
      REQUIRE(a.has_value() == b.has_value());
      const Box around(Vec3d(world - Vec3d::Constant(0.2)), Vec3d(world + Vec3d::Constant(0.2)));
      if (!a) continue;
      CHECK(posed.may_meet(around));
      CHECK(b->distance_m == Approx(a->distance_m).margin(1e-9));
      CHECK((b->position_m - (pose.orientation * a->position_m + pose.position_m)).norm() < 1e-9);
      CHECK((b->normal - pose.orientation * a->normal).norm() < 1e-6);
    }
    const Vec3d far = pose.position_m + 5 * (pose.orientation * Vec3d::UnitZ());
    CHECK_FALSE(posed.may_meet(Box(Vec3d(far - Vec3d::Constant(0.1)), Vec3d(far + Vec3d::Constant(0.1)))));
  }
}

TEST_CASE("The grid visits every triangle whose box meets the query's, once", "[proximity]") {
  std::mt19937 random(5);
  MeshShape mesh = bumpy_mesh(20, 1);
  mesh.vertices_m.emplace_back(3.0f, 3.0f, 3.0f);  // a triangle across many cells
  mesh.triangles.push_back({0, 5, static_cast<std::uint32_t>(mesh.vertices_m.size() - 1)});
  TriangleGrid grid;
  grid.build(mesh.triangles, mesh.vertices_m, 0.07);
  for (int k = 0; k < 200; ++k) {
    const Vec3d centre = random_point(random, 0.6);
    const Box box(Vec3d(centre - Vec3d::Constant(0.05)), Vec3d(centre + Vec3d::Constant(0.05)));
    std::vector<int> visits(mesh.triangles.size(), 0);
    grid.visit_box(box, [&](std::uint32_t t) { return ++visits[t], true; });
    for (std::size_t t = 0; t < visits.size(); ++t) {
      CHECK(visits[t] <= 1);
      if (box.intersects(triangle_box(mesh.triangles[t], mesh.vertices_m))) CHECK(visits[t] == 1);
    }
  }
}

TEST_CASE("The grid's work grows linearly with the triangles", "[proximity]") {
  double entries_before = 0;
  double visits_before = 0;
  for (const int n : {20, 40, 80, 160}) {
    const MeshShape mesh = bumpy_mesh(n, 0);
    TriangleGrid grid;
    grid.build(mesh.triangles, mesh.vertices_m, 1.5 / n);
    std::size_t visits = 0;
    for (const Triangle& t : mesh.triangles) {
      grid.visit_box(triangle_box(t, mesh.vertices_m), [&](std::uint32_t) { return ++visits, true; });
    }
    const double triangles = static_cast<double>(mesh.triangles.size());
    const double entries = static_cast<double>(grid.entry_count()) / triangles;
    if (entries_before > 0) {
      CHECK(entries < 1.15 * entries_before);
      CHECK(static_cast<double>(visits) / triangles < 1.15 * visits_before);
    }
    entries_before = entries;
    visits_before = static_cast<double>(visits) / triangles;
  }
}

}  // namespace proximity_test
