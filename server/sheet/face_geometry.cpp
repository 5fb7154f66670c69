#include "server/sheet/face_geometry.h"

#include <algorithm>
#include <cassert>
#include <cmath>

#include "server/sheet/simd.h"

namespace rustle::sheet {
namespace {

constexpr std::size_t kLanes = 128;  // enough that what a batch gathers has left the store buffer when it is read
using Lanes = float[kLanes];
using Lanes3 = Lanes[3];

// atan(x) = x p(x²) on [0, tan(π/8)], p fitted at Chebyshev nodes; relative error 2e-8.
inline float atan_small(float x) {
  const float z = x * x;
  return x * (1.0f + z * (-0.333327979f + z * (0.199744046f + z * (-0.138514787f + z * 0.0798496306f))));
}

// atan2 without branches: the ratio is brought to [0, 1], then to [-tan(π/8), tan(π/8)].
inline float angle_of(float sine, float cosine) {
  const float s = std::fabs(sine), c = std::fabs(cosine);
  const float high = s > c ? s : c, low = s > c ? c : s;
  const bool steep = low > 0.41421356f * high;
  const float up = steep ? low - high : low, down = (steep ? low + high : high) + 1e-38f;
  float a = atan_small(up / down) + (steep ? 0.785398163f : 0.0f);
  a = s > c ? 1.57079633f - a : a;
  a = cosine < 0 ? 3.14159265f - a : a;
  return sine < 0 ? -a : a;
}

inline void put_difference(Lanes3& out, std::size_t lane, const Vec3f& from, const Vec3f& to) {
  for (int d = 0; d < 3; ++d) out[d][lane] = to[d] - from[d];
}

/// e: along the edges, a and b: from their starts to the apices.
RUSTLE_SIMD void angles_of(const Lanes3& e, const Lanes3& a, const Lanes3& b, Lanes& out) {
  for (std::size_t i = 0; i < kLanes; ++i) {
    // N_l = e x a, N_r = b x e; (N_l x N_r)·e/|e| = -|e| (N_l·b): areas cancel in the ratio.
    const float lx = e[1][i] * a[2][i] - e[2][i] * a[1][i], ly = e[2][i] * a[0][i] - e[0][i] * a[2][i],
                lz = e[0][i] * a[1][i] - e[1][i] * a[0][i];
    const float rx = b[1][i] * e[2][i] - b[2][i] * e[1][i], ry = b[2][i] * e[0][i] - b[0][i] * e[2][i],
                rz = b[0][i] * e[1][i] - b[1][i] * e[0][i];
    const float length = std::sqrt(e[0][i] * e[0][i] + e[1][i] * e[1][i] + e[2][i] * e[2][i]);
    out[i] = angle_of(-length * (lx * b[0][i] + ly * b[1][i] + lz * b[2][i]), lx * rx + ly * ry + lz * rz);
  }
}

/// Of the triangles that a and b span.
RUSTLE_SIMD void normals_of(const Lanes3& a, const Lanes3& b, Lanes3& normal, Lanes& area_m2) {
  for (std::size_t i = 0; i < kLanes; ++i) {
    const float x = a[1][i] * b[2][i] - a[2][i] * b[1][i], y = a[2][i] * b[0][i] - a[0][i] * b[2][i],
                z = a[0][i] * b[1][i] - a[1][i] * b[0][i];
    const float length = std::sqrt(x * x + y * y + z * z), scale = length > 0 ? 1 / length : 0.0f;
    normal[0][i] = x * scale, normal[1][i] = y * scale, normal[2][i] = z * scale;
    area_m2[i] = 0.5f * length;
  }
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
  Lanes3 a{}, b{}, normal;
  Lanes area_m2;
  for (std::size_t first = 0; first < triangles.size(); first += kLanes) {
    const std::size_t count = std::min(kLanes, triangles.size() - first);
    for (std::size_t i = 0; i < count; ++i) {
      const Triangle& v = triangles[first + i];
      put_difference(a, i, positions_m[v[0]], positions_m[v[1]]);
      put_difference(b, i, positions_m[v[0]], positions_m[v[2]]);
    }
    normals_of(a, b, normal, area_m2);
    for (std::size_t i = 0; i < count; ++i) {
      out.normals[first + i] = {normal[0][i], normal[1][i], normal[2][i]};
      out.areas_m2[first + i] = area_m2[i];
    }
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
  Lanes3 e{}, a{}, b{};
  Lanes angle;
  for (std::size_t first = 0; first < hinges.size(); first += kLanes) {
    const std::size_t count = std::min(kLanes, hinges.size() - first);
    for (std::size_t i = 0; i < count; ++i) {
      const Hinge& h = hinges[first + i];
      const Vec3f& start = positions_m[h[0]];
      put_difference(e, i, start, positions_m[h[1]]);
      put_difference(a, i, start, positions_m[h[2]]);
      put_difference(b, i, start, positions_m[h[3]]);
    }
    angles_of(e, a, b, angle);
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
