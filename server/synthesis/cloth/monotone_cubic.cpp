#include "server/synthesis/cloth/monotone_cubic.h"

#include <cmath>

namespace rustle::cloth {
namespace {

/// Between two secants over the intervals h and k.
double inner_slope(double h, double k, double secant_h, double secant_k) noexcept {
  if (!(secant_h * secant_k > 0)) return 0;
  const double w = 2 * k + h, v = k + 2 * h;
  return (w + v) / (w / secant_h + v / secant_k);
}

/// At the end of interval h, whose neighbour is k: of the parabola through the three samples, held so as not to overshoot.
double end_slope(double h, double k, double secant_h, double secant_k) noexcept {
  const double slope = ((2 * h + k) * secant_h - h * secant_k) / (h + k);
  if (!(slope * secant_h > 0)) return 0;
  if (secant_h * secant_k < 0 && std::abs(slope) > std::abs(3 * secant_h)) return 3 * secant_h;
  return slope;
}

}  // namespace

double monotone_cubic(const TrackInterval& interval, double at) noexcept {
  const auto& [t, y, before, after] = interval;
  if (at <= t[1]) return y[1];
  if (at >= t[2]) return y[2];
  const double h = t[2] - t[1], secant = (y[2] - y[1]) / h;
  const double h0 = before ? t[1] - t[0] : 0, secant0 = before ? (y[1] - y[0]) / h0 : 0;
  const double h2 = after ? t[3] - t[2] : 0, secant2 = after ? (y[3] - y[2]) / h2 : 0;
  const double slope1 = before ? inner_slope(h0, h, secant0, secant) : after ? end_slope(h, h2, secant, secant2) : secant;
  const double slope2 = after ? inner_slope(h, h2, secant, secant2) : before ? end_slope(h, h0, secant, secant0) : secant;
  const double s = (at - t[1]) / h, r = 1 - s;
  return r * r * ((1 + 2 * s) * y[1] + s * h * slope1) + s * s * ((1 + 2 * r) * y[2] - r * h * slope2);
}

}  // namespace rustle::cloth
