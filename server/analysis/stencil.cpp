#include "server/analysis/stencil.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>

#include "server/sheet/point_grid.h"

namespace rustle::analysis {

using sheet::Vec2d;

namespace {
constexpr double kSliverHeight = 0.01;    // of the edge's length
constexpr double kRegularization = 1e-3;  // of the mean diagonal
}  // namespace

Stencil kernel(const PlanePoints& targets, std::span<const double> radii_m, const PlanePoints& sources, std::size_t most) {
  Stencil out;
  const std::size_t rows = targets.at_m.size();
  out.start.assign(rows + 1, 0);
  if (sources.at_m.empty()) return out;
  double mean_radius = 0;
  for (double r : radii_m) mean_radius += r / static_cast<double>(rows);
  const sheet::PointGrid<2> grid(sources.at_m, mean_radius / 2);
  struct Near {
    double squared_distance;
    std::uint32_t index;
  };
  std::vector<Near> near;
  for (std::size_t i = 0; i < rows; ++i) {
    near.clear();
    grid.within(targets.at_m[i], radii_m[i], [&](std::uint32_t j, double d2) {
      if (sources.component[j] == targets.component[i]) near.push_back({d2, j});
    });
    if (near.empty()) {
      const auto hit =
          grid.nearest(targets.at_m[i], [&](std::uint32_t j) { return sources.component[j] == targets.component[i]; });
      if (hit.index != sheet::kNone) {
        out.source.push_back(hit.index);
        out.weight.push_back(1.0f);
      }
    } else if (near.size() > most) {
      for (std::size_t k = 0; k < most; ++k) near[k] = near[(2 * k + 1) * near.size() / (2 * most)];
      near.resize(most);
    }
    std::sort(near.begin(), near.end(), [](const Near& a, const Near& b) { return a.index < b.index; });
    for (const Near& n : near) {
      const double w = std::max(1 - n.squared_distance / (radii_m[i] * radii_m[i]), 1e-6);
      out.source.push_back(n.index);
      out.weight.push_back(static_cast<float>(w * w));
    }
    out.start[i + 1] = static_cast<std::uint32_t>(out.source.size());
  }
  return out;
}

HingeBasis hinge_basis(const sheet::Topology& topology, const sheet::RestPlane& plane) {
  HingeBasis out;
  out.hinges = sheet::hinges(topology);
  for (std::size_t k = 0; k < out.hinges.size(); ++k) {
    const sheet::Hinge& h = out.hinges[k];
    const Vec2d &a = plane.coordinates_m[h[0]], &b = plane.coordinates_m[h[1]], &c = plane.coordinates_m[h[2]],
                &d = plane.coordinates_m[h[3]];
    const double length = std::max((b - a).norm(), 1e-12);
    const Vec2d u = (b - a) / length, n(-u.y(), u.x());
    const double xc = (c - a).dot(u), xd = (d - a).dot(u), yc = (c - a).dot(n), yd = -(d - a).dot(n);
    const bool sound = std::min(yc, yd) > kSliverHeight * length && topology.interior_edges()[k].consistent;
    const double hc = std::max(yc, kSliverHeight * length), hd = std::max(yd, kSliverHeight * length);
    const double along = (xc * (xc - length) / hc + xd * (xd - length) / hd) / 2, mixed = xc - xd, across = (hc + hd) / 2;
    out.response.push_back(
        Eigen::Vector3d(along * u.x() * u.x() + mixed * u.x() * n.x() + across * n.x() * n.x(),
                        2 * along * u.x() * u.y() + mixed * (u.x() * n.y() + u.y() * n.x()) + 2 * across * n.x() * n.y(),
                        along * u.y() * u.y() + mixed * u.y() * n.y() + across * n.y() * n.y()) /
        across);
    out.midpoints.at_m.push_back((a + b) / 2);
    out.midpoints.component.push_back(plane.component[h[0]]);
    out.crossing_m.push_back(across);
    out.weight_m2.push_back(sound ? length * across * 2 / 3 : 0.0);
    out.length_m.push_back(length);
    out.area_m2.push_back(length * across / 3);
  }
  return out;
}

Eigen::Matrix3d inverted_normal_matrix(const Eigen::Matrix3d& normal_matrix) {
  const double trace = normal_matrix.trace();
  if (!(trace > 0)) return Eigen::Matrix3d::Zero();
  const Eigen::Matrix3d inverse =
      (normal_matrix / trace + kRegularization / 3 * Eigen::Matrix3d::Identity()).inverse() / trace;
  return inverse.allFinite() ? inverse : Eigen::Matrix3d::Zero();
}

}  // namespace rustle::analysis
