#include "server/analysis/tears.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

namespace rustle::analysis {
namespace {

using observation::TearEvent;
using sheet::Vec3d;
using sheet::Vec3f;
using Tip = TearState::Tip;

constexpr double kTipAngle_rad = 315.0 * std::numbers::pi / 180.0;
constexpr double kSameTipEdges = 0.3;  // a crack begins at a known tip that is this near, in the mean of its edges

template <class Points, class ToRest>
std::vector<Vec3d> points_of(const Points& points, ToRest&& to_rest) {
  std::vector<Vec3d> out;
  out.reserve(points.size());
  for (const auto& p : points) out.push_back(to_rest(p));
  return out;
}

Vec3d in_space(const Vec3f& p) {
  return p.cast<double>();
}
Vec3d in_plane(const sheet::Vec2f& p) {
  return {static_cast<double>(p.x()), static_cast<double>(p.y()), 0};
}

/// The old vertex at every new vertex's corners, where triangle by triangle they are the same.
std::optional<std::vector<std::uint32_t>> by_triangles(const sheet::Topology& from, const sheet::Topology& to) {
  if (from.triangle_count() != to.triangle_count()) return std::nullopt;
  std::vector<std::uint32_t> origin(to.vertex_count(), sheet::kNone);
  for (std::size_t f = 0; f < to.triangle_count(); ++f) {
    for (std::size_t k = 0; k < 3; ++k) {
      std::uint32_t& of = origin[to.triangles()[f][k]];
      if (of != sheet::kNone && of != from.triangles()[f][k]) return std::nullopt;
      of = from.triangles()[f][k];
    }
  }
  return origin;
}

/// A crack's vertices and what can be said of them.
struct Crack {
  struct End {
    std::uint32_t vertex;
    double length_m = 0;  ///< torn on the way to it
  };
  std::vector<std::uint32_t> vertices;  ///< of its edges, each once
  std::vector<End> tips;
  double mean_edge_m = 0;
};

/// Border edges at each of some vertices, and the angle that its triangles fill in rest space.
struct Corner {
  int border_edges = 0;
  double angle_rad = 0;
};

std::vector<Corner> corners_of(const RestMesh& mesh, const std::vector<NewBorder>& cracks) {
  std::vector<std::uint8_t> asked(mesh.positions_m.size(), 0);
  const auto edges = mesh.topology->border_edges();
  for (const NewBorder& crack : cracks) {
    for (const std::uint32_t e : crack.edges) asked[edges[e].start] = asked[edges[e].end] = 1;
  }
  std::vector<Corner> out(mesh.positions_m.size());
  for (const auto& edge : edges) ++out[edge.start].border_edges, ++out[edge.end].border_edges;
  for (const sheet::Triangle& v : mesh.topology->triangles()) {
    for (std::size_t k = 0; k < 3; ++k) {
      if (asked[v[k]] == 0) continue;
      const Vec3d u = mesh.positions_m[v[(k + 1) % 3]] - mesh.positions_m[v[k]];
      const Vec3d w = mesh.positions_m[v[(k + 2) % 3]] - mesh.positions_m[v[k]];
      out[v[k]].angle_rad += std::atan2(u.cross(w).norm(), u.dot(w));
    }
  }
  return out;
}

/// The vertex among these that lies furthest from a point.
std::uint32_t furthest(const std::vector<std::uint32_t>& vertices, const RestMesh& mesh, const Vec3d& from_m) {
  return *std::max_element(vertices.begin(), vertices.end(), [&](std::uint32_t a, std::uint32_t b) {
    return (mesh.positions_m[a] - from_m).squaredNorm() < (mesh.positions_m[b] - from_m).squaredNorm();
  });
}

Crack crack_of(const NewBorder& border, const RestMesh& mesh, const std::vector<Corner>& corners) {
  Crack crack;
  const auto edges = mesh.topology->border_edges();
  for (const std::uint32_t e : border.edges) {
    crack.vertices.push_back(edges[e].start);
    crack.vertices.push_back(edges[e].end);
    crack.mean_edge_m += (mesh.positions_m[edges[e].end] - mesh.positions_m[edges[e].start]).norm() /
                         static_cast<double>(border.edges.size());
  }
  std::sort(crack.vertices.begin(), crack.vertices.end());
  crack.vertices.erase(std::unique(crack.vertices.begin(), crack.vertices.end()), crack.vertices.end());
  for (const std::uint32_t v : crack.vertices) {
    if (corners[v].border_edges == 2 && corners[v].angle_rad >= kTipAngle_rad) crack.tips.push_back({v});
  }
  return crack;
}

/// Gives every edge's part of the length to the tip nearest to it.
void share_length(const NewBorder& border, const RestMesh& mesh, Crack& crack) {
  double total_m = 0;
  const auto edges = mesh.topology->border_edges();
  for (const std::uint32_t e : border.edges) {
    const Vec3d &a = mesh.positions_m[edges[e].start], &b = mesh.positions_m[edges[e].end];
    auto& nearest = *std::min_element(crack.tips.begin(), crack.tips.end(), [&](const auto& s, const auto& t) {
      return (mesh.positions_m[s.vertex] - 0.5 * (a + b)).squaredNorm() <
             (mesh.positions_m[t.vertex] - 0.5 * (a + b)).squaredNorm();
    });
    nearest.length_m += (b - a).norm();
    total_m += (b - a).norm();
  }
  for (auto& tip : crack.tips) tip.length_m *= border.length_m / total_m;
}

/// In space, from where the crack began to a tip: from a place in rest space, both lips of it.
Vec3d direction_to(std::uint32_t tip, const Vec3d& start_m, const Crack& crack, const RestMesh& mesh,
                   const sheet::MeshFrame& frame) {
  double least = std::numeric_limits<double>::infinity();
  for (const std::uint32_t v : crack.vertices) least = std::min(least, (mesh.positions_m[v] - start_m).norm());
  Vec3d sum = Vec3d::Zero();
  int count = 0;
  for (const std::uint32_t v : crack.vertices) {
    if ((mesh.positions_m[v] - start_m).norm() > least + 0.1 * crack.mean_edge_m) continue;
    sum += in_space(frame.positions_m[v]);
    ++count;
  }
  const Vec3d way = in_space(frame.positions_m[tip]) - sum / count;
  const double length_m = way.norm();
  return length_m > 0 ? Vec3d(way / length_m) : Vec3d::Zero();
}

/// Where in rest space a crack set out to this tip: at the nearest tip that it goes on from, or else furthest away.
Vec3d start_of(std::uint32_t tip, const Crack& crack, const std::vector<Tip>& bases, const RestPair& rest) {
  const Vec3d& end_m = rest.now.positions_m[tip];
  if (bases.empty()) return rest.now.positions_m[furthest(crack.vertices, rest.now, end_m)];
  const auto nearest = std::min_element(bases.begin(), bases.end(), [&](const Tip& a, const Tip& b) {
    return (rest.before.positions_m[a.vertex] - end_m).squaredNorm() <
           (rest.before.positions_m[b.vertex] - end_m).squaredNorm();
  });
  return rest.before.positions_m[nearest->vertex];
}

/// Whether an edge of the crack begins at, or passes, this place.
bool begins_at(const Vec3d& place_m, const Crack& crack, const RestMesh& mesh) {
  return std::any_of(crack.vertices.begin(), crack.vertices.end(), [&](std::uint32_t v) {
    return (mesh.positions_m[v] - place_m).norm() <= kSameTipEdges * crack.mean_edge_m;
  });
}

/// The border vertex of the new mesh where an old one was, or none.
std::uint32_t same_vertex(const Vec3d& place_m, const RestMesh& mesh) {
  std::uint32_t best = sheet::kNone;
  double least = std::numeric_limits<double>::infinity(), length2 = 0;
  for (const auto& edge : mesh.topology->border_edges()) {
    const double d2 = (mesh.positions_m[edge.start] - place_m).squaredNorm();
    if (d2 >= least) continue;
    least = d2, best = edge.start;
    length2 = (mesh.positions_m[edge.end] - mesh.positions_m[edge.start]).squaredNorm();
  }
  return least <= kSameTipEdges * kSameTipEdges * length2 ? best : sheet::kNone;
}

/// The cracks that one change of topology opened.
class Opening {
 public:
  Opening(const RestPair& rest, const sheet::MeshFrame& frame, double interval_s, TearState& state,
          std::uint64_t& next_event_id)
      : rest_(rest), frame_(frame), interval_s_(interval_s), state_(state), next_event_id_(next_event_id) {}

  std::vector<TearEvent> find() {
    const std::vector<NewBorder> cracks = find_new_border(rest_.before, rest_.now);
    std::vector<Tip> known = std::exchange(state_.tips, {});
    if (!cracks.empty()) {
      const std::vector<Corner> corners = corners_of(rest_.now, cracks);
      for (const NewBorder& border : cracks) open(border, corners, known);
    }
    for (Tip& tip : known) {
      tip.vertex = same_vertex(rest_.before.positions_m[tip.vertex], rest_.now);
      if (tip.vertex != sheet::kNone) state_.tips.push_back(tip);
    }
    return std::move(out_);
  }

 private:
  /// Tips that the crack goes on from; they are taken out of the known ones.
  std::vector<Tip> taken_from(const Crack& crack, std::vector<Tip>& known) const {
    std::vector<Tip> out;
    std::erase_if(known, [&](const Tip& tip) {
      const bool is_base = begins_at(rest_.before.positions_m[tip.vertex], crack, rest_.now);
      if (is_base) out.push_back(tip);
      return is_base;
    });
    return out;
  }

  void open(const NewBorder& border, const std::vector<Corner>& corners, std::vector<Tip>& known) {
    Crack crack = crack_of(border, rest_.now, corners);
    std::vector<Tip> bases = taken_from(crack, known);
    const bool has_tips = !crack.tips.empty();
    if (!has_tips) {
      const Vec3d from_m =
          bases.empty()
              ? rest_.now.positions_m[furthest(crack.vertices, rest_.now, rest_.now.positions_m[crack.vertices.front()])]
              : rest_.before.positions_m[bases.front().vertex];
      crack.tips.push_back({furthest(crack.vertices, rest_.now, from_m)});
    }
    share_length(border, rest_.now, crack);
    std::vector<Vec3d> directions;
    for (const auto& tip : crack.tips) {
      const Vec3d start_m = start_of(tip.vertex, crack, bases, rest_);
      directions.push_back(direction_to(tip.vertex, start_m, crack, rest_.now, frame_));
    }
    const std::vector<const Tip*> before = continued(bases, directions);
    for (std::size_t k = 0; k < crack.tips.size(); ++k) {
      const auto& end = crack.tips[k];
      Tip tip{before[k] ? before[k]->id : next_event_id_++, end.vertex, directions[k], frame_.time_s,
              (before[k] ? before[k]->torn_m : 0) + end.length_m};
      TearEvent event;
      event.id = tip.id;
      event.speed_m_per_s = end.length_m / interval_s_;
      event.torn_m = tip.torn_m;
      event.position_m = in_space(frame_.positions_m[tip.vertex]);
      event.direction = tip.direction;
      event.vertex = tip.vertex;
      out_.push_back(std::move(event));
      if (has_tips) state_.tips.push_back(tip);
    }
  }

  /// The tip that each direction continues, or none: every tip goes on the straightest way, at most.
  static std::vector<const Tip*> continued(const std::vector<Tip>& bases, const std::vector<Vec3d>& directions) {
    std::vector<const Tip*> out(directions.size(), nullptr);
    for (const Tip& base : bases) {
      double straightest = -2;
      std::size_t best = directions.size();
      for (std::size_t k = 0; k < directions.size(); ++k) {
        const double along = base.direction.dot(directions[k]);
        if (!out[k] && along > straightest) straightest = along, best = k;
      }
      if (best < directions.size()) out[best] = &base;
    }
    return out;
  }

  const RestPair& rest_;
  const sheet::MeshFrame& frame_;
  double interval_s_;
  TearState& state_;
  std::uint64_t& next_event_id_;
  std::vector<TearEvent> out_;
};

}  // namespace

std::optional<RestPair> common_rest_space(const TopologyChange& change, const sheet::MeshFrame& frame) {
  const sheet::Topology &from = *change.from, &to = *frame.topology;
  RestPair out{{&from, {}}, {&to, {}}};
  if (!from.material_coordinates_m().empty() && !to.material_coordinates_m().empty()) {
    out.before.positions_m = points_of(from.material_coordinates_m(), in_plane);
    out.now.positions_m = points_of(to.material_coordinates_m(), in_plane);
    return out;
  }
  if (!from.rest_positions_m().empty() && !to.rest_positions_m().empty()) {
    out.before.positions_m = points_of(from.rest_positions_m(), in_space);
    out.now.positions_m = points_of(to.rest_positions_m(), in_space);
    return out;
  }
  out.before.positions_m = points_of(change.from_m, in_space);
  if (const auto origin = by_triangles(from, to)) {
    out.now.positions_m = points_of(
        *origin, [&](std::uint32_t v) { return v == sheet::kNone ? Vec3d(Vec3d::Zero()) : out.before.positions_m[v]; });
    return out;
  }
  if (!change.whole || change.carried_m.size() != to.vertex_count()) return std::nullopt;
  out.now.positions_m = points_of(change.carried_m, in_space);
  return out;
}

std::vector<TearEvent> find_tears(const sheet::MeshFrame& frame, const TopologyChange* change, const Parameters& parameters,
                                  TearState& state, std::uint64_t& next_event_id) {
  std::vector<TearEvent> out;
  if (change != nullptr) {
    const auto rest = common_rest_space(*change, frame);
    const double interval_s = frame.time_s - change->previous_s;
    if (rest && interval_s > 0) {
      out = Opening(*rest, frame, interval_s, state, next_event_id).find();
    } else {
      state.tips.clear();
    }
  }
  std::erase_if(state.tips, [&](const Tip& tip) { return tip.advanced_s < frame.time_s - parameters.tear_memory_s; });
  for (const Tip& tip : state.tips) {
    if (tip.advanced_s == frame.time_s) continue;
    TearEvent event;
    event.id = tip.id;
    event.torn_m = tip.torn_m;
    event.position_m = in_space(frame.positions_m[tip.vertex]);
    event.direction = tip.direction;
    event.vertex = tip.vertex;
    out.push_back(std::move(event));
  }
  return out;
}

}  // namespace rustle::analysis
