#include "server/analysis/plane_lattice.h"

#include <cassert>
#include <cmath>
#include <map>
#include <tuple>

namespace rustle::analysis {

PlaneLattice plane_lattice(const PlanePoints& vertices, std::span<const double> radii_m, double radius_m, double cell_m) {
  assert(radii_m.size() == vertices.at_m.size());
  PlaneLattice out;
  const auto add = [&out](const sheet::Vec2d& at_m, std::uint32_t component, double radius) {
    out.points.at_m.push_back(at_m);
    out.points.component.push_back(component);
    out.radius_m.push_back(radius);
    return static_cast<std::uint32_t>(out.radius_m.size() - 1);
  };
  std::map<std::tuple<std::uint32_t, std::int64_t, std::int64_t>, std::uint32_t> corners;
  out.places.reserve(radii_m.size());
  for (std::size_t i = 0; i < radii_m.size(); ++i) {
    const std::uint32_t component = vertices.component[i];
    if (radii_m[i] != radius_m) {
      const std::uint32_t own = add(vertices.at_m[i], component, radii_m[i]);
      out.places.push_back({{own, own, own, own}, {1, 0, 0, 0}});
      continue;
    }
    const sheet::Vec2d cells = vertices.at_m[i] / cell_m;
    const std::int64_t x = std::llround(std::floor(cells.x())), y = std::llround(std::floor(cells.y()));
    const double across = cells.x() - static_cast<double>(x), up = cells.y() - static_cast<double>(y);
    PlaneLattice::Place place;
    for (std::size_t corner = 0; corner < 4; ++corner) {
      const std::int64_t right = corner % 2, above = corner / 2;
      const auto [known, added] = corners.try_emplace({component, x + right, y + above}, 0);
      if (added) {
        known->second =
            add(cell_m * sheet::Vec2d(static_cast<double>(x + right), static_cast<double>(y + above)), component, radius_m);
      }
      place.point[corner] = known->second;
      place.share[corner] = static_cast<float>((right ? across : 1 - across) * (above ? up : 1 - up));
    }
    out.places.push_back(place);
  }
  return out;
}

void interpolate(const PlaneLattice& lattice, std::span<const float> a_at_points, std::span<const float> b_at_points,
                 std::span<float> a, std::span<float> b) {
  assert(a.size() == lattice.places.size() && b.size() == lattice.places.size());
  for (std::size_t i = 0; i < lattice.places.size(); ++i) {
    const auto& [point, share] = lattice.places[i];
    a[i] = (share[0] * a_at_points[point[0]] + share[1] * a_at_points[point[1]]) +
           (share[2] * a_at_points[point[2]] + share[3] * a_at_points[point[3]]);
    b[i] = (share[0] * b_at_points[point[0]] + share[1] * b_at_points[point[1]]) +
           (share[2] * b_at_points[point[2]] + share[3] * b_at_points[point[3]]);
  }
}

}  // namespace rustle::analysis
