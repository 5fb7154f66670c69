#include "server/scene/triangles.h"

#include <bit>
#include <cassert>
#include <numeric>

namespace rustle::scene {
namespace {

constexpr std::uint32_t kLeafSize = 4;
constexpr std::int64_t kMostCellsOfATriangle = 64;

/// Shares along an edge of the point closest to the query.
double edge_share(const Vec3d& query, const Vec3d& start, const Vec3d& end) {
  const Vec3d edge = end - start;
  const double length2 = edge.squaredNorm();
  return length2 > 0 ? std::clamp(edge.dot(query - start) / length2, 0.0, 1.0) : 0.0;
}

}  // namespace

TrianglePoint closest_on_triangle(const Vec3d& query, const Vec3d& a, const Vec3d& b, const Vec3d& c) {
  const Vec3d ab = b - a;
  const Vec3d ac = c - a;
  const Vec3d aq = query - a;
  const double bb = ab.squaredNorm();
  const double bc = ab.dot(ac);
  const double cc = ac.squaredNorm();
  const double qb = ab.dot(aq);
  const double qc = ac.dot(aq);
  const double area2 = bb * cc - bc * bc;
  const double wb = cc * qb - bc * qc;
  const double wc = bb * qc - bc * qb;
  const double wa = area2 - wb - wc;
  if (area2 > 0 && wa >= 0 && wb >= 0 && wc >= 0) {
    const double share_b = wb / area2;
    const double share_c = wc / area2;
    return {a + share_b * ab + share_c * ac, {1 - share_b - share_c, share_b, share_c}};
  }
  TrianglePoint best{};
  double best2 = std::numeric_limits<double>::infinity();
  const std::array<const Vec3d*, 3> corners = {&a, &b, &c};
  for (int k = 0; k < 3; ++k) {
    const std::size_t from = static_cast<std::size_t>(k);
    const std::size_t to = (from + 1) % 3;
    const double share = edge_share(query, *corners[from], *corners[to]);
    const Vec3d point = *corners[from] + share * (*corners[to] - *corners[from]);
    const double distance2 = (query - point).squaredNorm();
    if (distance2 >= best2) continue;
    best2 = distance2;
    best.position_m = point;
    best.barycentric.setZero();
    best.barycentric[k] = 1 - share;
    best.barycentric[static_cast<int>(to)] = share;
  }
  return best;
}

Box triangle_box(const Triangle& triangle, std::span<const Vec3f> positions_m) {
  Box box(positions_m[triangle[0]].cast<double>());
  box.extend(positions_m[triangle[1]].cast<double>());
  box.extend(positions_m[triangle[2]].cast<double>());
  return box;
}

void TriangleTree::build(std::span<const Triangle> triangles, std::span<const Vec3f> positions_m) {
  triangles_.assign(triangles.begin(), triangles.end());
  nodes_.clear();
  order_.resize(triangles.size());
  std::iota(order_.begin(), order_.end(), 0u);
  if (triangles.empty()) return;
  std::vector<Vec3d> centres(triangles.size());
  for (std::size_t t = 0; t < triangles.size(); ++t) centres[t] = triangle_box(triangles[t], positions_m).center();

  nodes_.reserve(triangles.size());
  nodes_.push_back({Box(), 0, static_cast<std::uint32_t>(triangles.size())});
  for (std::size_t n = 0; n < nodes_.size(); ++n) {
    const std::uint32_t first = nodes_[n].first;
    const std::uint32_t count = nodes_[n].count;
    if (count <= kLeafSize) continue;
    Box spread;
    for (std::uint32_t k = 0; k < count; ++k) spread.extend(centres[order_[first + k]]);
    int axis = 0;
    spread.sizes().maxCoeff(&axis);
    const auto begin = order_.begin() + first;
    std::nth_element(begin, begin + count / 2, begin + count, [&](std::uint32_t a, std::uint32_t b) {
      return centres[a][axis] != centres[b][axis] ? centres[a][axis] < centres[b][axis] : a < b;
    });
    nodes_[n].first = static_cast<std::uint32_t>(nodes_.size());
    nodes_[n].count = 0;
    nodes_.push_back({Box(), first, count / 2});
    nodes_.push_back({Box(), first + count / 2, count - count / 2});
  }
  refit(positions_m);
}

void TriangleTree::refit(std::span<const Vec3f> positions_m) {
  for (std::size_t n = nodes_.size(); n-- > 0;) {
    Node& node = nodes_[n];
    if (node.count == 0) {
      node.box = nodes_[node.first].box.merged(nodes_[node.first + 1].box);
      continue;
    }
    node.box.setEmpty();
    for (std::uint32_t k = 0; k < node.count; ++k) {
      node.box.extend(triangle_box(triangles_[order_[node.first + k]], positions_m));
    }
  }
}

bool TriangleTree::touches(const Box& box) const {
  if (nodes_.empty()) return false;
  std::array<std::uint32_t, 64> stack;
  std::size_t depth = 0;
  stack[depth++] = 0;
  while (depth > 0) {
    const Node& node = nodes_[stack[--depth]];
    if (!node.box.intersects(box)) continue;
    if (node.count > 0) return true;
    stack[depth++] = node.first;
    stack[depth++] = node.first + 1;
  }
  return false;
}

TriangleGrid::Cell TriangleGrid::cell_of(const Vec3d& point) const {
  constexpr double kLimit = 1e9;
  Cell cell;
  for (int k = 0; k < 3; ++k) {
    const double scaled = std::floor((point[k] - origin_m_[k]) * cells_per_m_);
    cell[static_cast<std::size_t>(k)] = static_cast<std::int32_t>(std::clamp(scaled, -kLimit, kLimit));
  }
  return cell;
}

std::uint32_t TriangleGrid::bucket_of(const Cell& cell) const {
  const std::uint32_t mixed = static_cast<std::uint32_t>(cell[0]) * 73856093u ^
                              static_cast<std::uint32_t>(cell[1]) * 19349663u ^
                              static_cast<std::uint32_t>(cell[2]) * 83492791u;
  return mixed & (static_cast<std::uint32_t>(bucket_start_.size()) - 2);
}

void TriangleGrid::build(std::span<const Triangle> triangles, std::span<const Vec3f> positions_m, double cell_m) {
  assert(cell_m > 0);
  oversize_.clear();
  entries_.clear();
  first_cell_.resize(triangles.size());
  last_cell_ = {-1, -1, -1};
  cells_per_m_ = 1 / cell_m;
  Box bounds;
  for (const Triangle& triangle : triangles) bounds.extend(triangle_box(triangle, positions_m));
  origin_m_ = bounds.isEmpty() ? Vec3d(Vec3d::Zero()) : Vec3d(bounds.min());

  std::vector<Entry> unsorted;
  unsorted.reserve(triangles.size() * 4);
  for (std::uint32_t t = 0; t < triangles.size(); ++t) {
    const Box box = triangle_box(triangles[t], positions_m);
    const Cell low = cell_of(box.min());
    const Cell high = cell_of(box.max());
    first_cell_[t] = low;
    std::int64_t cells = 1;
    for (int k = 0; k < 3; ++k) cells = std::min<std::int64_t>(cells, 1 << 20) * (high[k] - low[k] + std::int64_t{1});
    if (cells > kMostCellsOfATriangle) {
      oversize_.push_back(t);
      continue;
    }
    for (int k = 0; k < 3; ++k) last_cell_[k] = std::max(last_cell_[k], high[k]);
    for (std::int32_t z = low[2]; z <= high[2]; ++z) {
      for (std::int32_t y = low[1]; y <= high[1]; ++y) {
        for (std::int32_t x = low[0]; x <= high[0]; ++x) unsorted.push_back({{x, y, z}, t});
      }
    }
  }
  const std::size_t buckets = std::bit_ceil(std::max<std::size_t>(unsorted.size() * 2, 2));
  bucket_start_.assign(buckets + 1, 0);
  for (const Entry& entry : unsorted) ++bucket_start_[bucket_of(entry.cell) + 1];
  for (std::size_t b = 0; b < buckets; ++b) bucket_start_[b + 1] += bucket_start_[b];
  entries_.resize(unsorted.size());
  std::vector<std::uint32_t> next(bucket_start_.begin(), bucket_start_.end() - 1);
  for (const Entry& entry : unsorted) entries_[next[bucket_of(entry.cell)]++] = entry;
}

}  // namespace rustle::scene
