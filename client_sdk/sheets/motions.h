#pragma once

#include <memory>

#include "client_sdk/sheets/animated_sheet.h"

/// Motions with known answers. Each takes a mesh of the rectangle [0, width] x [0, height].
namespace rustle::sheets {

struct RectangleSize {
  double width_m = 0.297;
  double height_m = 0.210;
};

/// A shape moved as a rigid body: turned about an axis through the origin, then moved. No crumpling.
struct RigidMotionOptions {
  Point3 velocity_m_per_s = {0, 0, 0};
  Point3 angular_velocity_rad_per_s = {0, 0, 0};
  Point3 start_m = {0, 0, 0};
  double duration_s = 1;
};
[[nodiscard]] std::unique_ptr<AnimatedSheet> make_rigid_motion(SheetMesh mesh, std::shared_ptr<const Shape> shape,
                                                               const RigidMotionOptions& options);

/// A whole bend across x that goes from +curvature to -curvature: κ(t) = κ₀ (1 - 2 smooth_step((t - start)/duration)).
/// Mean curvature is κ/2 everywhere and zero exactly at zero_time_s().
struct ReversalOptions {
  RectangleSize size;
  double curvature_per_m = 5;
  double start_s = 0.5;  ///< still before
  double reversal_s = 0.2;
  double rest_s = 0.5;  ///< still after

  double zero_time_s() const { return start_s + reversal_s / 2; }
  double curvature_at_per_m(double time_s) const;
};
[[nodiscard]] std::unique_ptr<AnimatedSheet> make_reversal(SheetMesh mesh, const ReversalOptions& options);

/// A sheet that lies on the table and slides along +x. With a curvature it lies as an arch on its two straight edges
/// (κ > 0) or on the line of its lowest points (κ < 0). Speed rises as smooth_step over ramp_s, holds and falls alike.
struct SlideOptions {
  RectangleSize size;
  double curvature_per_m = 0;
  double speed_m_per_s = 0.1;
  double ramp_s = 0.1;
  double duration_s = 1;  ///< ramps included
  double height_m = 0;    ///< gap under the sheet, as simulators leave one

  double speed_at_m_per_s(double time_s) const;
  double distance_at_m(double time_s) const;
};
[[nodiscard]] std::unique_ptr<AnimatedSheet> make_slide(SheetMesh mesh, const SlideOptions& options);

/// Curvature along a strip held at one end, as a wave that travels to the free one:
///   κ(s, t) = K(t) g(s) sin 2π(s/wavelength - frequency (t - start)), g rising smoothly from 0 over the first quarter,
/// K(t) swelling and fading over ramp_s. Every place reverses twice a period.
struct WaveOptions {
  double curvature_per_m = 9;
  double wavelength_m = 0.45;
  double frequency_hz = 2.5;
  double start_s = 0.3;
  double ramp_s = 0.4;
  double end_s = 3;
};
[[nodiscard]] double wave_curvature_per_m(const WaveOptions& wave, double length_m, double s_m, double time_s);

/// The strip x = 0..width held along its edge x = 0 at a height, shaken; heading down by a fixed angle there.
struct ShakeOptions {
  RectangleSize size;
  WaveOptions wave;
  double height_m = 0.4;
  double heading_rad = 0.5;
  double swing_rad = 0.2;  ///< of the held edge, with the wave
  double duration_s = 3.5;
};
[[nodiscard]] std::unique_ptr<AnimatedSheet> make_shake(SheetMesh mesh, const ShakeOptions& options);

}  // namespace rustle::sheets
