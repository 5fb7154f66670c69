#include "client_sdk/sheets/motions.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numbers>
#include <utility>
#include <vector>

#include "client_sdk/sheets/strip.h"

namespace rustle::sheets {
namespace {

constexpr double kWaveCycle_rad = 2 * std::numbers::pi;

/// ∫ smooth_step from 0 to x.
double smooth_step_integral(double x) {
  if (x <= 0) return 0;
  if (x >= 1) return 0.5 + (x - 1);
  return x * x * x * x * (2.5 + x * (x - 3));
}

Point3 turn(const Point3& p, const Point3& axis_angle) {
  const double angle =
      std::sqrt(axis_angle[0] * axis_angle[0] + axis_angle[1] * axis_angle[1] + axis_angle[2] * axis_angle[2]);
  if (angle == 0) return p;
  const Point3 k = {axis_angle[0] / angle, axis_angle[1] / angle, axis_angle[2] / angle};
  const double c = std::cos(angle);
  const double s = std::sin(angle);
  const double along = k[0] * p[0] + k[1] * p[1] + k[2] * p[2];
  const Point3 cross = {k[1] * p[2] - k[2] * p[1], k[2] * p[0] - k[0] * p[2], k[0] * p[1] - k[1] * p[0]};
  return {p[0] * c + cross[0] * s + k[0] * along * (1 - c), p[1] * c + cross[1] * s + k[1] * along * (1 - c),
          p[2] * c + cross[2] * s + k[2] * along * (1 - c)};
}

}  // namespace

std::unique_ptr<AnimatedSheet> make_rigid_motion(SheetMesh mesh, std::shared_ptr<const Shape> shape,
                                                 const RigidMotionOptions& options) {
  Animation animation;
  animation.duration_s = options.duration_s;
  animation.map_at = [shape = std::move(shape), options](double t) -> MaterialMap {
    const Point3& w = options.angular_velocity_rad_per_s;
    const Point3& v = options.velocity_m_per_s;
    const Point3& x = options.start_m;
    const Point3 rotation = {w[0] * t, w[1] * t, w[2] * t};
    const Point3 shift = {x[0] + v[0] * t, x[1] + v[1] * t, x[2] + v[2] * t};
    return [shape, rotation, shift](double u, double w_m) -> Point3 {
      const Point3 p = turn(shape->at(u, w_m), rotation);
      return {p[0] + shift[0], p[1] + shift[1], p[2] + shift[2]};
    };
  };
  return make_animated(std::move(mesh), std::move(animation));
}

double ReversalOptions::curvature_at_per_m(double time_s) const {
  return curvature_per_m * (1 - 2 * smooth_step((time_s - start_s) / reversal_s));
}

std::unique_ptr<AnimatedSheet> make_reversal(SheetMesh mesh, const ReversalOptions& options) {
  Animation animation;
  animation.duration_s = options.start_s + options.reversal_s + options.rest_s;
  animation.map_at = [options](double t) -> MaterialMap {
    const BentShape shape(options.size.width_m, options.size.height_m, 0, {}, {options.curvature_at_per_m(t)});
    return [shape](double u, double v) { return shape.at(u, v); };
  };
  return make_animated(std::move(mesh), std::move(animation));
}

double SlideOptions::speed_at_m_per_s(double time_s) const {
  return speed_m_per_s * (smooth_step(time_s / ramp_s) - smooth_step((time_s - (duration_s - ramp_s)) / ramp_s));
}

double SlideOptions::distance_at_m(double time_s) const {
  const double t = std::clamp(time_s, 0.0, duration_s);
  return speed_m_per_s * ramp_s *
         (smooth_step_integral(t / ramp_s) - smooth_step_integral((t - (duration_s - ramp_s)) / ramp_s));
}

std::unique_ptr<AnimatedSheet> make_slide(SheetMesh mesh, const SlideOptions& options) {
  Animation animation;
  animation.duration_s = options.duration_s;
  animation.on_table = true;
  animation.map_at = [options](double t) -> MaterialMap {
    const RectangleSize& size = options.size;
    const BentShape shape(size.width_m, size.height_m, 0, {}, {options.curvature_per_m});
    const double lift_m = options.height_m - std::min(0.0, shape.at(0, 0)[2]);
    const double shift_m = options.distance_at_m(t);
    return [shape, lift_m, shift_m](double u, double v) -> Point3 {
      const Point3 p = shape.at(u, v);
      return {p[0] + shift_m, p[1], p[2] + lift_m};
    };
  };
  return make_animated(std::move(mesh), std::move(animation));
}

double wave_curvature_per_m(const WaveOptions& wave, double length_m, double s_m, double time_s) {
  const double swell = smooth_step((time_s - wave.start_s) / wave.ramp_s) - smooth_step((time_s - wave.end_s) / wave.ramp_s);
  const double grip = smooth_step(s_m / (0.25 * length_m));
  return wave.curvature_per_m * swell * grip *
         std::sin(kWaveCycle_rad * (s_m / wave.wavelength_m - wave.frequency_hz * (time_s - wave.start_s)));
}

std::unique_ptr<AnimatedSheet> make_shake(SheetMesh mesh, const ShakeOptions& options) {
  Animation animation;
  animation.duration_s = options.duration_s;
  animation.map_at = [options](double t) -> MaterialMap {
    const RectangleSize size = options.size;
    const double swell = smooth_step((t - options.wave.start_s) / options.wave.ramp_s) -
                         smooth_step((t - options.wave.end_s) / options.wave.ramp_s);
    const double swing =
        options.swing_rad * swell * std::sin(kWaveCycle_rad * options.wave.frequency_hz * (t - options.wave.start_s));
    const ArcCurve curve = strip_curve(size.width_m, {0, options.height_m, options.heading_rad + swing},
                                       [&](double s) { return wave_curvature_per_m(options.wave, size.width_m, s, t); });
    return [curve, size](double u, double v) -> Point3 {
      const ArcCurve::Pose pose = curve.at(u);
      return {pose.x_m, v - size.height_m / 2, pose.z_m};
    };
  };
  animation.is_held = [](double, double u, double) { return u < 1e-6; };
  return make_animated(std::move(mesh), std::move(animation));
}

}  // namespace rustle::sheets
