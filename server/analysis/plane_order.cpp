#include "server/analysis/plane_order.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cassert>
#include <tuple>
#include <utility>

namespace rustle::analysis {
namespace {

/// Place along the Hilbert curve of 2^16 by 2^16 cells.
std::uint64_t hilbert_place(std::uint32_t x, std::uint32_t y) {
  std::uint64_t place = 0;
  for (std::uint32_t half = 1u << 15; half > 0; half /= 2) {
    const std::uint32_t right = (x & half) != 0, upper = (y & half) != 0;
    place = 4 * place + ((3 * right) ^ upper);
    if (upper) continue;
    if (right) x = ~x, y = ~y;
    std::swap(x, y);
  }
  return place;
}

}  // namespace

std::vector<std::uint32_t> along_hilbert_curve(const PlanePoints& points) {
  assert(points.component.size() == points.at_m.size());
  Eigen::AlignedBox2d box;
  for (const sheet::Vec2d& point : points.at_m) box.extend(point);
  const double cells_per_m = 65535 / std::max(box.isEmpty() ? 0.0 : box.sizes().maxCoeff(), 1e-12);
  struct Place {
    std::uint32_t component;
    std::uint64_t along;
    std::uint32_t point;
  };
  std::vector<Place> places;
  places.reserve(points.at_m.size());
  for (std::uint32_t i = 0; i < points.at_m.size(); ++i) {
    const sheet::Vec2d cell = (points.at_m[i] - box.min()) * cells_per_m;
    const auto x = static_cast<std::uint32_t>(cell.x()), y = static_cast<std::uint32_t>(cell.y());
    places.push_back({points.component[i], hilbert_place(x, y), i});
  }
  std::sort(places.begin(), places.end(), [](const Place& a, const Place& b) {
    return std::tie(a.component, a.along, a.point) < std::tie(b.component, b.along, b.point);
  });
  std::vector<std::uint32_t> out;
  out.reserve(places.size());
  for (const Place& place : places) out.push_back(place.point);
  return out;
}

}  // namespace rustle::analysis
