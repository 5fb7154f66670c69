#include "server/sheet/delaunay.h"

#include <algorithm>
#include <cmath>
#include <cstdint>

namespace rustle::sheet {
namespace {

__extension__ typedef __int128 Wide;

constexpr std::int64_t kGrid = std::int64_t{1} << 20;
constexpr std::int64_t kFar = std::int64_t{1} << 27;  // the enclosing triangle's reach; products stay below 2^120

struct Lattice {
  std::int64_t x, y;
  bool operator==(const Lattice&) const = default;
};

/// > 0: a, b, c counter-clockwise.
std::int64_t turn(const Lattice& a, const Lattice& b, const Lattice& c) {
  return (b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x);
}

bool in_circle(const Lattice& a, const Lattice& b, const Lattice& c, const Lattice& p) {
  const std::int64_t ax = a.x - p.x, ay = a.y - p.y, bx = b.x - p.x, by = b.y - p.y, cx = c.x - p.x, cy = c.y - p.y;
  const auto square = [](std::int64_t x, std::int64_t y) { return Wide{x} * x + Wide{y} * y; };
  const auto cross = [](std::int64_t x0, std::int64_t y0, std::int64_t x1, std::int64_t y1) {
    return Wide{x0} * y1 - Wide{x1} * y0;
  };
  return square(ax, ay) * cross(bx, by, cx, cy) - square(bx, by) * cross(ax, ay, cx, cy) +
             square(cx, cy) * cross(ax, ay, bx, by) >
         0;
}

class Triangulation {
 public:
  explicit Triangulation(std::vector<Lattice> points) : points_(std::move(points)), count_(points_.size()) {
    points_.push_back({-kFar, -kFar});
    points_.push_back({kFar, -kFar});
    points_.push_back({0, kFar});
    const auto n = static_cast<std::uint32_t>(count_);
    faces_.push_back({{n, n + 1, n + 2}, {kNone, kNone, kNone}});
  }

  void insert(std::uint32_t point) {
    const Lattice& p = points_[point];
    std::uint32_t at = last_;
    for (int side = 0; side < 3;) {
      const Face& f = faces_[at];
      if (turn(points_[f.v[side]], points_[f.v[(side + 1) % 3]], p) < 0) {
        at = f.n[side];
        side = 0;
      } else {
        ++side;
      }
    }
    for (std::uint32_t v : faces_[at].v) {
      if (points_[v] == p) return;
    }
    cavity_.assign(1, at);
    faces_[at].dead = true;
    rim_.clear();
    for (std::size_t k = 0; k < cavity_.size(); ++k) {
      const Face f = faces_[cavity_[k]];
      for (int side = 0; side < 3; ++side) {
        const std::uint32_t g = f.n[side];
        if (g != kNone && faces_[g].dead) continue;
        if (g != kNone && in_circle(points_[faces_[g].v[0]], points_[faces_[g].v[1]], points_[faces_[g].v[2]], p)) {
          faces_[g].dead = true;
          cavity_.push_back(g);
        } else {
          rim_.push_back({f.v[side], f.v[(side + 1) % 3], g});
        }
      }
    }
    // An edge met before the face beyond it joined the cavity is no rim.
    std::erase_if(rim_, [&](const Rim& r) { return r.beyond != kNone && faces_[r.beyond].dead; });
    made_.clear();
    for (std::size_t k = 0; k < rim_.size(); ++k) {
      std::uint32_t index;
      if (k < cavity_.size()) {
        index = cavity_[k];
      } else {
        index = static_cast<std::uint32_t>(faces_.size());
        faces_.emplace_back();
      }
      made_.push_back(index);
    }
    for (std::size_t k = 0; k < rim_.size(); ++k) {
      const Rim& r = rim_[k];
      Face& f = faces_[made_[k]];
      f = {{r.a, r.b, point}, {r.beyond, kNone, kNone}};
      for (std::size_t j = 0; j < rim_.size(); ++j) {
        if (rim_[j].a == r.b) f.n[1] = made_[j];
        if (rim_[j].b == r.a) f.n[2] = made_[j];
      }
      if (r.beyond != kNone) {
        Face& g = faces_[r.beyond];
        for (int side = 0; side < 3; ++side) {
          if (g.v[side] == r.b && g.v[(side + 1) % 3] == r.a) g.n[side] = made_[k];
        }
      }
    }
    last_ = made_.back();
  }

  std::vector<Triangle> triangles() const {
    std::vector<Triangle> out;
    for (const Face& f : faces_) {
      if (std::all_of(f.v.begin(), f.v.end(), [&](std::uint32_t v) { return v < count_; })) out.push_back(f.v);
    }
    return out;
  }

 private:
  struct Face {
    Triangle v{};
    std::array<std::uint32_t, 3> n{kNone, kNone, kNone};  ///< across the side from v[k] to v[k+1]
    bool dead = false;
  };
  struct Rim {
    std::uint32_t a, b, beyond;
  };

  std::vector<Lattice> points_;
  std::size_t count_;
  std::vector<Face> faces_;
  std::vector<std::uint32_t> cavity_, made_;
  std::vector<Rim> rim_;
  std::uint32_t last_ = 0;
};

}  // namespace

std::vector<Triangle> delaunay(std::span<const Vec2d> points) {
  if (points.size() < 3) return {};
  Vec2d low = points[0], high = points[0];
  for (const Vec2d& p : points) low = low.cwiseMin(p), high = high.cwiseMax(p);
  const double extent = (high - low).maxCoeff();
  if (!(extent > 0)) return {};
  std::vector<Lattice> lattice;
  lattice.reserve(points.size());
  for (const Vec2d& p : points) {
    const Vec2d q = (p - (low + high) / 2) / extent * static_cast<double>(kGrid);
    lattice.push_back({std::llround(q.x()), std::llround(q.y())});
  }
  // Boustrophedon rows keep the walk to each next point short.
  const auto rows = static_cast<std::int64_t>(std::sqrt(static_cast<double>(points.size())) / 2) + 1;
  const auto row_of = [&](const Lattice& p) { return (p.y + kGrid / 2) * rows / (kGrid + 1); };
  std::vector<std::uint32_t> order(points.size());
  for (std::uint32_t i = 0; i < order.size(); ++i) order[i] = i;
  std::sort(order.begin(), order.end(), [&](std::uint32_t a, std::uint32_t b) {
    const std::int64_t ra = row_of(lattice[a]), rb = row_of(lattice[b]);
    if (ra != rb) return ra < rb;
    if (lattice[a].x != lattice[b].x) return (lattice[a].x < lattice[b].x) == (ra % 2 == 0);
    return a < b;
  });
  Triangulation triangulation(std::move(lattice));
  for (std::uint32_t i : order) triangulation.insert(i);
  std::vector<Triangle> out = triangulation.triangles();
  for (Triangle& t : out) std::rotate(t.begin(), std::min_element(t.begin(), t.end()), t.end());
  std::sort(out.begin(), out.end());
  return out;
}

}  // namespace rustle::sheet
