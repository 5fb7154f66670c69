#include "client_sdk/sheets/cloth_motion.h"

#include <array>
#include <cmath>
#include <cstddef>
#include <numbers>
#include <utility>
#include <vector>

namespace rustle::sheets {
namespace {

constexpr double kWrinkle_m = 0.0025;  ///< amplitude of each train

/// A train of wrinkles: waves over the cloth's plane. Their frequencies are whole numbers a rubbing period.
struct WrinkleTrain {
  double along_per_m, across_per_m;  ///< waves
  double frequency_hz;
  double phase;  ///< turns
};
constexpr std::array<WrinkleTrain, 3> kTrains{
    {{6.2, 1.7, 2 / kRubbingPeriod_s, 0}, {4.1, -3.3, 3 / kRubbingPeriod_s, 0.3}, {-5.3, 4.4, 4 / kRubbingPeriod_s, 0.7}}};

/// How high the cloth lies at a place, from 0 on, at a wrinkling of one.
double wrinkled_m(double u_m, double v_m, double time_s) {
  double height_m = 0;
  for (const WrinkleTrain& train : kTrains) {
    const double turns = train.along_per_m * u_m + train.across_per_m * v_m - train.frequency_hz * time_s + train.phase;
    height_m += kWrinkle_m * (1 + std::sin(2 * std::numbers::pi * turns));
  }
  return height_m;
}

/// To one side and back.
struct Push {
  double from_s, to_s, way_m;
};
/// Up, and down again.
struct Swell {
  double from_s, to_s, most;
};

double place_m(const std::vector<Push>& pushes, double time_s) {
  double place = 0;
  for (const auto& [from_s, to_s, way_m] : pushes) place += way_m * smooth_step((time_s - from_s) / (to_s - from_s));
  return place;
}

double wrinkling(const std::vector<Swell>& swells, double time_s) {
  double sum = 0;
  for (const auto& [from_s, to_s, most] : swells) {
    const double quarter_s = (to_s - from_s) / 4;
    sum += most * (smooth_step((time_s - from_s) / quarter_s) - smooth_step((time_s - (to_s - quarter_s)) / quarter_s));
  }
  return sum;
}

Animation lying_cloth(double duration_s, std::vector<Push> pushes, std::vector<Swell> swells) {
  Animation animation;
  animation.duration_s = duration_s;
  animation.on_table = true;
  animation.map_at = [pushes = std::move(pushes), swells = std::move(swells)](double t) -> MaterialMap {
    const double x_m = place_m(pushes, t), swell = wrinkling(swells, t);
    return [x_m, swell, t](double u, double v) -> Point3 {
      return {x_m + u - kClothWidth_m / 2, v - kClothHeight_m / 2, swell * wrinkled_m(u, v, t)};
    };
  };
  return animation;
}

}  // namespace

std::unique_ptr<AnimatedSheet> make_cloth_demo(std::size_t triangle_count, std::uint64_t seed) {
  return make_animated(
      make_rectangle(MeshKind::kDelaunay, kClothWidth_m, kClothHeight_m, triangle_count, seed),
      lying_cloth(
          9, {{0.4, 1.2, 0.15}, {1.3, 2.0, -0.2}, {2.2, 2.5, 0.2}, {2.6, 2.85, -0.25}, {2.95, 3.25, 0.2}, {7.3, 7.9, 0.7}},
          {{3.6, 5.2, 0.4}, {5.2, 7.0, 1.0}, {7.2, 8.2, 0.3}}));
}

std::unique_ptr<AnimatedSheet> make_rubbed_cloth(SheetMesh mesh) {
  Animation animation;
  animation.duration_s = kRubbingPeriod_s;
  animation.on_table = true;
  animation.map_at = [](double t) -> MaterialMap {
    constexpr double kReach_m = 0.115;
    const double x_m = kReach_m * std::sin(2 * std::numbers::pi * t / kRubbingPeriod_s);
    return [x_m, t](double u, double v) -> Point3 {
      return {x_m + u - kClothWidth_m / 2, v - kClothHeight_m / 2, 0.7 * wrinkled_m(u, v, t)};
    };
  };
  return make_animated(std::move(mesh), std::move(animation));
}

}  // namespace rustle::sheets
