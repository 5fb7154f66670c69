#include "client_sdk/sheets/tearing_mesh.h"

#include <algorithm>
#include <array>
#include <cassert>
#include <cmath>
#include <cstddef>
#include <numbers>

#include "client_sdk/sheets/delaunay.h"
#include "client_sdk/sheets/plane_noise.h"

namespace rustle::sheets {
namespace {

constexpr std::uint32_t kPathPoint = 0x80000000u;
constexpr double kClear = 1.02;      // texels about the path without other vertices
constexpr double kReach = 2.5;       // so many of its edges away from the path a refinement goes
constexpr double kApart = 0.7;       // of its edge, between a new vertex and any other
constexpr double kFromBorder = 0.6;  // of its edge
constexpr double kScatter = 0.3;     // of its edge, about a lattice point
constexpr double kCoarsest = 0.75;   // of the base mesh's edges

/// As the mesh has it. Out of line: GCC 12 leaves the way to float and back out where it makes it two at a time.
[[gnu::noinline]] double as_sent(double x) {
  return static_cast<double>(static_cast<float>(x));
}

Point2 as_sent(Point2 p) {
  return {as_sent(p.x), as_sent(p.y)};
}

/// Of triangles all alike.
double edge_m(const RectangleSize& size, std::size_t triangles) {
  return std::sqrt(size.width_m * size.height_m / static_cast<double>(triangles) * 4 / std::numbers::sqrt3);
}

/// Counter-clockwise from a to b, in [0, 2π).
double sweep_rad(Point2 a, Point2 b) {
  const double angle = std::atan2(cross(a, b), dot(a, b));
  return angle < 0 ? angle + 2 * std::numbers::pi : angle;
}

}  // namespace

std::size_t TornMesh::CellHash::operator()(Cell c) const {
  return static_cast<std::size_t>(c.i) * 73856093u ^ static_cast<std::size_t>(c.j) * 19349663u;
}

TornMesh::TornMesh(const SheetMesh& base, const RectangleSize& size, double texel_m, std::uint64_t seed)
    : size_(size), texel_m_(texel_m), base_edge_m_(edge_m(size, base.triangles.size())), seed_(seed) {
  for (const auto& m : base.material_coordinates) keep({static_cast<double>(m[0]), static_cast<double>(m[1])});
}

TornMesh::Cell TornMesh::cell_of(Point2 p) const {
  const double size = 2 * texel_m_;
  return {static_cast<int>(std::floor(p.x / size)), static_cast<int>(std::floor(p.y / size))};
}

void TornMesh::keep(Point2 p) {
  cells_[cell_of(p)].push_back(static_cast<std::uint32_t>(points_.size()));
  points_.emplace_back(p);
}

bool TornMesh::any_within(Point2 p, double distance_m) const {
  const Cell low = cell_of({p.x - distance_m, p.y - distance_m}), high = cell_of({p.x + distance_m, p.y + distance_m});
  for (int j = low.j; j <= high.j; ++j) {
    for (int i = low.i; i <= high.i; ++i) {
      const auto cell = cells_.find({i, j});
      if (cell == cells_.end()) continue;
      for (const std::uint32_t k : cell->second) {
        const Point2 q = k >= kPathPoint ? path_[k - kPathPoint] : *points_[k];
        if (length(p - q) < distance_m) return true;
      }
    }
  }
  return false;
}

void TornMesh::clear_about(Point2 p, double distance_m) {
  const auto corner = [&](Point2 q) { return (q.x <= 0 || q.x >= size_.width_m) && (q.y <= 0 || q.y >= size_.height_m); };
  const Cell low = cell_of({p.x - distance_m, p.y - distance_m}), high = cell_of({p.x + distance_m, p.y + distance_m});
  for (int j = low.j; j <= high.j; ++j) {
    for (int i = low.i; i <= high.i; ++i) {
      const auto cell = cells_.find({i, j});
      if (cell == cells_.end()) continue;
      std::erase_if(cell->second, [&](std::uint32_t k) {
        if (k >= kPathPoint || corner(*points_[k]) || length(*points_[k] - p) >= distance_m) return false;
        points_[k].reset();
        return true;
      });
    }
  }
}

void TornMesh::refine_about(Point2 p) {
  int level = 1;
  while (texel_m_ * (2 << level) < kCoarsest * base_edge_m_) ++level;
  for (; level >= 1; --level) {
    const double edge = texel_m_ * (1 << level), reach = kReach * edge;
    if (edge > kCoarsest * base_edge_m_) continue;
    for (auto j = std::llround((p.y - reach) / edge); j <= std::llround((p.y + reach) / edge); ++j) {
      for (auto i = std::llround((p.x - reach) / edge); i <= std::llround((p.x + reach) / edge); ++i) {
        const auto seed = seed_ + static_cast<std::uint64_t>(level);
        const Point2 q = as_sent({edge * (static_cast<double>(i) + kScatter * (hashed_unit(seed, 2 * i, j) - 0.5)),
                                  edge * (static_cast<double>(j) + kScatter * (hashed_unit(seed, 2 * i + 1, j) - 0.5))});
        const double border = std::min({q.x, q.y, size_.width_m - q.x, size_.height_m - q.y});
        if (length(q - p) > reach || border < kFromBorder * edge || any_within(q, kApart * edge)) continue;
        keep(q);
      }
    }
  }
}

void TornMesh::cut(std::span<const Point2> path_m, bool finished) {
  assert(path_m.size() >= path_.size());
  const std::size_t known = path_.size();
  for (std::size_t k = known; k < path_m.size(); ++k) {
    path_.push_back(as_sent(path_m[k]));
    clear_about(path_.back(), kClear * texel_m_);
    cells_[cell_of(path_.back())].push_back(kPathPoint + static_cast<std::uint32_t>(k));
  }
  for (std::size_t k = known; k < path_.size(); ++k) refine_about(path_[k]);
  triangulate(path_, finished);
}

void TornMesh::triangulate(std::span<const Point2> path_m, bool finished) {
  std::vector<std::array<double, 2>> flat;
  for (const auto& p : points_) {
    if (p) flat.push_back({p->x, p->y});
  }
  const auto first = static_cast<std::uint32_t>(flat.size());
  const auto count = static_cast<std::uint32_t>(path_m.size());
  for (const Point2 p : path_m) flat.push_back({p.x, p.y});
  mesh_.triangles = delaunay(flat);
  mesh_.material_coordinates.clear();
  for (const auto& p : flat) mesh_.material_coordinates.push_back({static_cast<float>(p[0]), static_cast<float>(p[1])});
  vertices_.assign(first, TornVertex::kSheet);
  vertices_.resize(first + count, TornVertex::kLeftLip);
  for (auto& lip : lips_) lip.resize(count);
  for (std::uint32_t k = 0; k < count; ++k) {
    const bool joined = (k + 1 == count && !finished) || count == 1;
    lips_[kLeft][k] = lips_[kRight][k] = first + k;
    if (joined) {
      vertices_[first + k] = TornVertex::kTip;
      continue;
    }
    lips_[kRight][k] = static_cast<std::uint32_t>(mesh_.material_coordinates.size());
    mesh_.material_coordinates.push_back(mesh_.material_coordinates[first + k]);
    vertices_.push_back(TornVertex::kRightLip);
  }
  for (auto& triangle : mesh_.triangles) {
    Point2 centre;
    for (const auto v : triangle) centre = centre + (1.0 / 3) * Point2{flat[v][0], flat[v][1]};
    for (auto& v : triangle) {
      if (v < first || lips_[kLeft][v - first] == lips_[kRight][v - first]) continue;
      const std::uint32_t k = v - first;
      const Point2 to = centre - path_m[k];
      bool left = false;
      if (k == 0) {
        left = cross(path_m[1] - path_m[0], to) > 0;
      } else if (k + 1 == count) {
        left = cross(path_m[k] - path_m[k - 1], to) > 0;
      } else {
        const Point2 on = path_m[k + 1] - path_m[k];
        left = sweep_rad(on, to) < sweep_rad(on, path_m[k - 1] - path_m[k]);
      }
      if (!left) v = lips_[kRight][k];
    }
  }
}

}  // namespace rustle::sheets
