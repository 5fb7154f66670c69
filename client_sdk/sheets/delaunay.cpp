#include "client_sdk/sheets/delaunay.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <utility>

namespace rustle::sheets {
namespace {

__extension__ using Wide = __int128;

constexpr std::uint32_t kInfinite = 0xffffffffu;  // the vertex beyond every edge of the hull
constexpr std::uint32_t kNoTriangle = 0xffffffffu;
constexpr int kBits = 26;

struct GridPoint {
  std::int64_t x, y;
};

/// Twice the area of abc, > 0 when counter-clockwise.
std::int64_t orientation(const GridPoint& a, const GridPoint& b, const GridPoint& c) {
  return (b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x);
}

/// > 0 when d lies inside the circle through the counter-clockwise a, b, c.
bool inside_circle(const GridPoint& a, const GridPoint& b, const GridPoint& c, const GridPoint& d) {
  const std::int64_t ax = a.x - d.x, ay = a.y - d.y, bx = b.x - d.x, by = b.y - d.y, cx = c.x - d.x, cy = c.y - d.y;
  const Wide a2 = Wide{ax} * ax + Wide{ay} * ay;
  const Wide b2 = Wide{bx} * bx + Wide{by} * by;
  const Wide c2 = Wide{cx} * cx + Wide{cy} * cy;
  return a2 * (bx * cy - by * cx) + b2 * (cx * ay - cy * ax) + c2 * (ax * by - ay * bx) > 0;
}

/// Position along a Hilbert curve over a 2^16 x 2^16 grid.
std::uint64_t hilbert_index(std::uint32_t x, std::uint32_t y) {
  std::uint64_t index = 0;
  for (std::uint32_t size = 1u << 15; size > 0; size >>= 1) {
    const std::uint32_t rx = (x & size) ? 1 : 0;
    const std::uint32_t ry = (y & size) ? 1 : 0;
    index += static_cast<std::uint64_t>(size) * size * ((3 * rx) ^ ry);
    if (ry == 0) {
      if (rx == 1) {
        x = 0xffffu - x;
        y = 0xffffu - y;
      }
      std::swap(x, y);
    }
  }
  return index;
}

class Triangulation {
 public:
  explicit Triangulation(std::vector<GridPoint> points) : points_(std::move(points)) {}

  void start(std::uint32_t a, std::uint32_t b, std::uint32_t c) {
    if (orientation(points_[a], points_[b], points_[c]) < 0) std::swap(b, c);
    triangles_ = {{{a, b, c}, {1, 2, 3}},
                  {{c, b, kInfinite}, {3, 2, 0}},
                  {{a, c, kInfinite}, {1, 3, 0}},
                  {{b, a, kInfinite}, {2, 1, 0}}};
    alive_.assign(4, true);
    last_ = 0;
  }

  void insert(std::uint32_t p) {
    const std::uint32_t seed = find(p);
    if (seed == kNoTriangle) return;
    grow_cavity(seed, p);
    fill_cavity(p);
  }

  std::vector<std::array<std::uint32_t, 3>> finite_triangles() const {
    std::vector<std::array<std::uint32_t, 3>> out;
    for (std::size_t t = 0; t < triangles_.size(); ++t) {
      const auto& v = triangles_[t].corners;
      if (alive_[t] && v[0] != kInfinite && v[1] != kInfinite && v[2] != kInfinite) out.push_back(v);
    }
    return out;
  }

 private:
  struct Cell {
    std::array<std::uint32_t, 3> corners;     ///< counter-clockwise
    std::array<std::uint32_t, 3> neighbours;  ///< across the side opposite to each corner
  };
  struct Rim {
    std::uint32_t start, end, outside;
  };

  /// Whether p lies within the circumcircle; of an unbounded triangle, beyond its hull edge or on it.
  bool conflicts(std::uint32_t t, std::uint32_t p) const {
    const auto& v = triangles_[t].corners;
    for (std::size_t k = 0; k < 3; ++k) {
      if (v[k] != kInfinite) continue;
      const GridPoint& a = points_[v[(k + 1) % 3]];
      const GridPoint& b = points_[v[(k + 2) % 3]];
      const GridPoint& q = points_[p];
      const std::int64_t side = orientation(a, b, q);
      if (side != 0) return side > 0;
      return (q.x - a.x) * (q.x - b.x) + (q.y - a.y) * (q.y - b.y) < 0;
    }
    return inside_circle(points_[v[0]], points_[v[1]], points_[v[2]], points_[p]);
  }

  /// Walks from the last triangle to one that conflicts with p; kNoTriangle when p coincides with a vertex.
  std::uint32_t find(std::uint32_t p) const {
    std::uint32_t t = last_;
    while (true) {
      const Cell& cell = triangles_[t];
      if (std::count(cell.corners.begin(), cell.corners.end(), kInfinite) > 0) return t;  // p lies beyond its hull edge
      std::uint32_t next = kNoTriangle;
      for (std::size_t k = 0; k < 3 && next == kNoTriangle; ++k) {
        const std::uint32_t a = cell.corners[(k + 1) % 3];
        const std::uint32_t b = cell.corners[(k + 2) % 3];
        if (orientation(points_[a], points_[b], points_[p]) < 0) next = cell.neighbours[k];
      }
      if (next == kNoTriangle) return conflicts(t, p) ? t : kNoTriangle;
      t = next;
    }
  }

  void grow_cavity(std::uint32_t seed, std::uint32_t p) {
    cavity_.assign(1, seed);
    rim_.clear();
    alive_[seed] = false;
    for (std::size_t n = 0; n < cavity_.size(); ++n) {
      const Cell cell = triangles_[cavity_[n]];
      for (std::size_t k = 0; k < 3; ++k) {
        const std::uint32_t beyond = cell.neighbours[k];
        if (!alive_[beyond]) continue;
        if (conflicts(beyond, p)) {
          alive_[beyond] = false;
          cavity_.push_back(beyond);
        }
      }
    }
    for (const std::uint32_t t : cavity_) {
      const Cell& cell = triangles_[t];
      for (std::size_t k = 0; k < 3; ++k) {
        if (alive_[cell.neighbours[k]]) {
          rim_.push_back({cell.corners[(k + 1) % 3], cell.corners[(k + 2) % 3], cell.neighbours[k]});
        }
      }
    }
  }

  /// A fan of triangles (start, end, p) over the rim, in the places of the cavity's.
  void fill_cavity(std::uint32_t p) {
    std::vector<std::uint32_t>& made = made_;
    made.clear();
    for (const Rim& rim : rim_) {
      std::uint32_t t;
      if (!cavity_.empty()) {
        t = cavity_.back();
        cavity_.pop_back();
      } else {
        t = static_cast<std::uint32_t>(triangles_.size());
        triangles_.emplace_back();
        alive_.push_back(false);
      }
      triangles_[t] = {{rim.start, rim.end, p}, {kNoTriangle, kNoTriangle, rim.outside}};
      alive_[t] = true;
      Cell& outside = triangles_[rim.outside];
      for (std::size_t k = 0; k < 3; ++k) {
        if (outside.corners[(k + 1) % 3] == rim.end && outside.corners[(k + 2) % 3] == rim.start) outside.neighbours[k] = t;
      }
      made.push_back(t);
    }
    for (const std::uint32_t t : made) {
      for (const std::uint32_t other : made) {
        if (triangles_[other].corners[0] == triangles_[t].corners[1]) {
          triangles_[t].neighbours[0] = other;
          triangles_[other].neighbours[1] = t;
        }
      }
    }
    last_ = made.front();
    for (const std::uint32_t t : made) {
      const auto& v = triangles_[t].corners;
      if (v[0] != kInfinite && v[1] != kInfinite) last_ = t;
    }
  }

  std::vector<GridPoint> points_;
  std::vector<Cell> triangles_;
  std::vector<bool> alive_;
  std::uint32_t last_ = 0;  ///< bounded
  std::vector<std::uint32_t> cavity_, made_;
  std::vector<Rim> rim_;
};

}  // namespace

std::vector<std::array<std::uint32_t, 3>> delaunay(std::span<const std::array<double, 2>> points) {
  if (points.size() < 3) return {};
  std::array<double, 2> low = points[0], high = points[0];
  for (const auto& p : points) {
    for (std::size_t k = 0; k < 2; ++k) {
      low[k] = std::min(low[k], p[k]);
      high[k] = std::max(high[k], p[k]);
    }
  }
  const double extent = std::max(high[0] - low[0], high[1] - low[1]);
  if (!(extent > 0)) return {};
  const double scale = static_cast<double>((std::int64_t{1} << kBits) - 1) / extent;
  std::vector<GridPoint> grid(points.size());
  std::vector<std::pair<std::uint64_t, std::uint32_t>> order(points.size());
  for (std::uint32_t i = 0; i < points.size(); ++i) {
    grid[i] = {std::llround((points[i][0] - low[0]) * scale), std::llround((points[i][1] - low[1]) * scale)};
    order[i] = {hilbert_index(static_cast<std::uint32_t>(grid[i].x >> (kBits - 16)),
                              static_cast<std::uint32_t>(grid[i].y >> (kBits - 16))),
                i};
  }
  std::sort(order.begin(), order.end());

  const GridPoint first = grid[order[0].second];
  std::size_t second = 1;
  while (second < order.size() && grid[order[second].second].x == first.x && grid[order[second].second].y == first.y)
    ++second;
  if (second == order.size()) return {};
  std::size_t third = second + 1;
  while (third < order.size() && orientation(first, grid[order[second].second], grid[order[third].second]) == 0) ++third;
  if (third >= order.size()) return {};

  Triangulation triangulation(std::move(grid));
  triangulation.start(order[0].second, order[second].second, order[third].second);
  for (std::size_t k = 1; k < order.size(); ++k) {
    if (k != second && k != third) triangulation.insert(order[k].second);
  }
  return triangulation.finite_triangles();
}

}  // namespace rustle::sheets
