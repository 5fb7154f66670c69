#include "server/analysis/border_change.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>

#include "server/sheet/disjoint_sets.h"
#include "server/sheet/point_grid.h"

namespace rustle::analysis {
namespace {

using sheet::BorderEdge;
using sheet::Vec3d;

constexpr int kSamples = 8;             // along an edge
constexpr double kNewEdges = 0.25;      // an edge is new that goes further from the other border, in its own length
constexpr double kCountedEdges = 0.05;  // of a new edge counts what lies further
constexpr double kSamePlaceEdges = 0.02;
constexpr double kNearEdges = 0.5;       // lost border this near to new border was moved there
constexpr double kLeastEdges = 0.25;     // of a crack, in the mean of its edges
constexpr std::size_t kLeastSplit = 32;  // edges inside, for a split of all vertices to be told from a tear

double squared_distance(const Vec3d& p, const Vec3d& a, const Vec3d& b) {
  const Vec3d way = b - a;
  const double length2 = way.squaredNorm();
  const double t = length2 > 0 ? std::clamp((p - a).dot(way) / length2, 0.0, 1.0) : 0;
  return (a + t * way - p).squaredNorm();
}

/// The border of a mesh, to ask how far points are from it.
class Border {
 public:
  explicit Border(const RestMesh& mesh) : mesh_(mesh), piece_m_(mean_edge_m(mesh)), grid_(pieces(), piece_m_) {}

  /// The distance from a point, or infinity beyond `limit_m`.
  double distance_m(const Vec3d& point, double limit_m) const {
    double least = limit_m * limit_m;
    bool found = false;
    grid_.within(point, limit_m + 0.5 * piece_m_, [&](std::uint32_t piece, double) {
      const BorderEdge& edge = mesh_.topology->border_edges()[edge_of_[piece]];
      const double d2 = squared_distance(point, mesh_.positions_m[edge.start], mesh_.positions_m[edge.end]);
      if (d2 <= least) least = d2, found = true;
    });
    return found ? std::sqrt(least) : std::numeric_limits<double>::infinity();
  }

 private:
  static double mean_edge_m(const RestMesh& mesh) {
    const auto edges = mesh.topology->border_edges();
    double sum = 0;
    for (const BorderEdge& e : edges) sum += (mesh.positions_m[e.end] - mesh.positions_m[e.start]).norm();
    return edges.empty() ? 0 : sum / static_cast<double>(edges.size());
  }

  /// Midpoints of pieces of the edges no longer than the mean edge.
  std::vector<Vec3d> pieces() {
    const auto edges = mesh_.topology->border_edges();
    std::vector<Vec3d> out;
    for (std::uint32_t i = 0; i < edges.size(); ++i) {
      const Vec3d &a = mesh_.positions_m[edges[i].start], &b = mesh_.positions_m[edges[i].end];
      const int count = piece_m_ > 0 ? std::max(1, static_cast<int>(std::ceil((b - a).norm() / piece_m_))) : 1;
      for (int k = 0; k < count; ++k) {
        out.emplace_back(a + (k + 0.5) / count * (b - a));
        edge_of_.push_back(i);
      }
    }
    return out;
  }

  const RestMesh& mesh_;
  double piece_m_;
  std::vector<std::uint32_t> edge_of_;  ///< [piece]
  sheet::PointGrid<3> grid_;
};

/// An edge that the other border does not have.
struct Gone {
  std::uint32_t edge;
  double length_m, counted_m;
  Vec3d a, b;
};

/// Edges of a mesh's border that lie off another border.
std::vector<Gone> edges_off(const RestMesh& mesh, const Border& other) {
  std::vector<Gone> out;
  const auto edges = mesh.topology->border_edges();
  for (std::uint32_t i = 0; i < edges.size(); ++i) {
    const Vec3d &a = mesh.positions_m[edges[i].start], &b = mesh.positions_m[edges[i].end];
    const double length_m = (b - a).norm(), limit_m = kNewEdges * length_m;
    if (!(length_m > 0)) continue;
    bool is_off = false;
    int counted = 0;
    for (int k = 0; k < kSamples; ++k) {
      const double away_m = other.distance_m(a + (k + 0.5) / kSamples * (b - a), limit_m);
      is_off |= away_m > limit_m;
      counted += away_m > kCountedEdges * length_m ? 1 : 0;
    }
    if (is_off) out.push_back({i, length_m, length_m * counted / kSamples, a, b});
  }
  return out;
}

/// Joins edges whose ends lie at one place.
void join_at_ends(const std::vector<Gone>& edges, sheet::DisjointSets& sets) {
  std::vector<Vec3d> ends;
  double sum = 0;
  for (const Gone& edge : edges) ends.push_back(edge.a), ends.push_back(edge.b), sum += edge.length_m;
  const sheet::PointGrid<3> grid(ends, sum / static_cast<double>(edges.size()));
  for (std::uint32_t i = 0; i < ends.size(); ++i) {
    grid.within(ends[i], kSamePlaceEdges * edges[i / 2].length_m, [&](std::uint32_t j, double) { sets.join(i / 2, j / 2); });
  }
}

/// Index of the nearest new edge that a lost one lies beside, or none.
std::uint32_t beside(const Gone& lost, const std::vector<Gone>& edges) {
  double least = std::numeric_limits<double>::infinity();
  std::uint32_t best = sheet::kNone;
  for (std::uint32_t i = 0; i < edges.size(); ++i) {
    const double d2 =
        std::min({squared_distance(0.5 * (lost.a + lost.b), edges[i].a, edges[i].b),
                  squared_distance(lost.a, edges[i].a, edges[i].b), squared_distance(lost.b, edges[i].a, edges[i].b)});
    if (d2 < least) least = d2, best = i;
  }
  return least <= kNearEdges * kNearEdges * lost.length_m * lost.length_m ? best : sheet::kNone;
}

}  // namespace

std::vector<NewBorder> find_new_border(const RestMesh& before, const RestMesh& now) {
  const std::vector<Gone> gained = edges_off(now, Border(before));
  if (gained.empty()) return {};
  const std::size_t inside = before.topology->interior_edges().size();
  if (inside >= kLeastSplit && gained.size() > inside) return {};
  sheet::DisjointSets sets(gained.size());
  join_at_ends(gained, sets);
  struct Piece {
    NewBorder border;
    double edges_m = 0, gained_m = 0;
  };
  std::map<std::uint32_t, Piece> pieces;
  for (std::uint32_t i = 0; i < gained.size(); ++i) {
    Piece& piece = pieces[sets.find(i)];
    piece.border.edges.push_back(gained[i].edge);
    piece.edges_m += gained[i].length_m;
    piece.gained_m += gained[i].counted_m;
  }
  for (const Gone& lost : edges_off(before, Border(now))) {
    const std::uint32_t near = beside(lost, gained);
    if (near != sheet::kNone) pieces[sets.find(near)].gained_m -= lost.counted_m;
  }
  std::vector<NewBorder> out;
  for (auto& [first, piece] : pieces) {
    piece.border.length_m = piece.gained_m / 2;
    const double mean_m = piece.edges_m / static_cast<double>(piece.border.edges.size());
    if (piece.border.length_m > kLeastEdges * mean_m) out.push_back(std::move(piece.border));
  }
  return out;
}

}  // namespace rustle::analysis
