#include "client_sdk/sheets/rectangle.h"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <cstddef>
#include <functional>

#include "client_sdk/sheets/delaunay.h"

namespace rustle::sheets {
namespace {

using Point = std::array<double, 2>;

/// SplitMix64 (Steele, Lea, Flood 2014).
class Random {
 public:
  explicit Random(std::uint64_t seed) : state_(seed) {}
  double unit() {  ///< in [0, 1)
    state_ += 0x9e3779b97f4a7c15u;
    std::uint64_t z = state_;
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9u;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebu;
    return static_cast<double>((z ^ (z >> 31)) >> 11) * 0x1p-53;
  }

 private:
  std::uint64_t state_;
};

SheetMesh make_structured(double width_m, double height_m, std::size_t triangle_count) {
  const double cells = static_cast<double>(triangle_count) / 2;
  const auto columns = static_cast<std::uint32_t>(std::max(1.0, std::round(std::sqrt(cells * width_m / height_m))));
  const auto rows = static_cast<std::uint32_t>(std::max(1.0, std::round(cells / columns)));
  SheetMesh mesh;
  for (std::uint32_t r = 0; r <= rows; ++r) {
    for (std::uint32_t c = 0; c <= columns; ++c) {
      mesh.material_coordinates.push_back(
          {static_cast<float>(width_m * c / columns), static_cast<float>(height_m * r / rows)});
    }
  }
  for (std::uint32_t r = 0; r < rows; ++r) {
    for (std::uint32_t c = 0; c < columns; ++c) {
      const std::uint32_t a = r * (columns + 1) + c;
      const std::uint32_t d = a + columns + 1;
      mesh.triangles.push_back({a, a + 1, d + 1});
      mesh.triangles.push_back({a, d + 1, d});
    }
  }
  return mesh;
}

/// Points on the four borders, corners first on each, at the spacing asked for; their number is odd where `odd` is, since a
/// triangulation has as many triangles, odd or even, as border points.
std::vector<Point> border_points(double width_m, double height_m, const std::function<double(double)>& spacing_at,
                                 bool odd) {
  const std::array<Point, 4> corners = {{{0, 0}, {width_m, 0}, {width_m, height_m}, {0, height_m}}};
  constexpr int kSteps = 400;
  std::array<std::array<double, kSteps + 1>, 4> counts{};
  std::array<int, 4> pieces{};
  for (std::size_t side = 0; side < 4; ++side) {
    const Point& a = corners[side];
    const Point& b = corners[(side + 1) % 4];
    const double length = std::hypot(b[0] - a[0], b[1] - a[1]);
    auto& count = counts[side];
    for (int i = 0; i < kSteps; ++i) {
      const double x = a[0] + (b[0] - a[0]) * (i + 0.5) / kSteps;
      count[static_cast<std::size_t>(i) + 1] = count[static_cast<std::size_t>(i)] + length / kSteps / spacing_at(x);
    }
    pieces[side] = std::max(1, static_cast<int>(std::lround(count[kSteps])));
  }
  const int total = pieces[0] + pieces[1] + pieces[2] + pieces[3];
  if ((total % 2 != 0) != odd) ++pieces[0];
  std::vector<Point> points;
  for (std::size_t side = 0; side < 4; ++side) {
    const Point& a = corners[side];
    const Point& b = corners[(side + 1) % 4];
    const auto& count = counts[side];
    std::size_t i = 0;
    for (int k = 0; k < pieces[side]; ++k) {
      const double goal = count[kSteps] * k / pieces[side];
      while (i + 1 < kSteps && count[i + 1] <= goal) ++i;
      const double share = k == 0 ? 0.0 : (static_cast<double>(i) + (goal - count[i]) / (count[i + 1] - count[i])) / kSteps;
      points.push_back({a[0] + (b[0] - a[0]) * share, a[1] + (b[1] - a[1]) * share});
    }
  }
  return points;
}

/// Points in the plane by cell, to keep a distance.
class Neighbourhood {
 public:
  Neighbourhood(double width_m, double height_m, double cell_m)
      : cells_per_m_(1 / cell_m),
        columns_(static_cast<std::size_t>(width_m * cells_per_m_) + 1),
        rows_(static_cast<std::size_t>(height_m * cells_per_m_) + 1),
        cells_(columns_ * rows_) {}

  void add(const Point& p) { cells_[row(p[1]) * columns_ + column(p[0])].push_back(p); }

  bool any_within(const Point& p, double distance_m) const {
    for (std::size_t r = row(p[1] - distance_m); r <= row(p[1] + distance_m); ++r) {
      for (std::size_t c = column(p[0] - distance_m); c <= column(p[0] + distance_m); ++c) {
        for (const Point& q : cells_[r * columns_ + c]) {
          const double dx = p[0] - q[0];
          const double dy = p[1] - q[1];
          if (dx * dx + dy * dy < distance_m * distance_m) return true;
        }
      }
    }
    return false;
  }

 private:
  std::size_t column(double x) const {
    return static_cast<std::size_t>(std::clamp(x * cells_per_m_, 0.0, static_cast<double>(columns_ - 1)));
  }
  std::size_t row(double y) const {
    return static_cast<std::size_t>(std::clamp(y * cells_per_m_, 0.0, static_cast<double>(rows_ - 1)));
  }

  double cells_per_m_;
  std::size_t columns_, rows_;
  std::vector<std::vector<Point>> cells_;
};

SheetMesh make_scattered(bool graded, double width_m, double height_m, std::size_t triangle_count, std::uint64_t seed) {
  const double base_m = std::sqrt(2 * width_m * height_m / static_cast<double>(triangle_count));
  const auto grade = [](double share) { return 0.45 + 1.35 * share; };
  double factor = 1;
  if (graded) {  // such that the mean density is that of even spacing: ∫ 1/grade² = 1/0.45/1.8
    factor = std::sqrt(1 / (0.45 * 1.8));
  }
  const auto spacing_at = [&](double x) { return graded ? base_m * factor * grade(x / width_m) : base_m; };
  const double least_m = spacing_at(0);

  std::vector<Point> points = border_points(width_m, height_m, spacing_at, triangle_count % 2 != 0);
  Neighbourhood border(width_m, height_m, base_m);
  Neighbourhood inside(width_m, height_m, base_m);
  for (const Point& p : points) border.add(p);
  const std::size_t border_count = points.size();
  const std::size_t inner_count = triangle_count + 2 > border_count ? (triangle_count + 2 - border_count + 1) / 2 : 0;
  Random random(seed);
  double gap = 0.85;  // shrinks until all points have found a place
  while (points.size() < border_count + inner_count) {
    for (std::size_t k = 0; k < inner_count && points.size() < border_count + inner_count; ++k) {
      const Point p = {random.unit() * width_m, random.unit() * height_m};
      const double spacing = spacing_at(p[0]);
      const double density = (least_m / spacing) * (least_m / spacing);
      const double border_gap = std::min(0.5, gap) * spacing;
      if (random.unit() > density || inside.any_within(p, gap * spacing)) continue;
      if (std::min({p[0], p[1], width_m - p[0], height_m - p[1]}) < 0.6 * border_gap || border.any_within(p, border_gap)) {
        continue;
      }
      inside.add(p);
      points.push_back(p);
    }
    gap *= 0.985;
  }
  SheetMesh mesh;
  mesh.triangles = delaunay(points);
  for (const Point& p : points) mesh.material_coordinates.push_back({static_cast<float>(p[0]), static_cast<float>(p[1])});
  return mesh;
}

}  // namespace

SheetMesh make_rectangle(MeshKind kind, double width_m, double height_m, std::size_t triangle_count, std::uint64_t seed) {
  assert(width_m > 0 && height_m > 0 && triangle_count >= 2);
  if (kind == MeshKind::kStructured) return make_structured(width_m, height_m, triangle_count);
  return make_scattered(kind == MeshKind::kGraded, width_m, height_m, triangle_count, seed);
}

}  // namespace rustle::sheets
