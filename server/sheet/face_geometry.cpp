#include "server/sheet/face_geometry.h"

#include <algorithm>
#include <cassert>
#include <cmath>

namespace rustle::sheet {
namespace {

constexpr std::size_t kLanes = 16;
using Lanes = Eigen::Array<float, kLanes, 1>;

// atan(x) = x p(x²) on [0, tan(π/8)], p fitted at Chebyshev nodes; relative error 2e-8.
float atan_small(float x) {
  const float z = x * x;
  return x * (1.0f + z * (-0.333327979f + z * (0.199744046f + z * (-0.138514787f + z * 0.0798496306f))));
}

// atan2 without branches: the ratio is brought to [0, 1], then to [-tan(π/8), tan(π/8)].
float angle_of(float sine, float cosine) {
  const float s = std::fabs(sine), c = std::fabs(cosine);
  const float high = s > c ? s : c, low = s > c ? c : s;
  const bool steep = low > 0.41421356f * high;
  const float up = steep ? low - high : low, down = (steep ? low + high : high) + 1e-38f;
  float a = atan_small(up / down) + (steep ? 0.785398163f : 0.0f);
  a = s > c ? 1.57079633f - a : a;
  a = cosine < 0 ? 3.14159265f - a : a;
  return sine < 0 ? -a : a;
}

}  // namespace

Vec3d mean_position_m(std::span<const Vec3f> positions_m) {
  Vec3d sum = Vec3d::Zero();
  for (const Vec3f& p : positions_m) sum += p.cast<double>();
  return positions_m.empty() ? sum : Vec3d(sum / static_cast<double>(positions_m.size()));
}

void relative_positions_m(std::span<const Vec3f> positions_m, const Vec3d& origin_m, std::vector<Vec3f>& out_m) {
  out_m.resize(positions_m.size());
  for (std::size_t i = 0; i < positions_m.size(); ++i) out_m[i] = (positions_m[i].cast<double>() - origin_m).cast<float>();
}

void face_geometry(const Topology& topology, std::span<const Vec3f> positions_m, FaceGeometry& out) {
  const auto triangles = topology.triangles();
  out.normals.resize(triangles.size());
  out.areas_m2.resize(triangles.size());
  for (std::size_t f = 0; f < triangles.size(); ++f) {
    const Vec3f& a = positions_m[triangles[f][0]];
    const Vec3f n = (positions_m[triangles[f][1]] - a).cross(positions_m[triangles[f][2]] - a);
    const float length = n.norm();
    out.normals[f] = length > 0 ? Vec3f(n / length) : Vec3f::Zero();
    out.areas_m2[f] = 0.5f * length;
  }
}

void vertex_areas_m2(const Topology& topology, std::span<const float> face_areas_m2, std::vector<float>& out_m2) {
  out_m2.assign(topology.vertex_count(), 0.0f);
  const auto triangles = topology.triangles();
  for (std::size_t f = 0; f < triangles.size(); ++f) {
    for (std::uint32_t v : triangles[f]) out_m2[v] += face_areas_m2[f] / 3.0f;
  }
}

std::vector<Hinge> hinges(const Topology& topology) {
  std::vector<Hinge> out;
  out.reserve(topology.interior_edges().size());
  for (const InteriorEdge& edge : topology.interior_edges()) {
    const auto apex = [&](std::uint32_t triangle) {
      const Triangle& v = topology.triangles()[triangle];
      return v[0] + v[1] + v[2] - edge.start - edge.end;
    };
    const std::uint32_t left = apex(edge.left);
    out.push_back({edge.start, edge.end, left, edge.consistent ? apex(edge.right) : left});
  }
  return out;
}

void dihedral_angles_rad(std::span<const Hinge> hinges, std::span<const Vec3f> positions_m, std::span<float> out_rad) {
  assert(out_rad.size() == hinges.size());
  Eigen::Array<float, kLanes, 3> e, a, b;
  const float* p = positions_m.empty() ? nullptr : positions_m[0].data();
  for (std::size_t first = 0; first < hinges.size(); first += kLanes) {
    const std::size_t count = std::min(kLanes, hinges.size() - first);
    for (std::size_t i = 0; i < count; ++i) {
      const Hinge& h = hinges[first + i];
      const float *start = p + 3 * h[0], *end = p + 3 * h[1], *left = p + 3 * h[2], *right = p + 3 * h[3];
      const auto row = static_cast<Eigen::Index>(i);
      for (Eigen::Index d = 0; d < 3; ++d) {
        e(row, d) = end[d] - start[d];
        a(row, d) = left[d] - start[d];
        b(row, d) = right[d] - start[d];
      }
    }
    for (std::size_t i = count; i < kLanes; ++i) {
      e.row(static_cast<Eigen::Index>(i)).setZero();
      a.row(static_cast<Eigen::Index>(i)).setZero();
      b.row(static_cast<Eigen::Index>(i)).setZero();
    }
    // N_l = e x a, N_r = b x e; (N_l x N_r)·e/|e| = -|e| (N_l·b): areas cancel in the ratio.
    const Lanes lx = e.col(1) * a.col(2) - e.col(2) * a.col(1), ly = e.col(2) * a.col(0) - e.col(0) * a.col(2),
                lz = e.col(0) * a.col(1) - e.col(1) * a.col(0);
    const Lanes rx = b.col(1) * e.col(2) - b.col(2) * e.col(1), ry = b.col(2) * e.col(0) - b.col(0) * e.col(2),
                rz = b.col(0) * e.col(1) - b.col(1) * e.col(0);
    const Lanes length = (e.col(0).square() + e.col(1).square() + e.col(2).square()).sqrt();
    const Lanes sine = -length * (lx * b.col(0) + ly * b.col(1) + lz * b.col(2));
    const Lanes cosine = lx * rx + ly * ry + lz * rz;
    float angle[kLanes];
    for (std::size_t i = 0; i < kLanes; ++i) {
      angle[i] = angle_of(sine[static_cast<Eigen::Index>(i)], cosine[static_cast<Eigen::Index>(i)]);
    }
    for (std::size_t i = 0; i < count; ++i) {
      out_rad[first + i] = hinges[first + i][2] == hinges[first + i][3] ? 0.0f : angle[i];
    }
  }
}

template <class Point>
std::vector<double> local_edge_lengths_m(const Topology& topology, std::span<const Point> positions_m) {
  std::vector<double> sum(topology.vertex_count(), 0.0);
  std::vector<std::uint32_t> count(topology.vertex_count(), 0);
  const auto add = [&](std::uint32_t a, std::uint32_t b) {
    const double length = (positions_m[a] - positions_m[b]).norm();
    for (std::uint32_t v : {a, b}) sum[v] += length, ++count[v];
  };
  for (const InteriorEdge& edge : topology.interior_edges()) add(edge.start, edge.end);
  for (const BorderEdge& edge : topology.border_edges()) add(edge.start, edge.end);
  for (std::size_t v = 0; v < sum.size(); ++v) sum[v] /= std::max(count[v], 1u);
  return sum;
}
template std::vector<double> local_edge_lengths_m<Vec2d>(const Topology&, std::span<const Vec2d>);
template std::vector<double> local_edge_lengths_m<Vec3d>(const Topology&, std::span<const Vec3d>);

}  // namespace rustle::sheet
