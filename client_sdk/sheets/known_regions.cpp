#include "client_sdk/sheets/known_regions.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>

namespace rustle::sheets {
namespace {

/// Length of the line through a point within the rectangle.
double length_within(const NamedShape& sheet, const std::array<double, 2>& point, const std::array<double, 2>& direction) {
  const std::array<double, 2> extent = {sheet.width_m, sheet.height_m};
  double ahead = std::numeric_limits<double>::infinity();
  double behind = ahead;
  for (std::size_t k = 0; k < 2; ++k) {
    if (direction[k] == 0) continue;
    const double to_low = -point[k] / direction[k];
    const double to_high = (extent[k] - point[k]) / direction[k];
    ahead = std::min(ahead, std::max(to_low, to_high));
    behind = std::min(behind, -std::min(to_low, to_high));
  }
  return ahead + behind;
}

struct Sums {
  double points = 0, curvature = 0, ruling = 0, u = 0, v = 0, border = 0;
};

}  // namespace

std::vector<KnownRegion> known_regions(const NamedShape& sheet, double flat_bending_per_m) {
  constexpr int kPoints = 400;
  constexpr int kBorderPoints = 4000;
  const Shape& shape = *sheet.shape;
  std::map<int, Sums> pieces;
  for (int i = 0; i < kPoints; ++i) {
    for (int j = 0; j < kPoints; ++j) {
      const std::array<double, 2> at = {sheet.width_m * (i + 0.5) / kPoints, sheet.height_m * (j + 0.5) / kPoints};
      const int piece = shape.piece(at[0], at[1]);
      if (piece == Shape::kInRidge) continue;
      Sums& sums = pieces[piece];
      sums.points += 1;
      sums.curvature += std::abs(shape.curvature_per_m(at[0], at[1]));
      sums.ruling += length_within(sheet, at, shape.ruling(at[0], at[1]));
      sums.u += at[0];
      sums.v += at[1];
    }
  }
  const std::array<std::array<double, 2>, 4> corners = {
      {{0, 0}, {sheet.width_m, 0}, {sheet.width_m, sheet.height_m}, {0, sheet.height_m}}};
  for (std::size_t side = 0; side < 4; ++side) {
    const auto& a = corners[side];
    const auto& b = corners[(side + 1) % 4];
    const std::array<double, 2> step = {(b[0] - a[0]) / kBorderPoints, (b[1] - a[1]) / kBorderPoints};
    const double length_m = std::hypot(step[0], step[1]);
    for (int k = 0; k < kBorderPoints; ++k) {
      const std::array<double, 2> at = {a[0] + step[0] * (k + 0.5), a[1] + step[1] * (k + 0.5)};
      const auto ruling = shape.ruling(at[0], at[1]);
      const double cosine = (ruling[0] * step[0] + ruling[1] * step[1]) / length_m;
      const double across_per_m = std::abs(shape.curvature_per_m(at[0], at[1])) * (1 - cosine * cosine);
      const int piece = shape.piece(at[0], at[1]);
      if (piece != Shape::kInRidge && across_per_m > flat_bending_per_m) pieces[piece].border += length_m;
    }
  }
  std::vector<KnownRegion> regions;
  for (const auto& [piece, sums] : pieces) {
    if (sums.points == 0) continue;
    KnownRegion& region = regions.emplace_back();
    region.area_m2 = sums.points / (kPoints * kPoints) * sheet.width_m * sheet.height_m;
    region.centroid_m = {sums.u / sums.points, sums.v / sums.points};
    region.constrained = sums.curvature / sums.points <= flat_bending_per_m || sums.border == 0;
    if (region.constrained) continue;
    region.ruling_length_m = sums.ruling / sums.points;
    region.free_border_length_m = sums.border;
  }
  std::stable_sort(regions.begin(), regions.end(), [](const auto& a, const auto& b) { return a.area_m2 > b.area_m2; });
  return regions;
}

}  // namespace rustle::sheets
