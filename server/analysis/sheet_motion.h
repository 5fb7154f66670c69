#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "server/scene/triangles.h"
#include "server/sheet/mesh_frame.h"

/// How the vertices of a sheet move, for slip velocities.
namespace rustle::analysis {

/// Velocities of a sheet's vertices, worked out one by one: those sent, else positions differenced in double, else those
/// made elsewhere. A view: what it is made from outlives it.
struct VertexVelocities {
  std::span<const sheet::Vec3f> sent_m_per_s;     ///< [V] or empty
  std::span<const sheet::Vec3f> now_m, before_m;  ///< [V] or empty, `interval_s` apart
  double interval_s = 0;
  std::span<const std::optional<sheet::Vec3d>> located_m_per_s;  ///< [V] or empty; none: unknown

  bool any() const { return !sent_m_per_s.empty() || !now_m.empty() || !located_m_per_s.empty(); }
  bool known(std::uint32_t vertex) const { return located_m_per_s.empty() ? any() : located_m_per_s[vertex].has_value(); }
  /// \pre known(vertex)
  /// Has what at() reads brought to the nearest cache.
  void call_for(std::uint32_t vertex) const {
    if (!sent_m_per_s.empty()) __builtin_prefetch(&sent_m_per_s[vertex]);
    if (!now_m.empty()) __builtin_prefetch(&now_m[vertex]), __builtin_prefetch(&before_m[vertex]);
  }
  sheet::Vec3d at(std::uint32_t vertex) const {
    if (!sent_m_per_s.empty()) return sent_m_per_s[vertex].cast<double>();
    if (!located_m_per_s.empty()) return *located_m_per_s[vertex];
    return (now_m[vertex].cast<double>() - before_m[vertex].cast<double>()) * (1 / interval_s);
  }
};

/// Whether two frames are of one topology in time order. `previous` may be null.
bool follows(const sheet::MeshFrame& frame, const sheet::MeshFrame* previous);

/// Velocities across a change of topology, by the place of the same material point in the mesh before; unknown where it lay
/// outside. [V], all unknown when a topology has no material coordinates. O(T + V).
void locate_velocities(const sheet::MeshFrame& frame, const sheet::MeshFrame& before, double interval_s,
                       std::vector<std::optional<sheet::Vec3d>>& out_m_per_s);

}  // namespace rustle::analysis
