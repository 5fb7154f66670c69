#include "client_sdk/sheets/tearing_cone.h"

#include <algorithm>
#include <cmath>

#include <catch2/catch.hpp>

#include "client_sdk/sheets/tearing_direction.h"
#include "client_sdk/sheets/tearing_sheet.h"

namespace tearing_cone_test {

namespace {

using namespace rustle::sheets;

/// Thumbs 8 cm apart, the tip so many times that beyond their middle and so far aside; turned until the strain is reached.
TearPose held(double distance, double aside, double strain) {
  constexpr double kApart_m = 0.08;
  TearPose pose;
  pose.tip_m = {0.15, 0.18};
  pose.placed_tip_m = {0.01, 0.02};
  const Point2 middle = pose.tip_m + Point2{aside * kApart_m, -distance * kApart_m};
  pose.grips[kLeft].thumb_m = middle + Point2{kApart_m / 2, 0};
  pose.grips[kRight].thumb_m = middle - Point2{kApart_m / 2, 0};
  double low = 0, high = pose.thumbs_angle_rad();
  for (int k = 0; k < 60; ++k) {
    const double mid = (low + high) / 2;
    pose.angle_rad = {-0.3 * mid, 0.7 * mid};
    (pose.strain() < strain ? low : high) = mid;
  }
  return pose;
}

double distance(const Point3& a, const Point3& b) {
  return std::hypot(a[0] - b[0], a[1] - b[1], a[2] - b[2]);
}

/// The greatest relative change of a short length anywhere on the cone, in any direction.
double worst_stretch(const TearCone& cone, const TearPose& pose) {
  double worst = 0;
  const Point2 left = pose.grips[kLeft].thumb_m, right = pose.grips[kRight].thumb_m;
  for (double across = 0.03; across < 0.98; across += 0.05) {
    for (double away = 0.2; away < 2; away += 0.3) {
      const Point2 p = pose.tip_m + away * ((left + across * (right - left)) - pose.tip_m);
      for (int k = 0; k < 6; ++k) {
        const double step = 0.005 * length(p - pose.tip_m);
        const Point2 q = p + turned({step, 0}, k * 0.55);
        if (!cone.covers(p) || !cone.covers(q)) continue;
        worst = std::max(worst, std::abs(distance(cone.at(p), cone.at(q)) / step - 1));
      }
    }
  }
  return worst;
}

TEST_CASE("The cone keeps lengths within 1 % at every strain", "[tearing]") {
  for (const double tip : {0.5, 1.0, 1.5}) {
    for (const double aside : {0.0, 0.2}) {
      for (const double strain : {0.0, 0.01, 0.05, 0.1, 0.2, 0.3}) {
        const TearPose pose = held(tip, aside, strain);
        INFO("tip " << tip << " aside " << aside << " strain " << strain);
        CHECK(pose.strain() == Approx(strain).margin(1e-6));
        CHECK(worst_stretch(TearCone(pose, 1), pose) < 0.01);
      }
    }
  }
}

TEST_CASE("The cone is as high over the thumbs' distance as an inextensible arch, within 10 %", "[tearing]") {
  for (const double tip : {0.5, 1.0, 1.5, 2.5}) {
    double before = 0;
    for (double strain = 0.01; strain <= 0.3; strain += 0.01) {
      const TearCone cone(held(tip, 0, strain), cone_roundness("printer-paper"));
      INFO("tip " << tip << " strain " << strain);
      CHECK(cone.rise_m() / 0.08 == Approx(arch_rise(strain)).epsilon(0.1));
      // Near the tip the arch leans over it; farther off its height is that over the table.
      if (tip >= 1) CHECK(cone.height_m() / 0.08 == Approx(arch_rise(strain)).epsilon(0.1));
      CHECK(cone.rise_m() > before);
      before = cone.rise_m();
    }
  }
}

TEST_CASE("Thinner paper bends closer to the thumbs", "[tearing]") {
  const TearPose pose = held(1, 0, 0.1);
  CHECK(cone_roundness("tracing-paper") < cone_roundness("printer-paper"));
  CHECK(cone_roundness("printer-paper") < cone_roundness("banknote"));
  CHECK(TearCone(pose, cone_roundness("tracing-paper")).rise_m() > TearCone(pose, cone_roundness("banknote")).rise_m());
}

TEST_CASE("The cone meets both hands' regions without a step or a crease", "[tearing]") {
  const TearPose pose = held(1, 0.1, 0.15);
  const TearCone cone(pose, 1);
  for (const auto side : {kLeft, kRight}) {
    const Point2 along = pose.grips[side].thumb_m - pose.tip_m;
    const double inward = side == kLeft ? -1 : 1;
    for (const double away : {0.3, 1.0, 1.7}) {
      const Point2 p = pose.tip_m + away * along;
      const Point2 flat = pose.region(side).at(p);
      const Point3 at = cone.at(p);
      CHECK(std::hypot(at[0] - flat.x, at[1] - flat.y) < 1e-9);
      CHECK(std::abs(at[2]) < 1e-9);
      const Point2 beside = pose.tip_m + turned(away * along, inward * 0.01);
      CHECK(std::abs(cone.at(beside)[2]) < 0.1 * length(beside - p));
      CHECK(cone.covers(beside));
      CHECK_FALSE(cone.covers(pose.tip_m + turned(away * along, -inward * 0.01)));
    }
  }
}

TEST_CASE("A tear begins between the rays of the hands, at a place that is random", "[tearing]") {
  const RectangleSize size;
  const Grips grips = usual_grips(size);
  double low = 1, high = 0;
  for (int k = 0; k <= 20; ++k) {
    const Point2 start = tear_start(size, grips, k / 20.0);
    CHECK(start.y == Approx(size.height_m));
    low = std::min(low, start.x);
    high = std::max(high, start.x);
  }
  const auto hit = [&](TornSide side) {
    return border_hit(size, grips[side].index_m, grips[side].index_m - grips[side].thumb_m).x;
  };
  CHECK(low == Approx(hit(kRight)));
  CHECK(high == Approx(hit(kLeft)));
  CHECK(high - low > 0.02);
}

TEST_CASE("A single hand that turns tears toward its thumb, both between them, a closing one nothing", "[tearing]") {
  const TearPose pose = held(1, 0.3, 0.1);
  constexpr double kC = 0.15;
  const Point2 left = direction_of(pose.grips[kLeft].thumb_m - pose.tip_m),
               right = direction_of(pose.grips[kRight].thumb_m - pose.tip_m);
  const auto advance = [&](double left_rad, double right_rad) {
    return rotation_advance(pose, {HandMotion{left_rad}, HandMotion{right_rad}}, kC);
  };
  CHECK(length(advance(0.1, 0) - 0.1 * kC * left) < 1e-15);
  CHECK(length(advance(0, 0.2) - 0.2 * kC * right) < 1e-15);
  CHECK(length(advance(0.1, 0.2) - kC * (0.1 * left + 0.2 * right)) < 1e-15);
  CHECK(length(advance(-0.1, 0)) == 0);
}

TEST_CASE("Hands that move apart tear up to the point where both regions meet again", "[tearing]") {
  const TearPose pose = held(1, 0.1, 0.2);
  const HandMotions apart{HandMotion{0, {0.002, 0.001}, {}}, HandMotion{0, {-0.003, 0.0005}, {}}};
  const Point2 advance = translation_advance(pose, apart);
  REQUIRE(length(advance) > 0);
  const Point2 tip = pose.tip_m + advance;
  const Point2 gap = (pose.region(kLeft).at(tip) + apart[kLeft].translation_m) -
                     (pose.region(kRight).at(tip) + apart[kRight].translation_m);
  CHECK(length(gap) < 1e-12);
  const HandMotions together{HandMotion{0, {-0.002, 0}, {}}, HandMotion{0, {0.003, 0}, {}}};
  CHECK(length(translation_advance(pose, together)) == 0);
}

}  // namespace

}  // namespace tearing_cone_test
