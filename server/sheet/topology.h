#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include <tl/expected.hpp>

#include "server/sheet/vector.h"

namespace rustle::sheet {

using Triangle = std::array<std::uint32_t, 3>;

inline constexpr std::uint32_t kNone = 0xffffffffu;

/// An edge between two triangles, running from `start` to `end` as triangle `left` traverses it.
struct InteriorEdge {
  std::uint32_t start, end;
  std::uint32_t left, right;  ///< triangles
  bool consistent;            ///< the right triangle traverses it the other way round, as on an orientable surface
};

/// An edge with one triangle, running as that triangle traverses it.
struct BorderEdge {
  std::uint32_t start, end;
  std::uint32_t triangle;
};

/// What was tolerated, counted.
struct TopologyFlaws {
  std::size_t non_manifold_edges = 0;    ///< with three triangles or more: they join nothing
  std::size_t degenerate_triangles = 0;  ///< with a repeated vertex: left out of all edges
  std::size_t inconsistent_edges = 0;    ///< whose two triangles are oriented against each other
  std::size_t unused_vertices = 0;
};

/// How the triangles of a sheet join. Immutable, shared by all frames that use it.
class Topology {
 public:
  struct Input {
    std::uint64_t id = 0;
    std::size_t vertex_count = 0;
    std::vector<Triangle> triangles;
    std::vector<Vec2f> material_coordinates_m;  ///< [vertex_count] or empty
    std::vector<Vec3f> rest_positions_m;        ///< [vertex_count] or empty
  };

  /// Checks indices, sizes and finiteness, then builds the edges. O(T log T).
  /// Error: a sentence that names the field ("triangles", "material_coordinates", "rest_positions").
  [[nodiscard]] static tl::expected<std::shared_ptr<const Topology>, std::string> make(Input input);

  std::uint64_t id() const { return id_; }
  std::size_t vertex_count() const { return vertex_count_; }
  std::size_t triangle_count() const { return triangles_.size(); }
  std::span<const Triangle> triangles() const { return triangles_; }
  std::span<const InteriorEdge> interior_edges() const { return interior_edges_; }
  std::span<const BorderEdge> border_edges() const { return border_edges_; }
  std::span<const Vec2f> material_coordinates_m() const { return material_coordinates_m_; }  ///< empty: unknown
  std::span<const Vec3f> rest_positions_m() const { return rest_positions_m_; }              ///< empty: unknown
  const TopologyFlaws& flaws() const { return flaws_; }

  /// The interior edge (index into interior_edges()) or kNone across each of a triangle's three sides; side k runs from
  /// its vertex k to its vertex k+1.
  std::span<const std::array<std::uint32_t, 3>> triangle_edges() const { return triangle_edges_; }

 private:
  Topology() = default;

  std::uint64_t id_ = 0;
  std::size_t vertex_count_ = 0;
  std::vector<Triangle> triangles_;
  std::vector<InteriorEdge> interior_edges_;
  std::vector<BorderEdge> border_edges_;
  std::vector<std::array<std::uint32_t, 3>> triangle_edges_;
  std::vector<Vec2f> material_coordinates_m_;
  std::vector<Vec3f> rest_positions_m_;
  TopologyFlaws flaws_;
};

}  // namespace rustle::sheet
