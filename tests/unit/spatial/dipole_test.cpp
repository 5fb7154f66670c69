#include "server/spatial/dipole.h"

#include <catch2/catch.hpp>

#include <array>
#include <cmath>
#include <limits>
#include <vector>

#include "server/spatial/transfer.h"
#include "sound_db/dsp/random.h"

namespace dipole_test {

using namespace rustle::spatial;

namespace {

Receiver point_at(const Vec3& position_m) {
  Receiver receiver;
  receiver.position_m = position_m;
  return receiver;
}

Vec3 random_direction(rustle::dsp::Random& random) {
  return normalized({random.normal(), random.normal(), random.normal()}, {0, 0, 1});
}

}  // namespace

TEST_CASE("On the axis at one metre a dipole without planes has gain 1 and no delay") {
  Emitter emitter;
  emitter.position_m = {0.3, -0.2, 0.5};
  emitter.normal = {1, 0, 0};
  const Vec3 at{1.3, -0.2, 0.5};
  std::array<Path, 1> out;
  REQUIRE(paths(emitter, point_at(at), at, {}, out) == 1);
  CHECK(out[0].gain == Approx(1.0));
  CHECK(out[0].delay_s == 0.0);
}

TEST_CASE("A sheet that turns through edge-on keeps its floor, and its image changes sign against it without a jump") {
  Emitter emitter;
  emitter.position_m = {0, 0, 1};
  emitter.cosine_floor = 0.2;
  const Plane wall{{-1, 0, 0}, {1, 0, 0}, 1.0};
  const Vec3 at{0, 0, 3};
  std::array<Path, 2> out, previous;
  double least = 1, most = -1;
  for (int k = 0; k <= 1800; ++k) {
    const double angle = k * M_PI / 1800;
    emitter.normal = {std::sin(angle), 0, std::cos(angle)};
    paths(emitter, point_at(at), at, std::span(&wall, 1), out);
    CHECK(out[0].gain == Approx(std::max(0.2, std::abs(std::cos(angle))) / 2));
    if (k > 0) {
      CHECK(std::abs(out[0].gain - previous[0].gain) < 0.002);
      CHECK(std::abs(out[1].gain - previous[1].gain) < 0.004);
    }
    least = std::min(least, out[1].gain);
    most = std::max(most, out[1].gain);
    previous = out;
  }
  CHECK(least < -0.1);
  CHECK(most > 0.1);
}

TEST_CASE("The image lies behind the plane: mirrored position, mirrored normal, longer way") {
  rustle::dsp::Random random(3);
  for (int k = 0; k < 200; ++k) {
    Plane plane{{random.normal(), random.normal(), random.normal()}, random_direction(random), 0.7};
    Emitter emitter;
    emitter.normal = random_direction(random);
    emitter.position_m =
        plane.point_m + random.uniform(0.01, 1.0) * plane.normal + 0.3 * cross(plane.normal, emitter.normal);
    const Vec3 at = plane.point_m + random.uniform(0.05, 2.0) * plane.normal + 1.5 * cross(plane.normal, {1, 0, 0});
    std::array<Path, 2> out;
    REQUIRE(paths(emitter, point_at(at), at, std::span(&plane, 1), out) == 2);
    const double height = dot(emitter.position_m - plane.point_m, plane.normal);
    const Vec3 image = emitter.position_m - (2 * height) * plane.normal;
    const Vec3 normal = emitter.normal - (2 * dot(emitter.normal, plane.normal)) * plane.normal;
    const double distance = norm(at - image);
    const double cosine = dot(at - image, normal) / distance;
    const double direct = dot(at - emitter.position_m, emitter.normal) / norm(at - emitter.position_m);
    if (std::min(std::abs(cosine), std::abs(direct)) > 0.1) {
      CHECK(out[1].gain == Approx(0.7 * cosine / distance * (direct < 0 ? -1 : 1)));
    }
    CHECK(out[1].delay_s == Approx((distance - norm(at - emitter.position_m)) / 343.0).margin(1e-12));
    CHECK(out[1].delay_s >= 0);
  }
}

TEST_CASE("A resonator is not imaged in a plane it touches or lies below, and wholly from 6 mm") {
  const Plane table;
  Emitter emitter;
  std::array<Path, 2> out;
  const auto image_share = [&](double height_m) {
    emitter.position_m = {0, 0, height_m};
    paths(emitter, point_at({0.5, 0, 1}), {0.5, 0, 1}, std::span(&table, 1), out);
    const Vec3 way = Vec3{0.5, 0, 1} - Vec3{0, 0, -std::max(height_m, 0.0)};
    return out[1].gain / (-way.z / dot(way, way));
  };
  CHECK(image_share(-0.01) == 0.0);
  CHECK(image_share(0.0) == 0.0);
  CHECK(image_share(0.002) == 0.0);
  CHECK(image_share(0.004) == Approx(0.5));
  CHECK(image_share(0.006) == Approx(1.0));
  CHECK(image_share(0.3) == Approx(1.0));
  emitter.fades_when_touching = false;
  CHECK(image_share(0.001) == Approx(1.0));
}

TEST_CASE("Behind a plane nothing of its reflection is heard") {
  const Plane table;
  Emitter emitter;
  emitter.position_m = {0, 0, 0.3};
  std::array<Path, 2> out;
  paths(emitter, point_at({0, 1, -0.2}), {0, 1, -0.2}, std::span(&table, 1), out);
  CHECK(out[1].gain == 0.0);
}

TEST_CASE("The delay's spread is the derivative of the path difference times the height spread") {
  const Plane table;
  Emitter emitter;
  emitter.position_m = {0.1, 0.2, 0.15};
  emitter.covariance_m2.zz = 0.01 * 0.01;
  emitter.covariance_m2.xx = 1.0;
  const Vec3 at{0.7, -0.4, 0.6};
  std::array<Path, 2> low, high, out;
  paths(emitter, point_at(at), at, std::span(&table, 1), out);
  constexpr double kStep_m = 1e-5;
  emitter.position_m.z -= kStep_m;
  paths(emitter, point_at(at), at, std::span(&table, 1), low);
  emitter.position_m.z += 2 * kStep_m;
  paths(emitter, point_at(at), at, std::span(&table, 1), high);
  CHECK(out[1].spread_s == Approx(0.01 * (high[1].delay_s - low[1].delay_s) / (2 * kStep_m)).epsilon(1e-5));
}

TEST_CASE("At no distance the gain stays that of 5 cm, and no input that is finite gives one that is not") {
  Emitter emitter;
  std::array<Path, 2> out;
  const Plane table;
  paths(emitter, point_at({0, 0, 0.001}), {0, 0, 0.001}, {}, out);
  CHECK(out[0].gain == Approx(20.0));
  for (const double scale : {0.0, 1e-300, 1e-12, 1e6, 1e100}) {
    emitter.position_m = {scale, -scale, scale};
    for (const Vec3& at : {Vec3{0, 0, 0}, Vec3{scale, -scale, scale}, Vec3{-scale, 0, 1e-300}}) {
      paths(emitter, point_at(at), at, std::span(&table, 1), out);
      for (const Path& way : out) {
        CHECK(std::isfinite(way.gain));
        CHECK(std::isfinite(way.delay_s));
        CHECK(std::isfinite(way.spread_s));
      }
    }
  }
}

TEST_CASE("A way too long for numbers is silent and takes no time") {
  Emitter emitter;
  emitter.position_m = {1e200, -1e200, 1e300};
  std::array<Path, 2> out;
  const std::array<Plane, 1> table{};
  REQUIRE(paths(emitter, point_at({0, 0, 1}), {0, 0, 1}, table, out) == 2);
  for (const Path& path : out) {
    CHECK(path.gain == 0);
    CHECK(path.delay_s == 0);
  }
}

TEST_CASE("The magnitude over a table is eq. 6: g0² + g1² + 2 g0 g1 cos(ωΔt), faded for an extended source") {
  const Plane table;
  Emitter emitter;
  emitter.position_m = {0, 0, 0.05};
  const Vec3 at{0, std::cos(M_PI / 6), std::sin(M_PI / 6)};
  for (const double spread_m : {0.0, 0.004, 0.02}) {
    emitter.covariance_m2.zz = spread_m * spread_m;
    std::array<Path, 2> out;
    paths(emitter, point_at(at), at, std::span(&table, 1), out);
    for (const double f : {100.0, 700.0, 1900.0, 5300.0, 16000.0}) {
      const double w = 2 * M_PI * f;
      const double faded = std::exp(-0.5 * std::pow(w * out[1].spread_s, 2));
      const double square = out[0].gain * out[0].gain + out[1].gain * out[1].gain +
                            2 * out[0].gain * out[1].gain * std::cos(w * out[1].delay_s) * faded;
      CHECK(magnitude(out, f) == Approx(std::sqrt(square)).epsilon(1e-9));
    }
  }
}

}  // namespace dipole_test
