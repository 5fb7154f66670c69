#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <unordered_map>
#include <vector>

#include "client_sdk/sheets/plane_vector.h"
#include "client_sdk/sheets/rectangle.h"
#include "client_sdk/sheets/tearing_hands.h"

namespace rustle::sheets {

/// What a torn mesh's vertex is.
enum class TornVertex : std::uint8_t {
  kSheet,     ///< of the sheet, wherever
  kLeftLip,   ///< on the tear's edge, left of one who goes along with it
  kRightLip,  ///< its counterpart, of the same material point
  kTip,       ///< the tear's end, or its start while nothing is torn: joined still
};

/// A rectangle's mesh that is cut along a growing path.
///
/// The path's points become vertices, once on either lip but for the tip; the mesh about them is refined, with edges that
/// grow with the distance from the path. It is the Delaunay triangulation of its points, cut open: vertices closer to the
/// path than its own points are to each other give way, so that every piece of the path is an edge (its diametral circle is
/// empty). Material coordinates of vertices never change; a vertex is there from one cut to the next or is not.
class TornMesh {
 public:
  /// `base`: any mesh of the rectangle. texel_m: the least distance of the path's points.
  TornMesh(const SheetMesh& base, const RectangleSize& size, double texel_m, std::uint64_t seed);

  /// The path has grown. `finished`: its last point lies on the border, the sheet is in two. O(N log N).
  /// \pre begins with the points of the last call; [0] on the border, others at least a texel apart
  void cut(std::span<const Point2> path_m, bool finished);

  const SheetMesh& mesh() const { return mesh_; }
  std::span<const TornVertex> vertices() const { return vertices_; }
  /// The vertex of each of the path's points on a lip; the tip is the same on both.
  std::span<const std::uint32_t> lip(TornSide side) const { return lips_[side]; }

 private:
  struct Cell {
    int i, j;
    friend bool operator==(Cell, Cell) = default;
  };
  struct CellHash {
    std::size_t operator()(Cell c) const;
  };

  Cell cell_of(Point2 p) const;
  bool any_within(Point2 p, double distance_m) const;
  void clear_about(Point2 p, double distance_m);
  void keep(Point2 p);
  void refine_about(Point2 p);
  void triangulate(std::span<const Point2> path_m, bool finished);

  RectangleSize size_;
  double texel_m_, base_edge_m_;
  std::uint64_t seed_;
  std::vector<std::optional<Point2>> points_;                             ///< of the sheet; absent: it gave way to the path
  std::unordered_map<Cell, std::vector<std::uint32_t>, CellHash> cells_;  ///< of points, and path points from kPathPoint on
  std::vector<Point2> path_;
  SheetMesh mesh_;
  std::vector<TornVertex> vertices_;
  std::vector<std::uint32_t> lips_[2];
};

}  // namespace rustle::sheets
