#include "server/spatial/receivers.h"

#include <catch2/catch.hpp>

#include <array>
#include <cmath>

#include "server/spatial/dipole.h"
#include "sound_db/dsp/random.h"

namespace receivers_test {

using namespace rustle::spatial;

namespace {

std::array<double, 2> stereo_gains(const Listener& listener, const Vec3& source_m) {
  Emitter emitter;
  emitter.position_m = source_m;
  emitter.normal = normalized(listener.position_m - source_m, {0, 0, 1});
  const auto both = receivers(listener, Layout::kStereo);
  std::array<Path, 1> out;
  paths(emitter, both[0], listener.position_m, {}, out);
  const double left = out[0].gain;
  paths(emitter, both[1], listener.position_m, {}, out);
  return {left, out[0].gain};
}

}  // namespace

TEST_CASE("A frontal source has the mono level in both channels; one on the right is louder and earlier there") {
  Listener listener;
  listener.position_m = {0, 0, 1};
  listener.forward = {0, 1, 0};
  listener.up = {0, 0, 1};
  const auto frontal = stereo_gains(listener, {0, 10, 1});
  CHECK(frontal[0] == frontal[1]);
  CHECK(frontal[0] == Approx(0.1).epsilon(0.01));
  const auto right = stereo_gains(listener, {3, 1, 1});
  CHECK(right[1] > 2 * right[0]);

  const auto both = receivers(listener, Layout::kStereo);
  CHECK(both[1].position_m.x == Approx(0.085));
  CHECK(both[0].position_m.x == Approx(-0.085));
  CHECK(norm(both[0].axis) == Approx(1.0));
  CHECK(dot(both[0].axis, both[1].axis) == Approx(std::cos(110 * M_PI / 180)));
}

TEST_CASE("No direction is lost: the louder channel never falls 13 dB below the front") {
  Listener listener;
  listener.position_m = {0, 0, 0};
  listener.forward = {0, 1, 0};
  listener.up = {0, 0, 1};
  for (int k = 0; k < 360; ++k) {
    const double angle = k * M_PI / 180;
    const auto gains = stereo_gains(listener, {20 * std::sin(angle), 20 * std::cos(angle), 0});
    CHECK(std::max(gains[0], gains[1]) > 0.05 * 0.22);
  }
}

TEST_CASE("Turning the listener's up over swaps the receivers bit for bit") {
  rustle::dsp::Random random(11);
  for (int k = 0; k < 300; ++k) {
    Listener listener;
    listener.position_m = {random.normal(), random.normal(), random.normal()};
    listener.forward = normalized({random.normal(), random.normal(), random.normal()}, {1, 0, 0});
    listener.up =
        k % 10 == 0 ? listener.forward : normalized({random.normal(), random.normal(), random.normal()}, {0, 0, 1});
    const auto upright = receivers(listener, Layout::kStereo);
    listener.up = -listener.up;
    const auto turned = receivers(listener, Layout::kStereo);
    CHECK(upright[0].position_m == turned[1].position_m);
    CHECK(upright[1].position_m == turned[0].position_m);
    CHECK(upright[0].axis == turned[1].axis);
    CHECK(upright[1].axis == turned[0].axis);
  }
}

TEST_CASE("Mono is one point at the listener") {
  Listener listener;
  listener.position_m = {1, 2, 3};
  const auto one = receivers(listener, Layout::kMono);
  CHECK(channel_count(Layout::kMono) == 1);
  CHECK(one[0].position_m == Vec3{1, 2, 3});
  CHECK(one[0].shape == 0.0);
}

}  // namespace receivers_test
