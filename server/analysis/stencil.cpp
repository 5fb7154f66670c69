#include "server/analysis/stencil.h"

#include <Eigen/LU>
#include <algorithm>
#include <cassert>
#include <cmath>
#include <numeric>
#include <tuple>
#include <type_traits>
#include <utility>

#include "server/sheet/point_grid.h"
#include "server/sheet/simd.h"

namespace rustle::analysis {

using sheet::Vec2d;

namespace {

constexpr double kSliverHeight = 0.01;    // of the edge's length
constexpr double kRegularization = 1e-3;  // of the mean diagonal

/// The node of every vertex, numbered in order of cells.
std::vector<std::uint32_t> nodes_of_vertices(const sheet::RestPlane& plane, double cell_m) {
  struct Place {
    std::uint32_t component;
    std::int64_t x, y;
    std::uint32_t vertex;
    auto cell() const { return std::tie(component, y, x); }
  };
  std::vector<Place> places(plane.coordinates_m.size());
  for (std::uint32_t i = 0; i < places.size(); ++i) {
    const Vec2d cell = plane.coordinates_m[i] / cell_m;
    places[i] = {plane.component[i], std::llround(std::floor(cell.x())), std::llround(std::floor(cell.y())), i};
  }
  std::sort(places.begin(), places.end(), [](const Place& a, const Place& b) {
    return std::tie(a.component, a.y, a.x, a.vertex) < std::tie(b.component, b.y, b.x, b.vertex);
  });
  std::vector<std::uint32_t> node(places.size());
  std::uint32_t next = 0;
  for (std::size_t k = 0; k < places.size(); ++k) {
    if (k > 0 && places[k].cell() != places[k - 1].cell()) ++next;
    node[places[k].vertex] = next;
  }
  return node;
}

}  // namespace

Stencil kernel(const PlanePoints& targets, std::span<const double> radii_m, const PlanePoints& sources) {
  Stencil out;
  const std::size_t rows = targets.at_m.size();
  out.start.assign(rows + 1, 0);
  if (sources.at_m.empty()) return out;
  double mean_radius = 0;
  for (double r : radii_m) mean_radius += r / static_cast<double>(rows);
  const sheet::PointGrid<2> grid(sources.at_m, mean_radius / 2);
  for (std::size_t i = 0; i < rows; ++i) {
    const double per_squared_radius = 1 / (radii_m[i] * radii_m[i]);
    grid.within(targets.at_m[i], radii_m[i], [&](std::uint32_t j, double d2) {
      if (sources.component[j] != targets.component[i]) return;
      const double w = std::max(1 - d2 * per_squared_radius, 1e-6);
      out.entries.push_back({j, static_cast<float>(w * w)});
    });
    if (out.entries.size() == out.start[i]) {
      const auto hit =
          grid.nearest(targets.at_m[i], [&](std::uint32_t j) { return sources.component[j] == targets.component[i]; });
      if (hit.index != sheet::kNone) out.entries.push_back({hit.index, 1.0f});
    }
    out.start[i + 1] = static_cast<std::uint32_t>(out.entries.size());
  }
  return out;
}

std::vector<std::uint32_t> sort_rows(Stencil& rows, std::span<const std::uint32_t> place_of_target) {
  constexpr std::ptrdiff_t kBlock = 512;
  std::vector<std::uint32_t> targets(rows.rows());
  std::iota(targets.begin(), targets.end(), 0u);
  std::sort(targets.begin(), targets.end(), [&](std::uint32_t a, std::uint32_t b) {
    return std::pair(place_of_target[a], a) < std::pair(place_of_target[b], b);
  });
  for (auto first = targets.begin(); first != targets.end();) {
    const auto last = first + std::min(kBlock, targets.end() - first);
    std::sort(first, last, [&](std::uint32_t a, std::uint32_t b) {
      return std::pair(rows.row(a).size(), a) < std::pair(rows.row(b).size(), b);
    });
    first = last;
  }
  Stencil sorted;
  sorted.start.push_back(0);
  sorted.entries.reserve(rows.entries.size());
  for (const std::uint32_t i : targets) {
    const auto row = rows.row(i);
    sorted.entries.insert(sorted.entries.end(), row.begin(), row.end());
    sorted.start.push_back(static_cast<std::uint32_t>(sorted.entries.size()));
  }
  rows = std::move(sorted);
  return targets;
}

HingeBasis hinge_basis(const sheet::Topology& topology, const sheet::RestPlane& plane) {
  HingeBasis out;
  out.hinges = sheet::hinges(topology);
  const std::size_t count = out.hinges.size();
  out.midpoints.at_m.reserve(count), out.midpoints.component.reserve(count), out.response.reserve(count);
  out.crossing_m.reserve(count), out.weight_m2.reserve(count), out.length_m.reserve(count), out.area_m2.reserve(count);
  out.along.reserve(count);
  for (std::size_t k = 0; k < count; ++k) {
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
    out.along.push_back(u);
  }
  return out;
}

MomentNodes moment_nodes(const sheet::RestPlane& plane, const HingeBasis& basis, double cell_m) {
  MomentNodes out;
  out.of_vertex = nodes_of_vertices(plane, cell_m);
  const std::vector<std::uint32_t>& node = out.of_vertex;
  const std::uint32_t count = node.empty() ? 0 : *std::max_element(node.begin(), node.end()) + 1;
  out.points.at_m.assign(count, Vec2d::Zero());
  out.points.component.assign(count, 0);
  std::vector<double> members(count, 0.0);
  for (std::size_t i = 0; i < node.size(); ++i) {
    out.points.at_m[node[i]] += plane.coordinates_m[i];
    out.points.component[node[i]] = plane.component[i];
    members[node[i]] += 1;
  }
  for (std::uint32_t n = 0; n < count; ++n) out.points.at_m[n] /= members[n];

  out.normal_matrix.assign(count, Eigen::Matrix3d::Zero());
  out.area_m2.assign(count, 0.0);
  for (std::size_t k = 0; k < basis.hinges.size(); ++k) {
    const Eigen::Vector3d& response = basis.response[k];
    const Eigen::Vector3d told = basis.weight_m2[k] / (2 * basis.crossing_m[k]) * response;
    out.factor.push_back(Eigen::Array4d(told[0], told[1], told[2], basis.length_m[k] / 2).cast<float>());
    out.hinge_normal.push_back(basis.weight_m2[k] / 2 * response * response.transpose());
    out.ends.push_back({node[basis.hinges[k][0]], node[basis.hinges[k][1]]});
    for (const std::uint32_t n : out.ends.back()) {
      out.normal_matrix[n] += out.hinge_normal.back();
      out.area_m2[n] += basis.area_m2[k] / 2;
    }
  }
  return out;
}

void sort_by_node(MomentNodes& nodes, std::vector<sheet::Hinge>& hinges) {
  std::vector<std::uint32_t> order(hinges.size());
  std::iota(order.begin(), order.end(), 0u);
  std::sort(order.begin(), order.end(),
            [&](std::uint32_t a, std::uint32_t b) { return std::tie(nodes.ends[a], a) < std::tie(nodes.ends[b], b); });
  const auto sorted = [&](auto& values) {
    std::remove_reference_t<decltype(values)> out;
    out.reserve(order.size());
    for (const std::uint32_t k : order) out.push_back(values[k]);
    values = std::move(out);
  };
  sorted(hinges), sorted(nodes.factor), sorted(nodes.ends);
  nodes.hinge_normal.clear();
}

namespace {

/// Hinges one after another often meet at a node: from several places at once, no sum waits for the one before.
RUSTLE_SIMD void add_moments(const std::array<std::uint32_t, 2>* ends, const Moment* factor, const float* angles_rad,
                             std::size_t count, Moment* out) {
  const auto add = [&](std::size_t k) {
    const float angle = angles_rad[k];
    const Moment told = factor[k] * Moment(angle, angle, angle, std::fabs(angle));
    out[ends[k][0]] += told;
    out[ends[k][1]] += told;
  };
  constexpr std::size_t kPlaces = 4;
  const std::size_t part = count / kPlaces;
  for (std::size_t k = 0; k < part; ++k) {
    for (std::size_t place = 0; place < kPlaces; ++place) add(place * part + k);
  }
  for (std::size_t k = kPlaces * part; k < count; ++k) add(k);
}

}  // namespace

void gather_moments(const MomentNodes& nodes, std::span<const float> angles_rad, std::vector<Moment>& out) {
  assert(angles_rad.size() == nodes.factor.size());
  out.assign(nodes.points.at_m.size(), Moment::Zero());
  add_moments(nodes.ends.data(), nodes.factor.data(), angles_rad.data(), angles_rad.size(), out.data());
}

Eigen::Matrix3d normal_matrix_of(std::span<const Stencil::Entry> row, const std::vector<Eigen::Matrix3d>& normal_matrices) {
  Eigen::Matrix3d out = Eigen::Matrix3d::Zero();
  for (const auto& [node, weight] : row) out += static_cast<double>(weight) * normal_matrices[node];
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
