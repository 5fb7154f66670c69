#include "server/analysis/contact_patch.h"

#include <algorithm>
#include <array>
#include <cassert>
#include <cmath>
#include <functional>
#include <iterator>
#include <limits>
#include <numeric>
#include <queue>
#include <utility>

namespace rustle::analysis {
namespace {

using scene::Box;
using sheet::kNone;
using sheet::Triangle;
using sheet::Vec2d;
using sheet::Vec3d;
using sheet::Vec3f;

constexpr int kMostSamplesAlong = 16;
constexpr double kSampleHeights = 0.35;  ///< of the radius, between samples: in height where the distance is linear
constexpr double kSampleLengths = 1.0;   ///< of the radius, along the sheet elsewhere
constexpr double kParallel = 0.9999;
constexpr double kPlaneTolerance = 0.03;  ///< of the radius

Vec3d at(std::span<const Vec3f> positions_m, const Triangle& triangle, const Vec3d& barycentric) {
  return barycentric[0] * positions_m[triangle[0]].cast<double>() +
         barycentric[1] * positions_m[triangle[1]].cast<double>() + barycentric[2] * positions_m[triangle[2]].cast<double>();
}

/// Sums over samples, by vertex.
class Accumulator {
 public:
  explicit Accumulator(std::size_t vertex_count) : place_(vertex_count, kNone) {}

  void add(std::uint32_t vertex, double area_m2, const Vec3d& slip_m_per_s, std::uint32_t partner_triangle) {
    if (place_[vertex] == kNone) {
      place_[vertex] = static_cast<std::uint32_t>(entries_.size());
      entries_.push_back({vertex, 0, 0, Vec3d::Zero(), kNone});
    }
    Entry& entry = entries_[place_[vertex]];
    entry.area_m2 += area_m2;
    entry.speed_area += area_m2 * slip_m_per_s.norm();
    entry.slip_area += area_m2 * slip_m_per_s;
    if (entry.partner_triangle == kNone) entry.partner_triangle = partner_triangle;
  }

  ContactPatch patch() {
    std::sort(entries_.begin(), entries_.end(), [](const Entry& a, const Entry& b) { return a.vertex < b.vertex; });
    ContactPatch patch;
    for (const Entry& entry : entries_) {
      patch.vertices.push_back(entry.vertex);
      patch.areas_m2.push_back(entry.area_m2);
      // The mean direction with the mean speed: slips over a partner's two faces do not cancel.
      patch.slips_m_per_s.push_back(entry.slip_area.normalized() * (entry.speed_area / entry.area_m2));
      patch.partner_triangles.push_back(entry.partner_triangle);
    }
    return patch;
  }

 private:
  struct Entry {
    std::uint32_t vertex;
    double area_m2;
    double speed_area;
    Vec3d slip_area;
    std::uint32_t partner_triangle;
  };
  std::vector<std::uint32_t> place_;
  std::vector<Entry> entries_;
};

class Measurement {
 public:
  Measurement(const ContactGeometry& geometry, ContactSurface& surface, const VertexVelocities& velocities,
              const ContactWeight& weight, double radius_m)
      : geometry_(geometry),
        topology_(*geometry.frame->topology),
        positions_m_(geometry.frame->positions_m),
        surface_(surface),
        velocities_(velocities),
        weight_(weight),
        radius_m_(radius_m),
        margin_m_(surface.range_beyond_m()),
        corners_(topology_.vertex_count()),
        lumped_m2_(topology_.vertex_count(), 0.0),
        sums_(topology_.vertex_count()) {}

  ContactPatch run() {
    for (std::uint32_t t = 0; t < topology_.triangle_count(); ++t) {
      const double area_m2 = 0.5 * static_cast<double>(geometry_.cross_products_m2[t].norm());
      if (!(area_m2 > 0)) continue;
      const Triangle& v = topology_.triangles()[t];
      const SheetTriangle triangle{
          t, {positions_m_[v[0]].cast<double>(), positions_m_[v[1]].cast<double>(), positions_m_[v[2]].cast<double>()}};
      if (surface_.approach(triangle, radius_m_)) measure(triangle, area_m2);
    }
    for (std::uint32_t v = 0; v < topology_.vertex_count(); ++v) {
      if (lumped_m2_[v] <= 0) continue;
      const Touch& touch = *corners_[v].touch;
      const Vec3d slip = velocities_.known(v) && touch.velocity_known
                             ? tangential(velocities_.velocities_m_per_s[v] - touch.velocity_m_per_s, touch)
                             : Vec3d::Zero();
      sums_.add(v, lumped_m2_[v], slip, touch.triangle);
    }
    return sums_.patch();
  }

 private:
  struct Corner {
    double weight = kUnasked;
    std::optional<Touch> touch;
  };
  static constexpr double kUnasked = -1;

  const Corner& corner(std::uint32_t t, std::size_t k) {
    const std::uint32_t vertex = topology_.triangles()[t][k];
    if (corners_[vertex].weight == kUnasked) {
      Corner& made = corners_[vertex];
      made.touch =
          surface_.touch(positions_m_[vertex].cast<double>(), {t, Vec3d::Unit(static_cast<int>(k))}, radius_m_ + margin_m_);
      made.weight = made.touch ? weight_.at(made.touch->distance_m, radius_m_) : 0.0;
    }
    return corners_[vertex];
  }

  /// Whether the partner is one plane as seen from all three corners: then the distance is linear over the triangle.
  bool faces_a_plane(const Triangle& triangle, const std::array<const Corner*, 3>& corners) const {
    if (!corners[0]->touch || !corners[1]->touch || !corners[2]->touch) return false;
    const Touch& first = *corners[0]->touch;
    const Vec3d origin = positions_m_[triangle[0]].cast<double>();
    for (std::size_t k = 1; k < 3; ++k) {
      const Touch& touch = *corners[k]->touch;
      if (touch.normal.dot(first.normal) < kParallel) return false;
      const double rise = first.side_normal.dot(positions_m_[triangle[k]].cast<double>() - origin);
      if (std::abs(first.distance_m + rise - touch.distance_m) > kPlaneTolerance * radius_m_) return false;
    }
    return true;
  }

  int samples_along(double wanted) const {
    return static_cast<int>(std::clamp(std::ceil(wanted), 1.0, static_cast<double>(kMostSamplesAlong)));
  }

  void measure(const SheetTriangle& place, double area_m2) {
    const std::uint32_t t = place.index;
    const Triangle& triangle = topology_.triangles()[t];
    const std::array<const Corner*, 3> corners = {&corner(t, 0), &corner(t, 1), &corner(t, 2)};
    const auto reached = std::count_if(corners.begin(), corners.end(), [](const Corner* c) { return c->weight > 0; });
    const bool linear = reached < 3 && faces_a_plane(triangle, corners);
    int n = 1;
    if (linear) {
      const auto [low, high] =
          std::minmax({corners[0]->touch->distance_m, corners[1]->touch->distance_m, corners[2]->touch->distance_m});
      if (low >= radius_m_) return;
      n = samples_along((high - low) / (kSampleHeights * radius_m_));
    } else if (reached < 3) {
      double longest_m = 0;
      for (std::size_t k = 0; k < 3; ++k) {
        const Vec3f side = positions_m_[triangle[(k + 1) % 3]] - positions_m_[triangle[k]];
        longest_m = std::max(longest_m, static_cast<double>(side.norm()));
      }
      if (out_of_reach(corners, longest_m)) return;
      n = longest_m < radius_m_ ? 1 : samples_along(longest_m / (kSampleLengths * radius_m_));
    }
    if (n == 1) {
      for (std::size_t k = 0; k < 3; ++k) {
        if (corners[k]->weight > 0) lumped_m2_[triangle[k]] += corners[k]->weight * area_m2 / 3;
      }
      return;
    }
    const double sample_area_m2 = area_m2 / (n * n);
    for (int i = 0; i < n; ++i) {
      for (int j = 0; j < n - i; ++j) {
        sample(t, corners, linear, (i + 1.0 / 3) / n, (j + 1.0 / 3) / n, sample_area_m2);
        if (j < n - 1 - i) sample(t, corners, linear, (i + 2.0 / 3) / n, (j + 2.0 / 3) / n, sample_area_m2);
      }
    }
  }

  /// No place of a triangle is farther from its nearest corner than its longest side over √3.
  bool out_of_reach(const std::array<const Corner*, 3>& corners, double longest_m) const {
    return std::all_of(corners.begin(), corners.end(), [&](const Corner* corner) {
      const double least_m = corner->touch ? corner->touch->distance_m : radius_m_ + margin_m_;
      return least_m - longest_m / std::sqrt(3.0) >= radius_m_;
    });
  }

  static Touch interpolated(const std::array<const Corner*, 3>& corners, const Vec3d& barycentric) {
    Touch touch = *corners[0]->touch;
    touch.distance_m = 0;
    touch.velocity_m_per_s.setZero();
    for (std::size_t k = 0; k < 3; ++k) {
      const double share = barycentric[static_cast<int>(k)];
      touch.distance_m += share * corners[k]->touch->distance_m;
      touch.velocity_m_per_s += share * corners[k]->touch->velocity_m_per_s;
      touch.velocity_known = touch.velocity_known && corners[k]->touch->velocity_known;
    }
    return touch;
  }

  void sample(std::uint32_t t, const std::array<const Corner*, 3>& corners, bool linear, double b1, double b2,
              double area_m2) {
    const Triangle& triangle = topology_.triangles()[t];
    const Vec3d barycentric(1 - b1 - b2, b1, b2);
    const std::optional<Touch> touch =
        linear ? interpolated(corners, barycentric)
               : surface_.touch(at(positions_m_, triangle, barycentric), {t, barycentric}, radius_m_);
    if (!touch) return;
    const double weight = weight_.at(touch->distance_m, radius_m_);
    if (weight <= 0) return;
    const Vec3d slip = slip_m_per_s(triangle, barycentric, *touch);
    double shared = 0;
    for (std::size_t k = 0; k < 3; ++k) {
      if (corners[k]->weight > 0) shared += barycentric[static_cast<int>(k)];
    }
    if (shared > 0) {
      for (std::size_t k = 0; k < 3; ++k) {
        if (corners[k]->weight <= 0) continue;
        sums_.add(triangle[k], weight * area_m2 * barycentric[static_cast<int>(k)] / shared, slip, touch->triangle);
      }
      return;
    }
    int nearest = 0;
    barycentric.maxCoeff(&nearest);
    sums_.add(triangle[static_cast<std::size_t>(nearest)], weight * area_m2, slip, touch->triangle);
  }

  Vec3d slip_m_per_s(const Triangle& triangle, const Vec3d& barycentric, const Touch& touch) const {
    if (!touch.velocity_known) return Vec3d::Zero();
    Vec3d velocity = -touch.velocity_m_per_s;
    for (std::size_t k = 0; k < 3; ++k) {
      const double share = barycentric[static_cast<int>(k)];
      if (share == 0) continue;
      if (!velocities_.known(triangle[k])) return Vec3d::Zero();
      velocity += share * velocities_.velocities_m_per_s[triangle[k]];
    }
    return tangential(velocity, touch);
  }

  static Vec3d tangential(const Vec3d& velocity_m_per_s, const Touch& touch) {
    return velocity_m_per_s - touch.normal * touch.normal.dot(velocity_m_per_s);
  }

  const ContactGeometry& geometry_;
  const sheet::Topology& topology_;
  std::span<const Vec3f> positions_m_;
  ContactSurface& surface_;
  const VertexVelocities& velocities_;
  const ContactWeight& weight_;
  double radius_m_;
  double margin_m_;                ///< distances from corners are known this far beyond the radius
  std::vector<Corner> corners_;    ///< [V]
  std::vector<double> lumped_m2_;  ///< [V], contact area of triangles with all corners within reach
  Accumulator sums_;
};

Box box_around(const SheetTriangle& triangle, double by_m) {
  const auto& p = triangle.corners_m;
  return {Vec3d(p[0].cwiseMin(p[1]).cwiseMin(p[2]) - Vec3d::Constant(by_m)),
          Vec3d(p[0].cwiseMax(p[1]).cwiseMax(p[2]) + Vec3d::Constant(by_m))};
}

/// Whether all corners of b lie on one side of a's plane, farther from it than the distance.
bool apart_by_plane(const std::array<Vec3d, 3>& a, const std::array<Vec3d, 3>& b, double distance_m) {
  const Vec3d normal = (a[1] - a[0]).cross(a[2] - a[0]);
  const double limit = distance_m * normal.norm();
  const double d0 = normal.dot(b[0] - a[0]);
  const double d1 = normal.dot(b[1] - a[0]);
  const double d2 = normal.dot(b[2] - a[0]);
  return (d0 > limit && d1 > limit && d2 > limit) || (d0 < -limit && d1 < -limit && d2 < -limit);
}

double cross(const Vec2d& a, const Vec2d& b) {
  return a.x() * b.y() - a.y() * b.x();
}

}  // namespace

double ContactWeight::at(double distance_m, double radius_m) const {
  if (distance_m < -penetration_m || distance_m >= radius_m) return 0;
  const double x = (distance_m / radius_m - full_share) / (1 - full_share);
  return x <= 0 ? 1.0 : 1 - x * x * (3 - 2 * x);
}

void ContactGeometry::update(const sheet::MeshFrame& mesh_frame) {
  frame = &mesh_frame;
  const auto triangles = mesh_frame.topology->triangles();
  cross_products_m2.resize(triangles.size());
  for (std::size_t t = 0; t < triangles.size(); ++t) {
    const Vec3f& a = mesh_frame.positions_m[triangles[t][0]];
    cross_products_m2[t] = (mesh_frame.positions_m[triangles[t][1]] - a).cross(mesh_frame.positions_m[triangles[t][2]] - a);
  }
  double area_m2 = 0;
  for (const Vec3f& c : cross_products_m2) area_m2 += 0.5 * static_cast<double>(c.norm());
  usual_edge_m = triangles.empty() ? 0.0 : std::sqrt(area_m2 / static_cast<double>(triangles.size()) * 4 / std::sqrt(3.0));
  Eigen::AlignedBox3f bounds;
  for (const Vec3f& p : mesh_frame.positions_m) bounds.extend(p);
  bounds_m = bounds.isEmpty() ? Box() : Box(bounds.min().cast<double>(), bounds.max().cast<double>());
}

ContactPatch measure_contact(const ContactGeometry& geometry, ContactSurface& surface, const VertexVelocities& velocities,
                             const ContactWeight& weight, double radius_m) {
  return Measurement(geometry, surface, velocities, weight, radius_m).run();
}

bool ObstacleContact::approach(const SheetTriangle& triangle, double radius_m) {
  return obstacle_.is_plane() || obstacle_.may_meet(box_around(triangle, radius_m));
}

std::optional<Touch> ObstacleContact::touch(const Vec3d& point_m, const SheetSpot&, double radius_m) {
  const auto closest = obstacle_.closest(point_m, radius_m);
  if (!closest) return std::nullopt;
  // A mesh may be open: both of its sides are outside.
  const bool behind = obstacle_.is_mesh() && closest->distance_m < 0;
  Touch touch;
  touch.distance_m = behind ? -closest->distance_m : closest->distance_m;
  touch.normal = closest->normal;
  touch.side_normal = behind ? Vec3d(-closest->normal) : closest->normal;
  touch.velocity_m_per_s = obstacle_.velocity_m_per_s(*closest);
  touch.triangle = closest->triangle;
  return touch;
}

double ObstacleContact::range_beyond_m() const {
  return obstacle_.is_plane() ? std::numeric_limits<double>::infinity() : beyond_m_;
}

SurfaceDistance::SurfaceDistance(std::shared_ptr<const sheet::Topology> topology, std::span<const Vec3f> positions_m,
                                 double least_m, double edges)
    : topology_(std::move(topology)), least_m_(least_m) {
  const auto triangles = topology_->triangles();
  const auto material = topology_->material_coordinates_m();
  const auto rest = topology_->rest_positions_m().empty() ? positions_m : topology_->rest_positions_m();
  const auto length_m = [&](std::uint32_t a, std::uint32_t b) -> double {
    return static_cast<double>(material.empty() ? (rest[a] - rest[b]).norm() : (material[a] - material[b]).norm());
  };
  exclusion_m_.resize(triangles.size());
  for (std::size_t t = 0; t < triangles.size(); ++t) {
    const Triangle& v = triangles[t];
    const double mean_m = (length_m(v[0], v[1]) + length_m(v[1], v[2]) + length_m(v[2], v[0])) / 3;
    exclusion_m_[t] = std::max(least_m, edges * mean_m);
  }
  std::vector<std::uint32_t> piece(topology_->vertex_count());
  std::iota(piece.begin(), piece.end(), 0u);
  const auto root = [&](std::uint32_t v) {
    while (piece[v] != v) v = piece[v] = piece[piece[v]];
    return v;
  };
  for (const Triangle& v : triangles) {
    piece[root(v[1])] = root(v[0]);
    piece[root(v[2])] = root(v[0]);
  }
  for (const Triangle& v : triangles) connected_ = connected_ && root(v[0]) == root(triangles[0][0]);

  if (!material.empty()) {
    centre_m_.resize(triangles.size());
    extent_m_.resize(triangles.size());
    for (std::size_t t = 0; t < triangles.size(); ++t) {
      const Triangle& v = triangles[t];
      centre_m_[t] = ((material[v[0]] + material[v[1]] + material[v[2]]) / 3).cast<double>();
      for (const std::uint32_t c : v) {
        extent_m_[t] = std::max(extent_m_[t], (material[c].cast<double>() - centre_m_[t]).norm());
      }
    }
    return;
  }
  vertices_around_.resize(topology_->vertex_count());
  triangles_around_.resize(triangles.size());
  marks_.assign(triangles.size(), kNone);
  vertex_exclusion_m_.assign(topology_->vertex_count(), 0.0);
  triangle_start_.assign(topology_->vertex_count() + 1, 0);
  for (std::size_t t = 0; t < triangles.size(); ++t) {
    for (const std::uint32_t v : triangles[t]) {
      vertex_exclusion_m_[v] = std::max(vertex_exclusion_m_[v], exclusion_m_[t]);
      ++triangle_start_[v + 1];
    }
  }
  for (std::size_t v = 0; v < topology_->vertex_count(); ++v) triangle_start_[v + 1] += triangle_start_[v];
  triangles_of_vertex_.resize(triangle_start_.back());
  std::vector<std::uint32_t> next_triangle(triangle_start_.begin(), triangle_start_.end() - 1);
  for (std::uint32_t t = 0; t < triangles.size(); ++t) {
    for (const std::uint32_t v : triangles[t]) triangles_of_vertex_[next_triangle[v]++] = t;
  }
  link_start_.assign(topology_->vertex_count() + 1, 0);
  const auto each_edge = [&](auto&& visit) {
    for (const auto& edge : topology_->interior_edges()) visit(edge.start, edge.end);
    for (const auto& edge : topology_->border_edges()) visit(edge.start, edge.end);
  };
  each_edge([&](std::uint32_t a, std::uint32_t b) { ++link_start_[a + 1], ++link_start_[b + 1]; });
  for (std::size_t v = 0; v < topology_->vertex_count(); ++v) link_start_[v + 1] += link_start_[v];
  links_.resize(link_start_.back());
  std::vector<std::uint32_t> next(link_start_.begin(), link_start_.end() - 1);
  each_edge([&](std::uint32_t a, std::uint32_t b) {
    const double length = length_m(a, b);
    links_[next[a]++] = {b, length};
    links_[next[b]++] = {a, length};
  });
}

Vec2d SurfaceDistance::material_at(const SheetSpot& spot) const {
  const auto material = topology_->material_coordinates_m();
  const Triangle& v = topology_->triangles()[spot.triangle];
  Vec2d sum = Vec2d::Zero();
  for (std::size_t k = 0; k < 3; ++k) sum += spot.barycentric[static_cast<int>(k)] * material[v[k]].cast<double>();
  return sum;
}

bool SurfaceDistance::neighbours(const SheetSpot& a, const SheetSpot& b) {
  const double within_m = std::max(exclusion_m_[a.triangle], exclusion_m_[b.triangle]);
  if (!centre_m_.empty()) return (material_at(a) - material_at(b)).squaredNorm() < within_m * within_m;
  const auto corner = [&](const SheetSpot& spot) {
    int nearest = 0;
    spot.barycentric.maxCoeff(&nearest);
    return topology_->triangles()[spot.triangle][static_cast<std::size_t>(nearest)];
  };
  const auto& around = vertices_around(corner(a));
  return std::binary_search(around.begin(), around.end(), corner(b));
}

void SurfaceDistance::approach(std::uint32_t triangle) {
  approached_ = triangle;
  if (!centre_m_.empty()) return;
  for (const std::uint32_t t : triangles_around(triangle)) marks_[t] = triangle;
}

bool SurfaceDistance::wholly_neighbours(std::uint32_t other) const {
  if (centre_m_.empty()) return marks_[other] == approached_;
  const double within_m = std::max(exclusion_m_[approached_], exclusion_m_[other]);
  const double least_m = within_m - extent_m_[approached_] - extent_m_[other];
  return least_m > 0 && (centre_m_[approached_] - centre_m_[other]).squaredNorm() < least_m * least_m;
}

const std::vector<std::uint32_t>& SurfaceDistance::vertices_around(std::uint32_t vertex) {
  std::vector<std::uint32_t>& around = vertices_around_[vertex];
  if (!around.empty()) return around;
  constexpr double kDetour = 1.15;  // a way along edges is longer than the straight one
  using Reached = std::pair<double, std::uint32_t>;
  std::priority_queue<Reached, std::vector<Reached>, std::greater<>> open;
  open.push({0.0, vertex});
  while (!open.empty()) {
    const auto [distance_m, v] = open.top();
    open.pop();
    const auto place = std::lower_bound(around.begin(), around.end(), v);
    if (place != around.end() && *place == v) continue;
    around.insert(place, v);
    for (std::uint32_t k = link_start_[v]; k < link_start_[v + 1]; ++k) {
      const double next_m = distance_m + links_[k].length_m;
      if (next_m <= kDetour * vertex_exclusion_m_[vertex]) open.push({next_m, links_[k].vertex});
    }
  }
  return around;
}

const std::vector<std::uint32_t>& SurfaceDistance::triangles_around(std::uint32_t triangle) {
  std::vector<std::uint32_t>& around = triangles_around_[triangle];
  if (!around.empty()) return around;
  const Triangle& corners = topology_->triangles()[triangle];
  std::vector<std::uint32_t> shared = vertices_around(corners[0]);
  for (const std::uint32_t c : {corners[1], corners[2]}) {
    const auto& other = vertices_around(c);
    std::vector<std::uint32_t> both;
    std::set_intersection(shared.begin(), shared.end(), other.begin(), other.end(), std::back_inserter(both));
    shared = std::move(both);
  }
  for (const std::uint32_t v : shared) {
    for (std::uint32_t k = triangle_start_[v]; k < triangle_start_[v + 1]; ++k) {
      const std::uint32_t t = triangles_of_vertex_[k];
      const Triangle& w = topology_->triangles()[t];
      const bool first = v == std::min({w[0], w[1], w[2]});
      if (first && std::all_of(w.begin(), w.end(),
                               [&](std::uint32_t c) { return std::binary_search(shared.begin(), shared.end(), c); })) {
        around.push_back(t);
      }
    }
  }
  if (around.empty()) around.push_back(triangle);
  return around;
}

SheetContact::SheetContact(const sheet::Topology& topology, std::vector<Vec3f> positions_m,
                           const VertexVelocities& velocities, double radius_m, SurfaceDistance* same_sheet)
    : topology_(topology), positions_m_(std::move(positions_m)), velocities_(velocities), same_sheet_(same_sheet) {
  double extent_m = 0;
  for (const Triangle& triangle : topology_.triangles()) {
    extent_m += scene::triangle_box(triangle, positions_m_).sizes().maxCoeff();
  }
  const double mean_m = topology_.triangle_count() > 0 ? extent_m / static_cast<double>(topology_.triangle_count()) : 0.0;
  grid_.build(topology_.triangles(), positions_m_, std::max(mean_m, 2 * radius_m));
}

SheetContact::Candidate SheetContact::candidate(std::uint32_t triangle) const {
  const Triangle& v = topology_.triangles()[triangle];
  Candidate made;
  made.triangle = triangle;
  for (std::size_t k = 0; k < 3; ++k) made.corners_m[k] = positions_m_[v[k]].cast<double>();
  return made;
}

void SheetContact::complete(Candidate& candidate) {
  const auto& p = candidate.corners_m;
  candidate.normal = (p[1] - p[0]).cross(p[2] - p[0]).normalized();
  candidate.centre_m = (p[0] + p[1] + p[2]) / 3;
  for (const Vec3d& corner : p) candidate.extent_m = std::max(candidate.extent_m, (corner - candidate.centre_m).norm());
}

bool SheetContact::approach(const SheetTriangle& triangle, double radius_m) {
  candidates_.clear();
  if (same_sheet_) same_sheet_->approach(triangle.index);
  const Box box_m = box_around(triangle, radius_m);
  grid_.visit_box(box_m, [&](std::uint32_t other) {
    ++visited_;
    if (same_sheet_ && same_sheet_->wholly_neighbours(other)) return true;
    Candidate close = candidate(other);
    if (!box_m.intersects(box_around({other, close.corners_m}, 0))) return true;
    if (apart_by_plane(triangle.corners_m, close.corners_m, radius_m)) return true;
    if (apart_by_plane(close.corners_m, triangle.corners_m, radius_m)) return true;
    complete(close);
    candidates_.push_back(close);
    return true;
  });
  return !candidates_.empty();
}

Touch SheetContact::touch_at(const Vec3d& point_m, const Candidate& close, const scene::TrianglePoint& on) const {
  Touch touch;
  touch.distance_m = (point_m - on.position_m).norm();
  touch.triangle = close.triangle;
  touch.normal = close.normal;
  touch.side_normal = touch.normal.dot(point_m - on.position_m) < 0 ? Vec3d(-touch.normal) : touch.normal;
  const Triangle& v = topology_.triangles()[close.triangle];
  for (std::size_t k = 0; k < 3 && !velocities_.velocities_m_per_s.empty(); ++k) {
    touch.velocity_known = touch.velocity_known && velocities_.known(v[k]);
    touch.velocity_m_per_s += on.barycentric[static_cast<int>(k)] * velocities_.velocities_m_per_s[v[k]];
  }
  return touch;
}

std::optional<Touch> SheetContact::touch(const Vec3d& point_m, const SheetSpot& spot, double radius_m) {
  double best2 = radius_m * radius_m;
  const Candidate* best = nullptr;
  scene::TrianglePoint best_point{};
  double best_m = radius_m;
  for (const Candidate& close : candidates_) {
    const Vec3d offset = point_m - close.centre_m;
    if (std::abs(close.normal.dot(offset)) > best_m) continue;
    const double farthest_m = best_m + close.extent_m;
    if (offset.squaredNorm() > farthest_m * farthest_m) continue;
    const scene::TrianglePoint on =
        scene::closest_on_triangle(point_m, close.corners_m[0], close.corners_m[1], close.corners_m[2]);
    const double distance2 = (point_m - on.position_m).squaredNorm();
    if (distance2 > best2 || (distance2 == best2 && best && close.triangle >= best->triangle)) continue;
    if (same_sheet_ && same_sheet_->neighbours(spot, {close.triangle, on.barycentric})) continue;
    best2 = distance2;
    best_m = std::sqrt(distance2);
    best = &close;
    best_point = on;
  }
  if (!best) return std::nullopt;
  return touch_at(point_m, *best, best_point);
}

std::optional<Touch> SheetContact::closest(const Vec3d& point_m, double radius_m) const {
  double best2 = radius_m * radius_m;
  std::optional<Candidate> best;
  scene::TrianglePoint best_point{};
  const Vec3d reach = Vec3d::Constant(radius_m);
  grid_.visit_box(Box(Vec3d(point_m - reach), Vec3d(point_m + reach)), [&](std::uint32_t other) {
    Candidate close = candidate(other);
    const scene::TrianglePoint on =
        scene::closest_on_triangle(point_m, close.corners_m[0], close.corners_m[1], close.corners_m[2]);
    const double distance2 = (point_m - on.position_m).squaredNorm();
    if (distance2 > best2 || (distance2 == best2 && best && other >= best->triangle)) return true;
    best2 = distance2;
    complete(close);
    best = close;
    best_point = on;
    return true;
  });
  if (!best) return std::nullopt;
  return touch_at(point_m, *best, best_point);
}

bool surely_unfolded(const ContactGeometry& geometry) {
  constexpr double kLeastCosine = 0.1;
  Vec3d sum = Vec3d::Zero();
  for (const Vec3f& c : geometry.cross_products_m2) sum += c.cast<double>();
  if (!(sum.norm() > 0)) return false;
  const Vec3d axis = sum.normalized();
  for (const Vec3f& c : geometry.cross_products_m2) {
    const double along = axis.dot(c.cast<double>());
    const double least2 = kLeastCosine * kLeastCosine * static_cast<double>(c.squaredNorm());
    if (along <= 0 ? c.squaredNorm() > 0 : along * along < least2) return false;
  }

  const Vec3d across = axis.unitOrthogonal();
  const Vec3d other = axis.cross(across);
  struct Side {
    Vec2d start, end;
    std::uint32_t first, last;
    double low, high;
  };
  std::vector<Side> sides;
  const auto& positions_m = geometry.frame->positions_m;
  for (const auto& edge : geometry.frame->topology->border_edges()) {
    const Vec3d a = positions_m[edge.start].cast<double>() - geometry.bounds_m.min();
    const Vec3d b = positions_m[edge.end].cast<double>() - geometry.bounds_m.min();
    const Vec2d start(across.dot(a), other.dot(a));
    const Vec2d end(across.dot(b), other.dot(b));
    sides.push_back({start, end, edge.start, edge.end, std::min(start.x(), end.x()), std::max(start.x(), end.x())});
  }
  std::vector<std::pair<double, std::uint32_t>> order;
  for (std::uint32_t i = 0; i < sides.size(); ++i) order.emplace_back(sides[i].low, i);
  std::sort(order.begin(), order.end());
  for (std::size_t i = 0; i < order.size(); ++i) {
    const Side& a = sides[order[i].second];
    for (std::size_t j = i + 1; j < order.size() && order[j].first <= a.high; ++j) {
      const Side& b = sides[order[j].second];
      if (std::max(a.start.y(), a.end.y()) < std::min(b.start.y(), b.end.y())) continue;
      if (std::max(b.start.y(), b.end.y()) < std::min(a.start.y(), a.end.y())) continue;
      if (a.first == b.first || a.first == b.last || a.last == b.first || a.last == b.last) continue;
      if (cross(a.end - a.start, b.start - a.start) * cross(a.end - a.start, b.end - a.start) > 0) continue;
      if (cross(b.end - b.start, a.start - b.start) * cross(b.end - b.start, a.end - b.start) > 0) continue;
      return false;
    }
  }
  return true;
}

}  // namespace rustle::analysis
