#include "server/sheet/face_geometry.h"

#include <algorithm>
#include <cassert>
#include <cmath>

#include "server/sheet/simd.h"
#include "server/sheet/vector_batch.h"

namespace rustle::sheet {
namespace {

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
  const float up = low - (steep ? high : 0.0f), down = high + (steep ? low : 0.0f) + 1e-38f;
  float a = atan_small(up / down) + (steep ? 0.785398163f : 0.0f);
  a = s > c ? 1.57079633f - a : a;
  a = cosine < 0 ? 3.14159265f - a : a;
  return sine < 0 ? -a : a;
}

/// e: along the edges, a and b: from their starts to the apices.
RUSTLE_SIMD void angles_of(const VectorBatch& e, const VectorBatch& a, const VectorBatch& b, float* out) {
  for (std::size_t i = 0; i < kBatch; ++i) {
    const float ex = e.at[i][0], ey = e.at[i][1], ez = e.at[i][2], ax = a.at[i][0], ay = a.at[i][1], az = a.at[i][2],
                bx = b.at[i][0], by = b.at[i][1], bz = b.at[i][2];
    // N_l = e x a, N_r = b x e; (N_l x N_r)·e/|e| = -|e| (N_l·b): areas cancel in the ratio.
    const float lx = ey * az - ez * ay, ly = ez * ax - ex * az, lz = ex * ay - ey * ax;
    const float rx = by * ez - bz * ey, ry = bz * ex - bx * ez, rz = bx * ey - by * ex;
    const float length = std::sqrt(ex * ex + ey * ey + ez * ez);
    out[i] = angle_of(-length * (lx * bx + ly * by + lz * bz), lx * rx + ly * ry + lz * rz);
  }
}

/// Of the triangles that a and b span.
RUSTLE_SIMD void areas_of(const VectorBatch& a, const VectorBatch& b, float* out_m2) {
  for (std::size_t i = 0; i < kBatch; ++i) {
    const float ax = a.at[i][0], ay = a.at[i][1], az = a.at[i][2], bx = b.at[i][0], by = b.at[i][1], bz = b.at[i][2];
    const float x = ay * bz - az * by, y = az * bx - ax * bz, z = ax * by - ay * bx;
    out_m2[i] = 0.5f * std::sqrt(x * x + y * y + z * z);
  }
}

using Float4 = float __attribute__((vector_size(16), aligned(4), may_alias));
using Double4 = double __attribute__((vector_size(32)));

/// Sums of four positions in turn, added at the end. A load takes the first number of the next position along. \pre count >
/// 0
RUSTLE_SIMD Vec3d sum_of(const Vec3f* positions_m, std::size_t count) {
  Double4 sums[4] = {};
  std::size_t i = 0;
  for (; i + 4 < count; i += 4) {
    for (std::size_t k = 0; k < 4; ++k) {
      sums[k] += __builtin_convertvector(reinterpret_cast<const Float4&>(positions_m[i + k]), Double4);
    }
  }
  const Double4 sum = (sums[0] + sums[1]) + (sums[2] + sums[3]);
  Vec3d out(sum[0], sum[1], sum[2]);
  for (; i < count; ++i) out += positions_m[i].cast<double>();
  return out;
}

void differences(const Vec3f* positions_m, std::size_t count, const Vec3f& origin_m, Vec4f* out_m) {
  if (count == 0) return;
  const Float4 origin = {origin_m.x(), origin_m.y(), origin_m.z(), 0};
  for (std::size_t i = 0; i + 1 < count; ++i) {
    Float4 difference = reinterpret_cast<const Float4&>(positions_m[i]) - origin;
    difference[3] = 0;
    reinterpret_cast<Float4&>(out_m[i]) = difference;
  }
  const Vec3f last = positions_m[count - 1] - origin_m;
  out_m[count - 1] = {last.x(), last.y(), last.z(), 0.0f};
}

/// Of `count` triangles, the k-th of which is which(k).
template <class Which>
void measure_areas(const Topology& topology, std::span<const Vec4f> positions_m, std::size_t count, Which&& which,
                   std::vector<float>& out_m2) {
  const auto triangles = topology.triangles();
  out_m2.resize(count);
  VectorBatch a, b;
  float area_m2[kBatch];
  in_batches(
      count,
      [&](std::size_t k, std::size_t i) {
        const Triangle& v = triangles[which(k)];
        const Vec4f& start = positions_m[v[0]];
        a.put(i, positions_m[v[1]] - start);
        b.put(i, positions_m[v[2]] - start);
      },
      [&](std::size_t first, std::size_t here) {
        areas_of(a, b, area_m2);
        std::copy_n(area_m2, here, out_m2.begin() + static_cast<std::ptrdiff_t>(first));
      });
}

}  // namespace

Vec3f mean_position_m(std::span<const Vec3f> positions_m) {
  if (positions_m.empty()) return Vec3f::Zero();
  return (sum_of(positions_m.data(), positions_m.size()) / static_cast<double>(positions_m.size())).cast<float>();
}

void relative_positions_m(std::span<const Vec3f> positions_m, const Vec3f& origin_m, std::vector<Vec4f>& out_m) {
  out_m.resize(positions_m.size());
  differences(positions_m.data(), positions_m.size(), origin_m, out_m.data());
}

void face_areas_m2(const Topology& topology, std::span<const Vec4f> positions_m, std::vector<float>& out_m2) {
  measure_areas(
      topology, positions_m, topology.triangle_count(), [](std::size_t f) { return f; }, out_m2);
}

void face_areas_m2(const Topology& topology, std::span<const Vec4f> positions_m, std::span<const std::uint32_t> triangles,
                   std::vector<float>& out_m2) {
  measure_areas(
      topology, positions_m, triangles.size(), [&](std::size_t k) { return triangles[k]; }, out_m2);
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

void dihedral_angles_rad(std::span<const Hinge> hinges, std::span<const Vec4f> positions_m, std::span<float> out_rad) {
  assert(out_rad.size() == hinges.size());
  VectorBatch e, a, b;
  float angle_rad[kBatch];
  bool any_against = false;
  in_batches(
      hinges.size(),
      [&](std::size_t k, std::size_t i) {
        const Hinge& h = hinges[k];
        const Vec4f& start = positions_m[h[0]];
        e.put(i, positions_m[h[1]] - start);
        a.put(i, positions_m[h[2]] - start);
        b.put(i, positions_m[h[3]] - start);
        any_against |= h[2] == h[3];
      },
      [&](std::size_t first, std::size_t here) {
        angles_of(e, a, b, angle_rad);
        std::copy_n(angle_rad, here, out_rad.begin() + static_cast<std::ptrdiff_t>(first));
      });
  if (!any_against) return;
  for (std::size_t k = 0; k < hinges.size(); ++k) {
    if (hinges[k][2] == hinges[k][3]) out_rad[k] = 0;
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
