#include "server/report/obstacle_wires.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <set>

namespace rustle::report {
namespace {

using scene::Vec3d;

constexpr int kArcSteps = 48;

/// Wires in the obstacle's own frame.
struct OwnWires {
  Vec3d centre_m;
  double radius_m;
  std::vector<Segment> lines;

  void arc(const Vec3d& centre, const Vec3d& u, const Vec3d& v, double from, double to) {
    Vec3d previous = centre + std::cos(from) * u + std::sin(from) * v;
    for (int i = 1; i <= kArcSteps; ++i) {
      const double angle = from + (to - from) * i / kArcSteps;
      const Vec3d next = centre + std::cos(angle) * u + std::sin(angle) * v;
      lines.push_back({previous, next});
      previous = next;
    }
  }
  void circle(const Vec3d& centre, const Vec3d& u, const Vec3d& v) { arc(centre, u, v, 0, 2 * std::numbers::pi); }

  void operator()(const scene::PlaneShape&) {
    if (!(radius_m > 0) || std::abs(centre_m.z()) > 3 * radius_m) return;
    const double raw = radius_m / 5, decade = std::pow(10.0, std::floor(std::log10(raw)));
    const double step = raw < 2 * decade ? 2 * decade : raw < 5 * decade ? 5 * decade : 10 * decade;
    const double reach = step * std::ceil(1.6 * radius_m / step);
    const double x0 = step * std::round(centre_m.x() / step), y0 = step * std::round(centre_m.y() / step);
    for (double k = -reach; k <= reach + step / 2; k += step) {
      lines.push_back({{x0 + k, y0 - reach, 0}, {x0 + k, y0 + reach, 0}});
      lines.push_back({{x0 - reach, y0 + k, 0}, {x0 + reach, y0 + k, 0}});
    }
  }
  void operator()(const scene::BoxShape& box) {
    const Vec3d h = box.half_extents_m;
    for (int axis = 0; axis < 3; ++axis) {
      for (int corner = 0; corner < 4; ++corner) {
        Vec3d from = h;
        from[axis] = -h[axis];
        from[(axis + 1) % 3] *= (corner & 1) != 0 ? 1 : -1;
        from[(axis + 2) % 3] *= (corner & 2) != 0 ? 1 : -1;
        Vec3d to = from;
        to[axis] = h[axis];
        lines.push_back({from, to});
      }
    }
  }
  void operator()(const scene::SphereShape& sphere) {
    const Vec3d x = sphere.radius_m * Vec3d::UnitX(), y = sphere.radius_m * Vec3d::UnitY(),
                z = sphere.radius_m * Vec3d::UnitZ();
    circle(Vec3d::Zero(), x, y);
    circle(Vec3d::Zero(), y, z);
    circle(Vec3d::Zero(), z, x);
  }
  void operator()(const scene::CapsuleShape& capsule) {
    const double r = capsule.radius_m, half = capsule.half_length_m, pi = std::numbers::pi;
    const Vec3d x = r * Vec3d::UnitX(), y = r * Vec3d::UnitY(), z = r * Vec3d::UnitZ();
    for (const double end : {-half, half}) {
      const Vec3d centre = end * Vec3d::UnitZ();
      circle(centre, x, y);
      arc(centre, x, end < 0 ? Vec3d(-z) : z, 0, pi);
      arc(centre, y, end < 0 ? Vec3d(-z) : z, 0, pi);
    }
    for (const Vec3d& side : {x, Vec3d(-x), y, Vec3d(-y)}) {
      lines.push_back({side - half * Vec3d::UnitZ(), side + half * Vec3d::UnitZ()});
    }
  }
  void operator()(const scene::MeshShape& mesh) {
    std::set<std::pair<std::uint32_t, std::uint32_t>> edges;
    for (const sheet::Triangle& t : mesh.triangles) {
      for (std::size_t k = 0; k < 3; ++k) edges.insert(std::minmax({t[k], t[(k + 1) % 3]}));
    }
    for (const auto& [from, to] : edges) {
      if (to >= mesh.vertices_m.size()) continue;
      lines.push_back({mesh.vertices_m[from].cast<double>(), mesh.vertices_m[to].cast<double>()});
    }
  }
};

}  // namespace

std::vector<Segment> obstacle_wires(const scene::Obstacle& obstacle, const Vec3d& centre_m, double radius_m) {
  const Eigen::Quaterniond& turn = obstacle.pose.orientation;
  const Vec3d own_centre = turn.conjugate() * (centre_m - obstacle.pose.position_m);
  OwnWires wires{own_centre, radius_m, {}};
  std::visit(wires, obstacle.shape);
  std::vector<Segment> world;
  world.reserve(wires.lines.size());
  for (const auto& [from, to] : wires.lines) {
    const Vec3d a = turn * from + obstacle.pose.position_m, b = turn * to + obstacle.pose.position_m;
    if (a.allFinite() && b.allFinite()) world.push_back({a, b});
  }
  return world;
}

}  // namespace rustle::report
