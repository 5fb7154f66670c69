#include "server/analysis/contact_patch.h"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <numeric>
#include <utility>

#include "server/sheet/simd.h"

namespace rustle::analysis {
namespace {

using scene::Box;
using sheet::kNone;
using sheet::Triangle;
using sheet::Vec3d;
using sheet::Vec3f;

constexpr int kMostSamplesAlong = 16;
constexpr double kSampleLengths = 1.5;  ///< of the radius, between samples along the sheet
constexpr double kParallel = 0.9999;
constexpr double kPlaneTolerance = 0.03;  ///< of the radius
constexpr double kLevel = 1e-6;           ///< of the radius: a triangle with less height lies level

struct GaussPoint {
  float place, share;  ///< on [0, 1]
};
constexpr std::array<GaussPoint, 3> kQuintic = {
    {{0.11270166537925831f, 5.0f / 18}, {0.5f, 8.0f / 18}, {0.88729833462074169f, 5.0f / 18}}};

Vec3d tangential(const Vec3d& velocity_m_per_s, const Vec3d& normal) {
  return velocity_m_per_s - normal * normal.dot(velocity_m_per_s);
}

/// What integrate_lines() works with, by lane: one over differences of distance, and the kinks of the weight, distances from
/// that of the lowest corner.
struct Heights {
  PlaneBatch::Lanes per_rise, per_below, per_above, kinks[4];
};

RUSTLE_SIMD void prepare(PlaneBatch& b, Heights& h) {
  for (std::size_t i = 0; i < PlaneBatch::kLanes; ++i) {
    const float d1 = b.middle_m[i], d2 = b.rise_m[i], above = d2 - d1;
    h.per_rise[i] = 1 / d2;
    h.per_below[i] = d1 > 0 ? 1 / d1 : 0.0f;
    h.per_above[i] = above > 0 ? 1 / above : 0.0f;
    const float low = b.lowest_m[i] > 0 ? b.lowest_m[i] : 0.0f, high = d2 < b.radius_m[i] ? d2 : b.radius_m[i];
    const float middle = d1 < low ? low : d1 > high ? high : d1;
    const float full = b.full_m[i] < low ? low : b.full_m[i] > high ? high : b.full_m[i];
    h.kinks[0][i] = low;
    h.kinks[1][i] = middle < full ? middle : full;
    h.kinks[2][i] = middle < full ? full : middle;
    h.kinks[3][i] = high;
    b.beyond[i] = 0;
  }
}

/// Adds what lies about one of the points of an interval between kinks. The line at one distance runs from the side between
/// lowest and highest corner to one of the others.
RUSTLE_SIMD void add_lines(PlaneBatch& b, const Heights& h, std::size_t interval, float place, float share, float per_fade) {
  for (std::size_t i = 0; i < PlaneBatch::kLanes; ++i) {
    const float start = h.kinks[interval][i], height = h.kinks[interval + 1][i] - start, level = start + place * height;
    const bool below = level < b.middle_m[i];
    const float q = level * h.per_rise[i];
    const float p = below ? level * h.per_below[i] : (b.rise_m[i] - level) * h.per_above[i];
    const float b0 = 0.5f * (below ? 2 - q - p : 1 - q), b1 = 0.5f * p, b2 = 0.5f * (below ? q : 1 + q - p);
    const float x = (level - b.full_m[i]) * per_fade, faded = 1 - x * x * (3 - 2 * x);
    const float contact = 2 * b.area_m2[i] * p * h.per_rise[i] * share * height * (x <= 0 ? 1.0f : faded);
    float part0 = b.reached[0][i] * b0, part1 = b.reached[1][i] * b1, part2 = b.reached[2][i] * b2;
    // Without a corner within reach, to the nearest corner.
    const float reached = part0 + part1 + part2, alone = reached > 0 ? 0.0f : 1.0f;
    const float largest12 = b1 > b2 ? b1 : b2, first = b0 >= largest12 ? alone : 0.0f,
                second = b1 >= b2 ? alone - first : 0.0f;
    part0 += first, part1 += second, part2 += alone - first - second;
    b.beyond[i] += alone * contact;
    const float per_share = contact / (reached > 0 ? reached : 1.0f);
    part0 *= per_share, part1 *= per_share, part2 *= per_share;
    const float sx = b0 * b.slip_m_per_s[0][0][i] + b1 * b.slip_m_per_s[1][0][i] + b2 * b.slip_m_per_s[2][0][i],
                sy = b0 * b.slip_m_per_s[0][1][i] + b1 * b.slip_m_per_s[1][1][i] + b2 * b.slip_m_per_s[2][1][i],
                sz = b0 * b.slip_m_per_s[0][2][i] + b1 * b.slip_m_per_s[1][2][i] + b2 * b.slip_m_per_s[2][2][i];
    const float speed = std::sqrt(sx * sx + sy * sy + sz * sz);
    b.contact_m2[0][i] += part0, b.contact_m2[1][i] += part1, b.contact_m2[2][i] += part2;
    b.speed_area[0][i] += part0 * speed, b.speed_area[1][i] += part1 * speed, b.speed_area[2][i] += part2 * speed;
    b.slip_area[0][0][i] += part0 * sx, b.slip_area[0][1][i] += part0 * sy, b.slip_area[0][2][i] += part0 * sz;
    b.slip_area[1][0][i] += part1 * sx, b.slip_area[1][1][i] += part1 * sy, b.slip_area[1][2][i] += part1 * sz;
    b.slip_area[2][0][i] += part2 * sx, b.slip_area[2][1][i] += part2 * sy, b.slip_area[2][2][i] += part2 * sz;
  }
}

void integrate_lines(PlaneBatch& batch, float fade_m) {
  Heights heights;
  prepare(batch, heights);
  const auto clear = [](PlaneBatch::Lanes& lanes) { std::fill_n(lanes, PlaneBatch::kLanes, 0.0f); };
  for (std::size_t k = 0; k < 3; ++k) {
    clear(batch.contact_m2[k]);
    clear(batch.speed_area[k]);
    for (auto& lanes : batch.slip_area[k]) clear(lanes);
  }
  for (std::size_t interval = 0; interval < 3; ++interval) {
    for (const auto& [place, share] : kQuintic) {
      add_lines(batch, heights, interval, place, share, 1 / fade_m);
    }
  }
}

}  // namespace

double ContactWeight::at(double distance_m, double radius_m) const {
  if (distance_m < -penetration_m || distance_m >= radius_m) return 0;
  const double x = (distance_m / radius_m - full_share) / (1 - full_share);
  return x <= 0 ? 1.0 : 1 - x * x * (3 - 2 * x);
}

void make_relative(std::span<const Vec3f> positions_m, const Vec3f& origin_m, std::vector<Eigen::Vector4f>& out_m) {
  out_m.resize(positions_m.size());
  for (std::size_t i = 0; i < positions_m.size(); ++i) {
    const Vec3f& p = positions_m[i];
    out_m[i] = Eigen::Vector4f(p.x() - origin_m.x(), p.y() - origin_m.y(), p.z() - origin_m.z(), 0.0f);
  }
}

void ContactGeometry::update(const sheet::MeshFrame& mesh_frame) {
  frame = &mesh_frame;
  origin_m = mesh_frame.positions_m.empty() ? Vec3f(Vec3f::Zero()) : mesh_frame.positions_m.front();
  make_relative(mesh_frame.positions_m, origin_m, relative_m);
  if (relative_m.empty()) {
    bounds_m = Box();
    return;
  }
  Eigen::Array4f low = relative_m.front();
  Eigen::Array4f high = low;
  for (const Eigen::Vector4f& p : relative_m) low = low.min(p.array()), high = high.max(p.array());
  const Vec3d origin = origin_m.cast<double>();
  bounds_m =
      Box(Vec3d(origin + low.matrix().head<3>().cast<double>()), Vec3d(origin + high.matrix().head<3>().cast<double>()));
}

float ContactGeometry::rounding_m() const {
  return bounds_m.isEmpty() ? 0.0f : 2e-6f * static_cast<float>(bounds_m.sizes().maxCoeff());
}

void ContactPatch::clear() {
  vertices.clear();
  areas_m2.clear();
  slips_m_per_s.clear();
  partner_triangles.clear();
  triangles.clear();
}

const ContactPatch& ContactMeter::measure(const ContactGeometry& geometry, ContactSurface& surface,
                                          const VertexVelocities& velocities, const ContactWeight& weight, double radius_m) {
  assert(radius_m > 0);
  patch_.clear();
  corners_.clear();
  normals_.clear();
  beyond_corners_ = false;
  surface.select(geometry, radius_m, patch_.triangles);
  if (patch_.triangles.empty()) return patch_;
  if (places_.size() != geometry.relative_m.size() || ++epoch_ == 0) {
    places_.assign(geometry.relative_m.size(), Place());
    epoch_ = 1;
  }
  const Inputs in{geometry, surface, velocities, weight, radius_m, surface.range_beyond_m()};
  batch_.count = 0;
  for (const std::uint32_t t : patch_.triangles) measure_triangle(in, t);
  integrate_batch(in);
  collect(in);
  return patch_;
}

std::uint32_t ContactMeter::corner_at(const Inputs& in, std::uint32_t triangle, int k) {
  const std::uint32_t vertex = in.geometry.frame->topology->triangles()[triangle][static_cast<std::size_t>(k)];
  Place& place = places_[vertex];
  if (place.epoch == epoch_) return place.corner;
  place = {epoch_, static_cast<std::uint32_t>(corners_.size())};
  Corner& made = corners_.emplace_back();
  made.vertex = vertex;
  Touch touch;
  made.touched = in.surface.touch(in.geometry.frame->positions_m[vertex].cast<double>(), {triangle, Vec3d::Unit(k)},
                                  in.radius_m + in.margin_m, touch);
  if (!in.surface.is_plane()) normals_.push_back({touch.normal, touch.side_normal});
  if (!made.touched) return place.corner;
  made.weight = in.weight.at(touch.distance_m, in.radius_m);
  made.distance_m = touch.distance_m;
  made.partner_triangle = touch.triangle;
  made.slip_known = touch.velocity_known && in.velocities.known(vertex);
  if (made.slip_known) made.slip_m_per_s = tangential(in.velocities.at(vertex) - touch.velocity_m_per_s, touch.normal);
  return place.corner;
}

/// Whether the partner is one plane as seen from all three corners: then the distance is linear over the triangle.
bool ContactMeter::faces_a_plane(const Inputs& in, const std::array<std::uint32_t, 3>& corners) const {
  if (in.surface.is_plane()) return true;
  const Corner& first = corners_[corners[0]];
  if (!first.touched || !corners_[corners[1]].touched || !corners_[corners[2]].touched) return false;
  const Normals& seen = normals_[corners[0]];
  const auto& p = in.geometry.relative_m;
  for (std::size_t k = 1; k < 3; ++k) {
    const Corner& corner = corners_[corners[k]];
    if (normals_[corners[k]].normal.dot(seen.normal) < kParallel) return false;
    const double rise = seen.side_normal.dot((p[corner.vertex] - p[first.vertex]).head<3>().cast<double>());
    if (std::abs(first.distance_m + rise - corner.distance_m) > kPlaneTolerance * in.radius_m) return false;
  }
  return true;
}

void ContactMeter::measure_triangle(const Inputs& in, std::uint32_t t) {
  const Triangle& v = in.geometry.frame->topology->triangles()[t];
  const auto& p = in.geometry.relative_m;
  const Eigen::Vector4f side_b = p[v[1]] - p[v[0]];
  const Eigen::Vector4f side_c = p[v[2]] - p[v[0]];
  const double area_m2 = 0.5 * static_cast<double>(side_b.cross3(side_c).norm());
  if (!(area_m2 > 0)) return;
  in.surface.approach(t);
  const std::array<std::uint32_t, 3> at = {corner_at(in, t, 0), corner_at(in, t, 1), corner_at(in, t, 2)};
  const Corners corners = {&corners_[at[0]], &corners_[at[1]], &corners_[at[2]]};
  int reached = 0;
  int full = 0;
  for (Corner* corner : corners) {
    reached += corner->weight > 0;
    full += corner->weight == 1;
  }
  const auto lump = [&] {
    for (Corner* corner : corners) corner->lumped_m2 += corner->weight * area_m2 / 3;
  };
  if (full == 3) return lump();
  if (faces_a_plane(in, at)) return integrate(in, at, area_m2);
  if (reached == 3) return lump();

  const double longest_m = static_cast<double>(
      std::sqrt(std::max({side_b.squaredNorm(), side_c.squaredNorm(), (side_c - side_b).squaredNorm()})));
  // No place of a triangle is farther from its nearest corner than its longest side over √3.
  const bool out_of_reach = std::all_of(corners.begin(), corners.end(), [&](const Corner* corner) {
    const double least_m = corner->touched ? corner->distance_m : in.radius_m + in.margin_m;
    return least_m - longest_m / std::sqrt(3.0) >= in.radius_m;
  });
  if (out_of_reach || (reached == 0 && in.surface.surely_apart(t, in.radius_m))) return;
  const double along = std::ceil(longest_m / (kSampleLengths * in.radius_m));
  if (along <= 1) return lump();
  take_samples(in, t, corners, area_m2, static_cast<int>(std::min(along, static_cast<double>(kMostSamplesAlong))));
}

/// A triangle that lies level counts as one place, another waits for its batch.
void ContactMeter::integrate(const Inputs& in, const std::array<std::uint32_t, 3>& at, double area_m2) {
  std::array<std::uint32_t, 3> order = at;
  const auto lower_first = [&](std::uint32_t& a, std::uint32_t& b) {
    const bool swap = corners_[b].distance_m < corners_[a].distance_m;
    const std::uint32_t low = swap ? b : a, high = swap ? a : b;
    a = low, b = high;
  };
  lower_first(order[0], order[1]);
  lower_first(order[1], order[2]);
  lower_first(order[0], order[1]);
  const Corners corners = {&corners_[order[0]], &corners_[order[1]], &corners_[order[2]]};
  const double d0 = corners[0]->distance_m;
  const double d2 = corners[2]->distance_m;
  const double low = std::max(d0, -in.weight.penetration_m);
  if (low > std::min(d2, in.radius_m) || low >= in.radius_m) return;
  const bool known = corners[0]->slip_known && corners[1]->slip_known && corners[2]->slip_known;
  const std::uint32_t partner_triangle = corners_[at[0]].partner_triangle;
  if (d2 - d0 < kLevel * in.radius_m) {
    const double weight = in.weight.at((d0 + corners[1]->distance_m + d2) / 3, in.radius_m);
    if (!(weight > 0)) return;
    Shares shares(corners);
    shares.add({1.0 / 3, 1.0 / 3, 1.0 / 3}, weight * area_m2,
               known ? Vec3d((corners[0]->slip_m_per_s + corners[1]->slip_m_per_s + corners[2]->slip_m_per_s) / 3)
                     : Vec3d(Vec3d::Zero()));
    return take(corners, shares, partner_triangle);
  }
  PlaneBatch& batch = batch_;
  const std::size_t lane = batch.count++;
  batch.triangles[lane] = {order, partner_triangle};
  batch.area_m2[lane] = static_cast<float>(area_m2);
  batch.middle_m[lane] = static_cast<float>(corners[1]->distance_m - d0);
  batch.rise_m[lane] = static_cast<float>(d2 - d0);
  batch.lowest_m[lane] = static_cast<float>(-in.weight.penetration_m - d0);
  batch.full_m[lane] = static_cast<float>(in.weight.full_share * in.radius_m - d0);
  batch.radius_m[lane] = static_cast<float>(in.radius_m - d0);
  for (std::size_t k = 0; k < 3; ++k) {
    batch.reached[k][lane] = corners[k]->weight > 0 ? 1.0f : 0.0f;
    for (std::size_t d = 0; d < 3; ++d) {
      batch.slip_m_per_s[k][d][lane] = known ? static_cast<float>(corners[k]->slip_m_per_s[static_cast<int>(d)]) : 0.0f;
    }
  }
  if (batch.count == PlaneBatch::kLanes) integrate_batch(in);
}

void ContactMeter::integrate_batch(const Inputs& in) {
  PlaneBatch& batch = batch_;
  if (batch.count == 0) return;
  for (std::size_t i = batch.count; i < PlaneBatch::kLanes; ++i) batch.area_m2[i] = 0;
  integrate_lines(batch, static_cast<float>((1 - in.weight.full_share) * in.radius_m));
  for (std::size_t i = 0; i < batch.count; ++i) {
    const PlaneBatch::Triangle& triangle = batch.triangles[i];
    beyond_corners_ = beyond_corners_ || batch.beyond[i] > 0;
    for (std::size_t k = 0; k < 3; ++k) {
      const auto area_m2 = static_cast<double>(batch.contact_m2[k][i]);
      if (!(area_m2 > 0)) continue;
      Corner& corner = corners_[triangle.corners[k]];
      corner.area_m2 += area_m2;
      corner.speed_area += static_cast<double>(batch.speed_area[k][i]);
      corner.slip_area += Vec3f(batch.slip_area[k][0][i], batch.slip_area[k][1][i], batch.slip_area[k][2][i]).cast<double>();
      if (corner.partner_triangle == kNone) corner.partner_triangle = triangle.partner_triangle;
    }
  }
  batch.count = 0;
}

void ContactMeter::take_samples(const Inputs& in, std::uint32_t t, const Corners& corners, double area_m2, int along) {
  const auto& positions_m = in.geometry.frame->positions_m;
  std::array<Vec3d, 3> p;
  for (std::size_t k = 0; k < 3; ++k) p[k] = positions_m[corners[k]->vertex].cast<double>();
  const bool known = in.velocities.known(corners[0]->vertex) && in.velocities.known(corners[1]->vertex) &&
                     in.velocities.known(corners[2]->vertex);
  std::array<Vec3d, 3> velocity_m_per_s;
  for (std::size_t k = 0; k < 3 && known; ++k) velocity_m_per_s[k] = in.velocities.at(corners[k]->vertex);
  const double sample_area_m2 = area_m2 / (along * along);
  Shares shares(corners);
  std::uint32_t partner_triangle = kNone;
  Touch touch;
  const auto sample = [&](double b1, double b2) {
    const Vec3d b(1 - b1 - b2, b1, b2);
    if (!in.surface.touch(b[0] * p[0] + b[1] * p[1] + b[2] * p[2], {t, b}, in.radius_m, touch)) return;
    const double weight = in.weight.at(touch.distance_m, in.radius_m);
    if (weight <= 0) return;
    Vec3d slip = Vec3d::Zero();
    if (known && touch.velocity_known) {
      slip = tangential(
          b[0] * velocity_m_per_s[0] + b[1] * velocity_m_per_s[1] + b[2] * velocity_m_per_s[2] - touch.velocity_m_per_s,
          touch.normal);
    }
    shares.add({b[0], b[1], b[2]}, weight * sample_area_m2, slip);
    if (partner_triangle == kNone) partner_triangle = touch.triangle;
  };
  for (int i = 0; i < along; ++i) {
    for (int j = 0; j < along - i; ++j) {
      sample((i + 1.0 / 3) / along, (j + 1.0 / 3) / along);
      if (j < along - 1 - i) sample((i + 2.0 / 3) / along, (j + 2.0 / 3) / along);
    }
  }
  take(corners, shares, partner_triangle);
}

ContactMeter::Shares::Shares(const Corners& corners) {
  for (std::size_t k = 0; k < 3; ++k) reached[k] = corners[k]->weight > 0 ? 1.0 : 0.0;
}

void ContactMeter::Shares::add(const std::array<double, 3>& barycentric, double contact_m2, const Vec3d& slip) {
  std::array<double, 3> part = {reached[0] * barycentric[0], reached[1] * barycentric[1], reached[2] * barycentric[2]};
  double shared = part[0] + part[1] + part[2];
  if (!(shared > 0)) {
    part[static_cast<std::size_t>(std::max_element(barycentric.begin(), barycentric.end()) - barycentric.begin())] = 1;
    shared = 1;
    beyond_corners = true;
  }
  const double per_share_m2 = contact_m2 / shared;
  const double speed = slip.norm();
  for (std::size_t k = 0; k < 3; ++k) {
    const double part_m2 = per_share_m2 * part[k];
    area_m2[k] += part_m2;
    speed_area[k] += part_m2 * speed;
    slip_area[k] += part_m2 * slip;
  }
}

void ContactMeter::take(const Corners& corners, const Shares& shares, std::uint32_t partner_triangle) {
  beyond_corners_ = beyond_corners_ || shares.beyond_corners;
  for (std::size_t k = 0; k < 3; ++k) {
    if (!(shares.area_m2[k] > 0)) continue;
    Corner& corner = *corners[k];
    corner.area_m2 += shares.area_m2[k];
    corner.speed_area += shares.speed_area[k];
    corner.slip_area += shares.slip_area[k];
    if (corner.partner_triangle == kNone) corner.partner_triangle = partner_triangle;
  }
}

void ContactMeter::collect(const Inputs& in) {
  if (beyond_corners_) {
    // A vertex out of reach has triangles around it that were not selected.
    patch_.triangles.resize(in.geometry.frame->topology->triangle_count());
    std::iota(patch_.triangles.begin(), patch_.triangles.end(), 0u);
  }
  for (std::uint32_t v = 0; v < places_.size(); ++v) {
    if (places_[v].epoch != epoch_) continue;
    Corner& corner = corners_[places_[v].corner];
    if (corner.lumped_m2 > 0) {
      corner.area_m2 += corner.lumped_m2;
      corner.speed_area += corner.lumped_m2 * corner.slip_m_per_s.norm();
      corner.slip_area += corner.lumped_m2 * corner.slip_m_per_s;
    }
    if (!(corner.area_m2 > 0)) continue;
    patch_.vertices.push_back(v);
    patch_.areas_m2.push_back(corner.area_m2);
    // The mean direction with the mean speed: slips over a partner's two faces do not cancel.
    const double length = corner.slip_area.norm();
    patch_.slips_m_per_s.push_back(length > 0 ? Vec3d(corner.slip_area * (corner.speed_area / (corner.area_m2 * length)))
                                              : Vec3d(Vec3d::Zero()));
    patch_.partner_triangles.push_back(corner.partner_triangle);
  }
}

}  // namespace rustle::analysis
