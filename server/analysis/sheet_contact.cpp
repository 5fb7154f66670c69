#include "server/analysis/sheet_contact.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "server/sheet/face_geometry.h"

namespace rustle::analysis {
namespace {

using scene::Box;
using sheet::Triangle;
using sheet::Vec3d;
using sheet::Vec3f;

constexpr double kTie = 1e-6;  ///< relative: a place must be nearer by this to be preferred

/// Whether all corners of b lie on one side of a's plane, farther from it than the distance.
bool apart_by_plane(const std::array<Vec3d, 3>& a, const std::array<Vec3d, 3>& b, double distance_m) {
  const Vec3d normal = (a[1] - a[0]).cross(a[2] - a[0]);
  const double limit = distance_m * normal.norm();
  const double d0 = normal.dot(b[0] - a[0]);
  const double d1 = normal.dot(b[1] - a[0]);
  const double d2 = normal.dot(b[2] - a[0]);
  return (d0 > limit && d1 > limit && d2 > limit) || (d0 < -limit && d1 < -limit && d2 < -limit);
}

void add_velocity(const VertexVelocities& velocities, const Triangle& triangle, const Vec3d& barycentric, Touch& touch) {
  touch.velocity_known = true;
  touch.velocity_m_per_s.setZero();
  if (!velocities.any()) return;
  for (std::size_t k = 0; k < 3; ++k) {
    if (!velocities.known(triangle[k])) {
      touch.velocity_known = false;
      touch.velocity_m_per_s.setZero();
      return;
    }
    touch.velocity_m_per_s += barycentric[static_cast<int>(k)] * velocities.at(triangle[k]);
  }
}

}  // namespace

void PosedSheet::update(const std::shared_ptr<const sheet::Topology>& topology, std::span<const Vec3f> positions_m,
                        const Vec3f& origin_m) {
  if (topology_ != topology) {
    topology_ = topology;
    tree_.build(topology->triangles(), topology->rest_positions_m().empty() ? positions_m : topology->rest_positions_m());
    ++builds_;
  }
  positions_m_ = positions_m;
  sheet::relative_positions_m(positions_m, origin_m, relative_m_);
  tree_.refit(topology->triangles(), relative_m_);
}

void SheetContact::set(const PosedSheet& own, const PosedSheet& other, const VertexVelocities& velocities) {
  own_ = &own;
  other_ = &other;
  velocities_ = velocities;
  same_sheet_ = nullptr;
}

void SheetContact::set_same(const PosedSheet& own, const VertexVelocities& velocities, SurfaceDistance& along_surface) {
  set(own, own, velocities);
  same_sheet_ = &along_surface;
  if (!along_surface.by_material()) return;
  if (patches_topology_ == along_surface.topology() && patches_build_ == own.builds() &&
      patches_least_m_ == along_surface.least_m()) {
    return;
  }
  patches_topology_ = along_surface.topology();
  patches_build_ = own.builds();
  patches_least_m_ = along_surface.least_m();
  patches_ = along_surface.patches_of(own.tree());
}

void SheetContact::select(const ContactGeometry& geometry, double radius_m, std::vector<std::uint32_t>& out_triangles) {
  origin_m_ = geometry.origin_m.cast<double>();
  pairs_.clear();
  facets_.clear();
  visited_ = 0;
  if (made_.size() != other_->topology().triangle_count() || ++epoch_ == 0) {
    made_.assign(other_->topology().triangle_count(), Made());
    epoch_ = 1;
  }
  const float within_m = static_cast<float>(radius_m) + geometry.rounding_m();
  if (same_sheet_ && same_sheet_->by_material()) {
    own_->tree().visit_own_pairs(
        within_m, [&](std::uint32_t a, std::uint32_t b) { return SurfaceDistance::covers(patches_[a], patches_[b]); },
        [&](std::uint32_t a, std::uint32_t b) {
          ++visited_;
          if (!same_sheet_->wholly_neighbours(a, b)) pairs_.push_back({a, b});
        });
  } else {
    const auto never = [](std::uint32_t, std::uint32_t) { return false; };
    const auto keep = [&](std::uint32_t a, std::uint32_t b) { ++visited_, pairs_.push_back({a, b}); };
    if (same_sheet_) {
      own_->tree().visit_own_pairs(within_m, never, keep);
    } else {
      own_->tree().visit_pairs(other_->tree(), within_m, never, keep);
    }
  }
  list_candidates(own_->topology().triangle_count(), out_triangles);
}

/// From pairs to candidates by triangle.
void SheetContact::list_candidates(std::size_t triangle_count, std::vector<std::uint32_t>& out_triangles) {
  out_triangles.clear();
  start_.assign(triangle_count + 1, 0);
  if (pairs_.empty()) return;
  const bool both = same_sheet_ != nullptr;
  for (const Pair& pair : pairs_) {
    ++start_[pair.mine + 1];
    if (both) ++start_[pair.theirs + 1];
  }
  for (std::size_t t = 0; t < triangle_count; ++t) start_[t + 1] += start_[t];
  next_.assign(start_.begin(), start_.end() - 1);
  candidates_.resize(start_.back());
  for (const Pair& pair : pairs_) {
    candidates_[next_[pair.mine]++] = pair.theirs;
    if (both) candidates_[next_[pair.theirs]++] = pair.mine;
  }
  const bool sift = same_sheet_ && !same_sheet_->by_material();
  for (std::uint32_t t = 0; t < triangle_count; ++t) {
    if (sift && next_[t] > start_[t]) {
      same_sheet_->approach(t);
      const auto begin = candidates_.begin();
      const auto end = std::remove_if(begin + start_[t], begin + next_[t],
                                      [&](std::uint32_t other) { return same_sheet_->wholly_neighbours(other); });
      next_[t] = static_cast<std::uint32_t>(end - begin);
    }
    if (next_[t] > start_[t]) out_triangles.push_back(t);
  }
}

void SheetContact::approach(std::uint32_t triangle) {
  near_.clear();
  for (std::uint32_t k = start_[triangle]; k < next_[triangle]; ++k) near_.push_back(facet(candidates_[k]));
}

bool SheetContact::surely_apart(std::uint32_t triangle, double radius_m) {
  const auto corners_of = [&](const PosedSheet& sheet, std::uint32_t t) {
    const Triangle& v = sheet.topology().triangles()[t];
    std::array<Vec3d, 3> corners;
    for (std::size_t k = 0; k < 3; ++k) corners[k] = sheet.positions_m()[v[k]].cast<double>();
    return corners;
  };
  const std::array<Vec3d, 3> corners = corners_of(*own_, triangle);
  std::erase_if(near_, [&](std::uint32_t k) {
    const std::array<Vec3d, 3> other = corners_of(*other_, facets_[k].triangle);
    return apart_by_plane(corners, other, radius_m) || apart_by_plane(other, corners, radius_m);
  });
  return near_.empty();
}

std::uint32_t SheetContact::facet(std::uint32_t triangle) {
  Made& made = made_[triangle];
  if (made.epoch == epoch_) return made.facet;
  made = {epoch_, static_cast<std::uint32_t>(facets_.size())};
  Facet& out = facets_.emplace_back();
  const Triangle& v = other_->topology().triangles()[triangle];
  const auto corner = [&](std::size_t k) { return Vec3d(other_->positions_m()[v[k]].cast<double>() - origin_m_); };
  out.triangle = triangle;
  out.corner_m = corner(0);
  out.side_b_m = corner(1) - out.corner_m;
  out.side_c_m = corner(2) - out.corner_m;
  const Vec3d across = out.side_b_m.cross(out.side_c_m);
  const double area2 = across.squaredNorm();
  out.degenerate = !(area2 > 0);
  out.normal = across.normalized();
  if (out.degenerate) return made.facet;
  out.share_b = out.side_c_m.cross(across) / area2;
  out.share_c = across.cross(out.side_b_m) / area2;
  out.heights_m = {1 / (out.share_b + out.share_c).norm(), 1 / out.share_b.norm(), 1 / out.share_c.norm()};
  return made.facet;
}

scene::TrianglePoint SheetContact::closest(const Facet& facet, const Vec3d& point_m) {
  return scene::closest_on_triangle(point_m, facet.corner_m, facet.corner_m + facet.side_b_m,
                                    facet.corner_m + facet.side_c_m);
}

bool SheetContact::touch(const Vec3d& point_m, const SheetSpot& spot, double radius_m, Touch& out) {
  const Vec3d point = point_m - origin_m_;
  double best_m = radius_m;
  const Facet* best = nullptr;
  Vec3d best_share = Vec3d::Zero();
  Vec3d best_offset = Vec3d::Zero();
  // Above the inside of a triangle its plane is as near as itself. Elsewhere the height over the plane and the way past a
  // side bound the distance from below.
  beside_.clear();
  for (const std::uint32_t k : near_) {
    const Facet& close = facets_[k];
    if (close.degenerate) {
      beside_.push_back({k, 0});
      continue;
    }
    const Vec3d offset = point - close.corner_m;
    const double height = close.normal.dot(offset);
    if (std::abs(height) > best_m) continue;
    const double b = close.share_b.dot(offset);
    const double c = close.share_c.dot(offset);
    const double past_m = std::max({-b * close.heights_m[1], -c * close.heights_m[2], (b + c - 1) * close.heights_m[0]});
    if (past_m > 0) {
      if (past_m <= best_m) beside_.push_back({k, height * height + past_m * past_m});
      continue;
    }
    if (best && std::abs(height) >= best_m * (1 - kTie)) continue;
    const Vec3d share(1 - b - c, b, c);
    if (same_sheet_ && same_sheet_->neighbours(spot, {close.triangle, share})) continue;
    best = &close;
    best_m = std::abs(height);
    best_share = share;
    best_offset = height * close.normal;
  }
  for (const Beside& beside : beside_) {
    const double nearer_m = best ? best_m * (1 - kTie) : best_m;
    if (beside.least2_m2 > nearer_m * nearer_m) continue;
    const Facet& close = facets_[beside.facet];
    const scene::TrianglePoint on = closest(close, point);
    const Vec3d offset = point - on.position_m;
    const double distance_m = offset.norm();
    if (distance_m > nearer_m) continue;
    if (same_sheet_ && same_sheet_->neighbours(spot, {close.triangle, on.barycentric})) continue;
    best = &close;
    best_m = distance_m;
    best_share = on.barycentric;
    best_offset = offset;
  }
  if (!best) return false;
  out.distance_m = best_m;
  out.triangle = best->triangle;
  out.normal = best->normal;
  out.side_normal = best->normal.dot(best_offset) < 0 ? Vec3d(-best->normal) : best->normal;
  add_velocity(velocities_, other_->topology().triangles()[best->triangle], best_share, out);
  return true;
}

ClosestOnSheet::ClosestOnSheet(const sheet::Topology& topology, std::span<const Vec3f> positions_m,
                               const VertexVelocities& velocities, double radius_m)
    : topology_(topology), positions_m_(positions_m), velocities_(velocities) {
  double extent_m = 0;
  for (const Triangle& triangle : topology_.triangles()) {
    extent_m += scene::triangle_box(triangle, positions_m_).sizes().maxCoeff();
  }
  const double mean_m = topology_.triangle_count() > 0 ? extent_m / static_cast<double>(topology_.triangle_count()) : 0.0;
  grid_.build(topology_.triangles(), positions_m_, std::max(mean_m, 2 * radius_m));
}

std::optional<Touch> ClosestOnSheet::find(const Vec3d& point_m, double radius_m) const {
  double best2 = radius_m * radius_m;
  std::optional<std::uint32_t> best;
  scene::TrianglePoint best_point{};
  std::array<Vec3d, 3> p;
  const auto corners_of = [&](std::uint32_t t) {
    for (std::size_t k = 0; k < 3; ++k) p[k] = positions_m_[topology_.triangles()[t][k]].cast<double>();
  };
  const Vec3d reach = Vec3d::Constant(radius_m);
  grid_.visit_box(Box(Vec3d(point_m - reach), Vec3d(point_m + reach)), [&](std::uint32_t t) {
    corners_of(t);
    const scene::TrianglePoint on = scene::closest_on_triangle(point_m, p[0], p[1], p[2]);
    const double distance2 = (point_m - on.position_m).squaredNorm();
    if (distance2 > best2 || (distance2 == best2 && best && t >= *best)) return true;
    best2 = distance2;
    best = t;
    best_point = on;
    return true;
  });
  if (!best) return std::nullopt;
  corners_of(*best);
  Touch touch;
  const Vec3d offset = point_m - best_point.position_m;
  touch.distance_m = offset.norm();
  touch.triangle = *best;
  touch.normal = (p[1] - p[0]).cross(p[2] - p[0]).normalized();
  touch.side_normal = touch.normal.dot(offset) < 0 ? Vec3d(-touch.normal) : touch.normal;
  add_velocity(velocities_, topology_.triangles()[*best], best_point.barycentric, touch);
  return touch;
}

}  // namespace rustle::analysis
