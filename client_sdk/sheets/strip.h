#pragma once

#include <functional>

#include "client_sdk/sheets/shape.h"

namespace rustle::sheets {

/// The plane curve of length `length_m` with the given curvature along it, as 256 arcs that join smoothly: lengths along it
/// are exact, its shape is that of the curvature to second order. `start` is its pose at s = 0.
[[nodiscard]] ArcCurve strip_curve(double length_m, ArcCurve::Pose start,
                                   const std::function<double(double s_m)>& curvature_per_m);

}  // namespace rustle::sheets
