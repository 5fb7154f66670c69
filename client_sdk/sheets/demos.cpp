#include "client_sdk/sheets/demos.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <numbers>
#include <utility>
#include <vector>

#include "client_sdk/sheets/motions.h"
#include "client_sdk/sheets/strip.h"

namespace rustle::sheets {
namespace {

constexpr double kLength_m = 0.297;
constexpr double kWidth_m = 0.210;
constexpr double kCycle_rad = 2 * std::numbers::pi;

/// Half the angle of the arch whose chord is 0.7 times its length: sin(x)/x = 0.7.
constexpr double kArch_rad = 1.3725;

/// A value that moves between marks by smooth steps.
struct Mark {
  double from_s, to_s, value;
};
class Score {
 public:
  explicit Score(double start, std::vector<Mark> marks = {}) : start_(start), marks_(std::move(marks)) {}
  double at(double time_s) const {
    double value = start_;
    for (const Mark& mark : marks_) {
      value += (mark.value - value) * smooth_step((time_s - mark.from_s) / (mark.to_s - mark.from_s));
    }
    return value;
  }

 private:
  double start_;
  std::vector<Mark> marks_;
};

/// How the strip is posed. An arch of half angle a stands on both edges: κ = 2a/length, rising from the front edge by a, the
/// edges length sin(a)/a apart; a = 0 lies flat. On top come a further rise and curvature and travelling waves.
struct Staging {
  double duration_s;
  bool on_table;
  Score back_x_m;  ///< of the back edge while the arch stands
  Score arch_rad;
  Score front_height_m, further_rise_rad, further_curvature_per_m;
  std::vector<WaveOptions> waves;
  std::vector<std::pair<double, double>> back_held_s, front_held_s;  ///< from, to
};

constexpr double kSwing_rad = 0.2;  ///< of the held edge, with a wave

bool within(const std::vector<std::pair<double, double>>& spans, double time_s) {
  return std::any_of(spans.begin(), spans.end(),
                     [&](const auto& span) { return span.first <= time_s && time_s < span.second; });
}

double arch_chord_m(double half_angle_rad) {
  return half_angle_rad < 1e-4 ? kLength_m * (1 - half_angle_rad * half_angle_rad / 6)
                               : kLength_m * std::sin(half_angle_rad) / half_angle_rad;
}

Animation animate(Staging staging) {
  Animation animation;
  animation.duration_s = staging.duration_s;
  animation.on_table = staging.on_table;
  animation.is_held = [back = staging.back_held_s, front = staging.front_held_s](double t, double u, double) {
    return (u < 1e-6 && within(back, t)) || (u > kLength_m - 1e-6 && within(front, t));
  };
  animation.map_at = [staging = std::move(staging)](double t) -> MaterialMap {
    const double arch_rad = staging.arch_rad.at(t);
    const double front_x = staging.back_x_m.at(t) + arch_chord_m(arch_rad);
    const double bend = 2 * arch_rad / kLength_m + staging.further_curvature_per_m.at(t);
    const double rise = arch_rad + staging.further_rise_rad.at(t);
    double swing = 0;
    for (const WaveOptions& wave : staging.waves) {
      const double swell = smooth_step((t - wave.start_s) / wave.ramp_s) - smooth_step((t - wave.end_s) / wave.ramp_s);
      swing += kSwing_rad * swell * std::sin(kCycle_rad * wave.frequency_hz * (t - wave.start_s));
    }
    // In the strip's own frame s runs from the front edge along +x; mirrored in x it runs toward the back.
    const ArcCurve curve = strip_curve(kLength_m, {0, staging.front_height_m.at(t), -(rise + swing)}, [&](double s) {
      double curvature = bend;
      for (const WaveOptions& wave : staging.waves) {
        curvature += wave_curvature_per_m(wave, kLength_m, s, t);
      }
      return curvature;
    });
    return [curve, front_x](double u, double v) -> Point3 {
      const ArcCurve::Pose pose = curve.at(kLength_m - u);
      return {front_x - pose.x_m, v - kWidth_m / 2, pose.z_m};
    };
  };
  return animation;
}

Animation bend_demo() {
  const Score arch(0, {{0.4, 1.8, kArch_rad}, {2.1, 3.0, 0.4 * kArch_rad}, {3.1, 3.8, kArch_rad}});
  return animate({4.2, true, Score(0), arch, Score(0), Score(0), Score(0), {}, {{0, 9}}, {{0, 9}}});
}

Animation slide_demo() {
  const Score path(0, {{0.3, 1.1, 0.15}, {1.3, 2.7, 0.0}, {2.9, 3.4, 0.2}, {3.5, 3.9, 0.0}});
  return animate({4.3, true, path, Score(0.9), Score(0), Score(0), Score(0), {}, {}, {{0, 9}}});
}

/// What turns the arch into a sheet that stands on its front edge, bent the other way: it overshoots and rings.
struct Spring {
  std::vector<Mark> rise, curvature;
};
Spring spring_up(double start_s) {
  const double arch_per_m = 2 * kArch_rad / kLength_m;
  return {{{start_s, start_s + 0.18, 1.95 - kArch_rad},
           {start_s + 0.18, start_s + 0.38, 1.65 - kArch_rad},
           {start_s + 0.38, start_s + 0.60, 1.72 - kArch_rad}},
          {{start_s, start_s + 0.15, -1.50 * arch_per_m},
           {start_s + 0.16, start_s + 0.34, -1.15 * arch_per_m},
           {start_s + 0.34, start_s + 0.54, -1.32 * arch_per_m}}};
}

Animation snap_demo() {
  Spring spring = spring_up(0.8);
  spring.rise.push_back({1.8, 2.6, 0});
  spring.curvature.push_back({1.8, 2.6, 0});
  const Spring again = spring_up(3.0);
  spring.rise.insert(spring.rise.end(), again.rise.begin(), again.rise.end());
  spring.curvature.insert(spring.curvature.end(), again.curvature.begin(), again.curvature.end());
  return animate({4.0,
                  true,
                  Score(0),
                  Score(kArch_rad),
                  Score(0),
                  Score(0, spring.rise),
                  Score(0, spring.curvature),
                  {},
                  {{0, 0.8}, {2.6, 3.0}},
                  {{0, 9}}});
}

WaveOptions shaking(double start_s, double end_s) {
  WaveOptions wave;
  wave.start_s = start_s;
  wave.end_s = end_s;
  return wave;
}

constexpr double kShakeHeight_m = 0.45;
constexpr double kShakeRise_rad = -0.3;
constexpr double kSag_per_m = 1.2;

Animation shake_demo() {
  return animate({4.0,
                  true,
                  Score(0),
                  Score(0),
                  Score(kShakeHeight_m),
                  Score(kShakeRise_rad),
                  Score(kSag_per_m),
                  {shaking(0.3, 3.2)},
                  {},
                  {{0, 9}}});
}

/// Flat until 0.3 s, bowed up until 1.7, slid from 1.9 to 3.0, released at 3.2, lifted from 3.9 to 4.6, shaken until 7.1.
Animation whole_demo() {
  const Score back(0, {{1.9, 2.4, 0.10}, {2.5, 3.0, 0.0}});
  const Score arch(0, {{0.3, 1.7, kArch_rad}});
  Spring spring = spring_up(3.2);
  spring.rise.push_back({3.9, 4.6, kShakeRise_rad - kArch_rad});
  spring.curvature.push_back({3.9, 4.6, kSag_per_m - 2 * kArch_rad / kLength_m});
  return animate({7.6,
                  true,
                  back,
                  arch,
                  Score(0, {{3.9, 4.6, kShakeHeight_m}}),
                  Score(0, spring.rise),
                  Score(0, spring.curvature),
                  {shaking(4.5, 6.7)},
                  {{0, 3.2}},
                  {{0, 9}}});
}

constexpr std::array<std::string_view, 5> kDemoNames = {"bend_slide_snap_shake", "bend", "slide", "snap", "shake"};

}  // namespace

std::span<const std::string_view> demo_names() {
  return kDemoNames;
}

std::unique_ptr<AnimatedSheet> make_demo(std::string_view name, std::size_t triangle_count, std::uint64_t seed) {
  if (std::find(kDemoNames.begin(), kDemoNames.end(), name) == kDemoNames.end()) return nullptr;
  return make_demo_on(make_rectangle(MeshKind::kDelaunay, kLength_m, kWidth_m, triangle_count, seed), name);
}

std::unique_ptr<AnimatedSheet> make_demo_on(SheetMesh mesh, std::string_view name) {
  const std::array<Animation (*)(), 5> makers = {whole_demo, bend_demo, slide_demo, snap_demo, shake_demo};
  for (std::size_t k = 0; k < kDemoNames.size(); ++k) {
    if (kDemoNames[k] == name) return make_animated(std::move(mesh), makers[k]());
  }
  return nullptr;
}

}  // namespace rustle::sheets
