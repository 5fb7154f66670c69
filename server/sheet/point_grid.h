#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <span>
#include <vector>

#include "server/sheet/topology.h"

namespace rustle::sheet {

/// Points in the plane or in space, sorted into the cells of a regular grid, for neighbour queries.
/// Visits points in an order that depends only on the points. Build O(N), a query O(points near).
template <int Dim>
class PointGrid {
 public:
  using Point = Eigen::Matrix<double, Dim, 1>;
  struct Hit {
    std::uint32_t index = kNone;
    double squared_distance_m2 = std::numeric_limits<double>::infinity();
  };

  /// \pre all points finite; `cell_m` is a hint: cells grow until their number is of the order of the points.
  PointGrid(std::span<const Point> points, double cell_m) : points_(points.begin(), points.end()) {
    Point high = Point::Zero();
    if (!points_.empty()) low_ = high = points_[0];
    for (const Point& p : points_) low_ = low_.cwiseMin(p), high = high.cwiseMax(p);
    const Point extent = high - low_;
    cell_m_ = std::max({cell_m, extent.maxCoeff() * 1e-4, 1e-12});
    const double most = 4.0 * static_cast<double>(points_.size()) + 64.0;
    while (cell_count_at(extent, cell_m_) > most) cell_m_ *= 1.26;
    std::size_t cells = 1;
    for (int d = 0; d < Dim; ++d) {
      size_[d] = static_cast<std::int64_t>(extent[d] / cell_m_) + 1;
      cells *= static_cast<std::size_t>(size_[d]);
    }
    start_.assign(cells + 1, 0);
    for (const Point& p : points_) ++start_[index_of(cell_of(p)) + 1];
    for (std::size_t c = 0; c < cells; ++c) start_[c + 1] += start_[c];
    order_.resize(points_.size());
    std::vector<std::uint32_t> next(start_.begin(), start_.end() - 1);
    for (std::uint32_t i = 0; i < points_.size(); ++i) order_[next[index_of(cell_of(points_[i]))]++] = i;
  }

  /// Calls visit(index, squared distance) for every point within the radius.
  template <class Visit>
  void within(const Point& centre, double radius_m, Visit&& visit) const {
    const double r2 = radius_m * radius_m;
    visit_box(cell_of(centre - Point::Constant(radius_m)), cell_of(centre + Point::Constant(radius_m)),
              [&](std::uint32_t i) {
                const double d2 = (points_[i] - centre).squaredNorm();
                if (d2 <= r2) visit(i, d2);
              });
  }

  /// The closest point for which accept(index) holds; of equally close ones the lowest index.
  template <class Accept>
  Hit nearest(const Point& centre, Accept&& accept) const {
    Hit best;
    const Cell middle = cell_of(centre);
    const std::int64_t rings = *std::max_element(size_.begin(), size_.end());
    double outside = 0;  // distance from the centre to the grid, when it lies beyond
    for (int d = 0; d < Dim; ++d) {
      const double high = low_[d] + static_cast<double>(size_[d]) * cell_m_;
      outside = std::max({outside, low_[d] - centre[d], centre[d] - high});
    }
    for (std::int64_t ring = 0; ring <= rings; ++ring) {
      const double reached = std::max(outside, static_cast<double>(ring - 1) * cell_m_);
      if (ring > 0 && best.squared_distance_m2 < reached * reached && best.index != kNone) break;
      visit_ring(middle, ring, [&](std::uint32_t i) {
        const double d2 = (points_[i] - centre).squaredNorm();
        if ((d2 < best.squared_distance_m2 || (d2 == best.squared_distance_m2 && i < best.index)) && accept(i))
          best = {i, d2};
      });
    }
    return best;
  }
  Hit nearest(const Point& centre) const {
    return nearest(centre, [](std::uint32_t) { return true; });
  }

 private:
  using Cell = std::array<std::int64_t, Dim>;

  static double cell_count_at(const Point& extent, double cell_m) {
    double count = 1;
    for (int d = 0; d < Dim; ++d) count *= std::floor(extent[d] / cell_m) + 1;
    return count;
  }
  Cell cell_of(const Point& p) const {
    Cell cell;
    for (int d = 0; d < Dim; ++d) {
      const double x = std::clamp((p[d] - low_[d]) / cell_m_, 0.0, static_cast<double>(size_[d] - 1));
      cell[d] = static_cast<std::int64_t>(x);
    }
    return cell;
  }
  std::size_t index_of(const Cell& cell) const {
    std::int64_t index = 0;
    for (int d = 0; d < Dim; ++d) index = index * size_[d] + cell[d];
    return static_cast<std::size_t>(index);
  }
  template <class Visit>
  void visit_cell(const Cell& cell, Visit&& visit) const {
    const std::size_t c = index_of(cell);
    for (std::uint32_t k = start_[c]; k < start_[c + 1]; ++k) visit(order_[k]);
  }
  template <class Visit>
  void visit_box(const Cell& from, const Cell& to, Visit&& visit) const {
    Cell cell = from;
    while (true) {
      visit_cell(cell, visit);
      int d = Dim - 1;
      while (d >= 0 && ++cell[d] > to[d]) cell[d] = from[d], --d;
      if (d < 0) return;
    }
  }
  template <class Visit>
  void visit_ring(const Cell& middle, std::int64_t ring, Visit&& visit) const {
    Cell from, to;
    for (int d = 0; d < Dim; ++d) {
      from[d] = std::max<std::int64_t>(middle[d] - ring, 0);
      to[d] = std::min<std::int64_t>(middle[d] + ring, size_[d] - 1);
    }
    Cell cell = from;
    while (true) {
      std::int64_t away = 0;
      for (int d = 0; d < Dim; ++d) away = std::max(away, std::abs(cell[d] - middle[d]));
      if (away == ring) visit_cell(cell, visit);
      int d = Dim - 1;
      while (d >= 0 && ++cell[d] > to[d]) cell[d] = from[d], --d;
      if (d < 0) return;
    }
  }

  std::vector<Point> points_;
  Point low_ = Point::Zero();
  double cell_m_ = 1;
  std::array<std::int64_t, Dim> size_{};
  std::vector<std::uint32_t> start_, order_;
};

}  // namespace rustle::sheet
