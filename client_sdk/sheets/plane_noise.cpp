#include "client_sdk/sheets/plane_noise.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "client_sdk/sheets/animated_sheet.h"

namespace rustle::sheets {
namespace {

std::uint64_t mixed(std::uint64_t z) {
  z += 0x9e3779b97f4a7c15u;
  z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9u;
  z = (z ^ (z >> 27)) * 0x94d049bb133111ebu;
  return z ^ (z >> 31);
}

/// The slope of a random direction at a lattice point, seen from (dx, dy) beside it.
double slope(std::uint64_t seed, std::int64_t i, std::int64_t j, double dx, double dy) {
  const double angle = 2 * std::numbers::pi * hashed_unit(seed, i, j);
  return std::cos(angle) * dx + std::sin(angle) * dy;
}

}  // namespace

double hashed_unit(std::uint64_t seed, std::int64_t a, std::int64_t b) {
  const std::uint64_t z = mixed(mixed(mixed(seed) ^ static_cast<std::uint64_t>(a)) ^ static_cast<std::uint64_t>(b));
  return static_cast<double>(z >> 11) * 0x1p-53;
}

double perlin_noise(std::uint64_t seed, double x, double y) {
  const double fx = std::floor(x), fy = std::floor(y);
  const auto i = static_cast<std::int64_t>(fx), j = static_cast<std::int64_t>(fy);
  const double dx = x - fx, dy = y - fy;
  const double u = smooth_step(dx), v = smooth_step(dy);
  const double low = std::lerp(slope(seed, i, j, dx, dy), slope(seed, i + 1, j, dx - 1, dy), u);
  const double high = std::lerp(slope(seed, i, j + 1, dx, dy - 1), slope(seed, i + 1, j + 1, dx - 1, dy - 1), u);
  // Slopes of unit length reach √½ at most.
  return std::clamp(0.5 + std::lerp(low, high, v) / std::numbers::sqrt2, 0.0, 1.0);
}

}  // namespace rustle::sheets
