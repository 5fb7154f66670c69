#include <catch2/catch.hpp>

#include <cmath>
#include <limits>
#include <vector>

#include <Eigen/Geometry>

#include "server/analysis/rigid_motion.h"

namespace rigid_motion_test {

namespace {

using rustle::analysis::nearest_rigid_motion;
using rustle::sheet::Vec3d;
using rustle::sheet::Vec3f;

std::vector<Vec3f> bowed_sheet(int side, double bow) {
  std::vector<Vec3f> out;
  for (int i = 0; i < side; ++i) {
    for (int j = 0; j < side; ++j) {
      const double x = 0.3 * i / (side - 1), y = 0.2 * j / (side - 1);
      out.push_back(Vec3d(x, y, bow * x * (0.3 - x)).cast<float>());
    }
  }
  return out;
}

TEST_CASE("A rigid motion is found as it was, from few vertices and many, bowed and flat") {
  for (const int side : {3, 10, 60}) {
    for (const double bow : {0.0, 2.0}) {
      const Vec3d axis = Vec3d(1, 2, 3).normalized();
      const Eigen::AngleAxisd turn(0.1, axis);
      const Vec3d shift(0.01, -0.02, 0.03);
      const auto before = bowed_sheet(side, bow);
      std::vector<Vec3f> now;
      for (const Vec3f& p : before) now.push_back((turn * p.cast<double>() + shift).cast<float>());
      const auto motion = nearest_rigid_motion(before, now);
      REQUIRE(motion);
      CHECK((motion->turn_rad - 0.1 * axis).norm() < 1e-4);
      CHECK((motion->to_m - (turn * motion->from_m + shift)).norm() < 1e-6);
    }
  }
}

TEST_CASE("What bends both ways about its place does not turn, and what has no rigid motion has none") {
  const auto up = bowed_sheet(20, 1), down = bowed_sheet(20, 0.9);
  const auto motion = nearest_rigid_motion(up, down);
  REQUIRE(motion);
  CHECK(motion->turn_rad.norm() < 1e-3);
  std::vector<Vec3f> line(30);
  for (std::size_t i = 0; i < line.size(); ++i) line[i].x() = static_cast<float>(i);
  CHECK_FALSE(nearest_rigid_motion(line, line));
  CHECK_FALSE(nearest_rigid_motion(std::span(line).first(2), std::span(line).first(2)));
  auto broken = up;
  broken[0].x() = std::numeric_limits<float>::quiet_NaN();
  CHECK_FALSE(nearest_rigid_motion(up, broken));
}

}  // namespace

}  // namespace rigid_motion_test
