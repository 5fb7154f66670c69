#include "server/analysis/contact_patch.h"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <numeric>
#include <utility>

#include "server/sheet/face_geometry.h"

namespace rustle::analysis {
namespace {

using scene::Box;
using sheet::kNone;
using sheet::Triangle;
using sheet::Vec3d;
using sheet::Vec3f;
using sheet::Vec4f;

constexpr int kMostSamplesAlong = 16;
constexpr double kSampleLengths = 1.5;  ///< of the radius, between samples along the sheet
constexpr double kParallel = 0.9999;
constexpr double kPlaneTolerance = 0.03;  ///< of the radius
constexpr std::size_t kAhead = 12;        ///< triangles or corners by which what they need is called for early
constexpr double kLevel = 1e-6;           ///< of the radius: a triangle with less height lies level

Vec3d tangential(const Vec3d& velocity_m_per_s, const Vec3d& normal) {
  return velocity_m_per_s - normal * normal.dot(velocity_m_per_s);
}

}  // namespace

double ContactWeight::at(double distance_m, double radius_m) const {
  if (distance_m < -penetration_m || distance_m >= radius_m) return 0;
  const double x = (distance_m / radius_m - full_share) / (1 - full_share);
  return x <= 0 ? 1.0 : 1 - x * x * (3 - 2 * x);
}

void ContactGeometry::update(const sheet::MeshFrame& mesh_frame, const Vec3f& origin, std::span<const Vec4f> relative) {
  assert(relative.size() == mesh_frame.positions_m.size());
  frame = &mesh_frame;
  origin_m = origin;
  relative_m = relative;
  bounds_m = Box();
  if (relative_m.empty()) return;
  constexpr std::size_t kAtOnce = 4;  // no choice waits for the one before
  std::array<Eigen::Array4f, kAtOnce> low, high;
  low.fill(relative_m.front()), high.fill(relative_m.front());
  for (std::size_t i = 0; i < relative_m.size(); i += kAtOnce) {
    for (std::size_t k = 0; k < kAtOnce; ++k) {
      const Eigen::Array4f p = relative_m[std::min(i + k, relative_m.size() - 1)].array();
      low[k] = low[k].min(p), high[k] = high[k].max(p);
    }
  }
  const Eigen::Array4f lowest = low[0].min(low[1]).min(low[2].min(low[3]));
  const Eigen::Array4f highest = high[0].max(high[1]).max(high[2].max(high[3]));
  const Vec3d from = origin_m.cast<double>();
  bounds_m =
      Box(Vec3d(from + lowest.matrix().head<3>().cast<double>()), Vec3d(from + highest.matrix().head<3>().cast<double>()));
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
  const ContactPlane* plane = surface.plane();
  const Inputs in{geometry, surface, velocities, weight, radius_m, plane ? 0 : surface.range_beyond_m()};
  sheet::face_areas_m2(*geometry.frame->topology, geometry.relative_m, patch_.triangles, areas_m2_);
  batch_.count = 0;
  if (plane) {
    measure_on_plane(in, *plane);
  } else {
    for (std::size_t k = 0; k < areas_m2_.size(); ++k) {
      if (areas_m2_[k] > 0) measure_triangle(in, patch_.triangles[k], areas_m2_[k]);
    }
  }
  integrate_batch(in);
  collect(in);
  return patch_;
}

void ContactMeter::measure_on_plane(const Inputs& in, const ContactPlane& plane) {
  find_corners(in);
  see_plane(in, plane);
  for (std::size_t k = 0; k < areas_m2_.size(); ++k) {
    if (!(areas_m2_[k] > 0)) continue;
    const CornerPlaces& at = triangle_corners_[k];
    const bool full = (corners_[at[0]].weight == 1) & (corners_[at[1]].weight == 1) & (corners_[at[2]].weight == 1);
    full ? lump(at, areas_m2_[k]) : integrate(in, at, areas_m2_[k]);
  }
}

/// The corners of all triangles at once.
void ContactMeter::find_corners(const Inputs& in) {
  const auto triangles = in.geometry.frame->topology->triangles();
  triangle_corners_.resize(patch_.triangles.size());
  order_.resize(std::min(3 * patch_.triangles.size(), places_.size()) + 1);  // what was met before is written behind
  std::uint32_t count = 0;
  for (std::size_t t = 0; t < patch_.triangles.size(); ++t) {
    const Triangle& v = triangles[patch_.triangles[t]];
    for (const std::uint32_t soon : triangles[patch_.triangles[std::min(t + kAhead, patch_.triangles.size() - 1)]])
      __builtin_prefetch(&places_[soon], 1);
    for (std::size_t k = 0; k < 3; ++k) {
      Place& place = places_[v[k]];
      const bool is_new = place.epoch != epoch_;
      const std::uint32_t corner = is_new ? count : place.corner;
      place = {epoch_, corner};
      triangle_corners_[t][k] = corner;
      order_[count] = v[k];
      count += is_new;
    }
  }
  corners_.assign(count, Corner());
  for (std::uint32_t c = 0; c < count; ++c) corners_[c].vertex = order_[c];
}

/// What every corner sees of a plane: p from the geometry's origin o, plane n through c that moves by w(x) = l + A (x - m),
///   d = n·(p + o - c),   slip = (I - n nᵀ)(v - w(p + o - d n))
/// w at the foot of p is an affine function of p, made in double, so that its terms are small.
void ContactMeter::see_plane(const Inputs& in, const ContactPlane& plane) {
  const Vec3d& n = plane.normal;
  const double offset_m = n.dot(in.geometry.origin_m.cast<double>() - plane.position_m);
  const Eigen::Matrix3d& turn_per_s = plane.motion.angular_map_per_s;
  const Eigen::Matrix3d across = Eigen::Matrix3d::Identity() - n * n.transpose();
  const Vec3d at_origin_m_per_s = across * plane.motion.at(in.geometry.origin_m.cast<double>() - offset_m * n);
  const Eigen::Matrix3d per_place_per_s = across * turn_per_s * across;
  const auto padded = [](const Vec3d& v) { return Vec4f(v.cast<float>().homogeneous() - Vec4f::UnitW()); };
  const Vec4f normal = padded(n), start = padded(at_origin_m_per_s), x = padded(per_place_per_s.col(0)),
              y = padded(per_place_per_s.col(1)), z = padded(per_place_per_s.col(2));
  for (std::size_t c = 0; c < corners_.size(); ++c) {
    Corner& corner = corners_[c];
    const std::uint32_t soon = corners_[std::min(c + kAhead, corners_.size() - 1)].vertex;
    __builtin_prefetch(&in.geometry.relative_m[soon]);
    in.velocities.call_for(soon);
    const Vec4f& p = in.geometry.relative_m[corner.vertex];
    corner.distance_m = normal.dot(p) + static_cast<float>(offset_m);
    const auto distance_m = static_cast<double>(corner.distance_m);
    corner.touched = distance_m < in.radius_m;
    corner.weight = static_cast<float>(in.weight.at(distance_m, in.radius_m));
    corner.slip_known = in.velocities.known(corner.vertex);
    if (!corner.slip_known) continue;
    const Vec4f velocity = padded(in.velocities.at(corner.vertex));
    corner.slip_m_per_s = velocity - normal * normal.dot(velocity) - (start + p.x() * x + p.y() * y + p.z() * z);
  }
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
  normals_.push_back({touch.normal, touch.side_normal});
  if (!made.touched) return place.corner;
  made.weight = static_cast<float>(in.weight.at(touch.distance_m, in.radius_m));
  made.distance_m = static_cast<float>(touch.distance_m);
  made.partner_triangle = touch.triangle;
  made.slip_known = touch.velocity_known && in.velocities.known(vertex);
  if (made.slip_known) {
    const Vec3d slip = tangential(in.velocities.at(vertex) - touch.velocity_m_per_s, touch.normal);
    made.slip_m_per_s.head<3>() = slip.cast<float>();
  }
  return place.corner;
}

/// Whether the partner is one plane as seen from all three corners: then the distance is linear over the triangle.
bool ContactMeter::faces_a_plane(const Inputs& in, const CornerPlaces& corners) const {
  const Corner& first = corners_[corners[0]];
  if (!first.touched || !corners_[corners[1]].touched || !corners_[corners[2]].touched) return false;
  const Normals& seen = normals_[corners[0]];
  const auto& p = in.geometry.relative_m;
  for (std::size_t k = 1; k < 3; ++k) {
    const Corner& corner = corners_[corners[k]];
    if (normals_[corners[k]].normal.dot(seen.normal) < kParallel) return false;
    const double rise = seen.side_normal.dot((p[corner.vertex] - p[first.vertex]).head<3>().cast<double>());
    const auto step = static_cast<double>(first.distance_m - corner.distance_m);
    if (std::abs(step + rise) > kPlaneTolerance * in.radius_m) return false;
  }
  return true;
}

void ContactMeter::lump(const CornerPlaces& corners, float area_m2) {
  const double third_m2 = static_cast<double>(area_m2) / 3;
  for (const std::uint32_t k : corners) corners_[k].lumped_m2 += static_cast<double>(corners_[k].weight) * third_m2;
}

void ContactMeter::measure_triangle(const Inputs& in, std::uint32_t t, float area_m2) {
  in.surface.approach(t);
  const CornerPlaces at = {corner_at(in, t, 0), corner_at(in, t, 1), corner_at(in, t, 2)};
  const Corners corners = {&corners_[at[0]], &corners_[at[1]], &corners_[at[2]]};
  const auto all = [&](auto&& holds) { return std::all_of(corners.begin(), corners.end(), holds); };
  if (all([](const Corner* corner) { return corner->weight == 1; })) return lump(at, area_m2);
  if (faces_a_plane(in, at)) return integrate(in, at, area_m2);
  if (all([](const Corner* corner) { return corner->weight > 0; })) return lump(at, area_m2);

  const auto& p = in.geometry.relative_m;
  const Vec4f &a = p[corners[0]->vertex], &b = p[corners[1]->vertex], &c = p[corners[2]->vertex];
  const double longest_m =
      std::sqrt(static_cast<double>(std::max({(b - a).squaredNorm(), (c - a).squaredNorm(), (c - b).squaredNorm()})));
  // No place of a triangle is farther from its nearest corner than its longest side over √3.
  const bool out_of_reach = all([&](const Corner* corner) {
    const double least_m = corner->touched ? static_cast<double>(corner->distance_m) : in.radius_m + in.margin_m;
    return least_m - longest_m / std::sqrt(3.0) >= in.radius_m;
  });
  const bool none_reached = all([](const Corner* corner) { return !(corner->weight > 0); });
  if (out_of_reach || (none_reached && in.surface.surely_apart(t, in.radius_m))) return;
  const double along = std::ceil(longest_m / (kSampleLengths * in.radius_m));
  if (along <= 1) return lump(at, area_m2);
  take_samples(in, t, corners, static_cast<double>(area_m2),
               static_cast<int>(std::min(along, static_cast<double>(kMostSamplesAlong))));
}

/// A triangle that lies level counts as one place, another waits for its batch.
void ContactMeter::integrate(const Inputs& in, const CornerPlaces& at, float area_m2) {
  CornerPlaces order = at;
  std::array<float, 3> d = {corners_[at[0]].distance_m, corners_[at[1]].distance_m, corners_[at[2]].distance_m};
  const auto lower_first = [&](std::size_t a, std::size_t b) {
    const bool swap = d[b] < d[a];
    const float low = swap ? d[b] : d[a], high = swap ? d[a] : d[b];
    const std::uint32_t first = swap ? order[b] : order[a], second = swap ? order[a] : order[b];
    d[a] = low, d[b] = high, order[a] = first, order[b] = second;
  };
  lower_first(0, 1);
  lower_first(1, 2);
  lower_first(0, 1);
  const auto radius_m = static_cast<float>(in.radius_m), penetration_m = static_cast<float>(in.weight.penetration_m);
  const float low = std::max(d[0], -penetration_m);
  if (low > std::min(d[2], radius_m) || low >= radius_m) return;
  const Corners corners = {&corners_[order[0]], &corners_[order[1]], &corners_[order[2]]};
  const bool known = corners[0]->slip_known && corners[1]->slip_known && corners[2]->slip_known;
  const std::uint32_t partner_triangle = corners_[at[0]].partner_triangle;
  if (d[2] - d[0] < static_cast<float>(kLevel) * radius_m) {
    const double weight = in.weight.at(static_cast<double>((d[0] + d[1] + d[2]) / 3), in.radius_m);
    if (!(weight > 0)) return;
    Shares shares(corners);
    const Vec4f slip = (corners[0]->slip_m_per_s + corners[1]->slip_m_per_s + corners[2]->slip_m_per_s) / 3;
    shares.add({1.0 / 3, 1.0 / 3, 1.0 / 3}, weight * static_cast<double>(area_m2),
               known ? Vec3d(slip.head<3>().cast<double>()) : Vec3d(Vec3d::Zero()));
    return take(corners, shares, partner_triangle);
  }
  PlaneBatch& batch = batch_;
  const std::size_t lane = batch.count++;
  batch.triangles[lane] = {order, partner_triangle};
  batch.area_m2[lane] = area_m2;
  batch.middle_m[lane] = d[1] - d[0];
  batch.rise_m[lane] = d[2] - d[0];
  batch.lowest_m[lane] = -penetration_m - d[0];
  batch.full_m[lane] = static_cast<float>(in.weight.full_share) * radius_m - d[0];
  batch.radius_m[lane] = radius_m - d[0];
  for (std::size_t k = 0; k < 3; ++k) {
    batch.reached[k][lane] = corners[k]->weight > 0 ? 1.0f : 0.0f;
    batch.slip_m_per_s[k].put(lane, known ? corners[k]->slip_m_per_s : Vec4f(Vec4f::Zero()));
  }
  if (batch.count == PlaneBatch::kLanes) integrate_batch(in);
}

void ContactMeter::integrate_batch(const Inputs& in) {
  PlaneBatch& batch = batch_;
  if (batch.count == 0) return;
  integrate_lines(batch, static_cast<float>((1 - in.weight.full_share) * in.radius_m));
  for (std::size_t i = 0; i < batch.count; ++i) {
    const PlaneBatch::Triangle& triangle = batch.triangles[i];
    beyond_corners_ = beyond_corners_ || batch.beyond[i] > 0;
    for (std::size_t k = 0; k < 3; ++k) {
      const auto area_m2 = static_cast<double>(batch.contact_m2[k][i]);
      if (!(area_m2 > 0)) continue;
      Corner& corner = corners_[triangle.corners[k]];
      corner.area_m2 += area_m2;
      corner.moved += batch.moved[k][i].cast<double>();
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
    moved[k] += part_m2 * Eigen::Vector4d(slip.x(), slip.y(), slip.z(), speed);
  }
}

void ContactMeter::take(const Corners& corners, const Shares& shares, std::uint32_t partner_triangle) {
  beyond_corners_ = beyond_corners_ || shares.beyond_corners;
  for (std::size_t k = 0; k < 3; ++k) {
    if (!(shares.area_m2[k] > 0)) continue;
    Corner& corner = *corners[k];
    corner.area_m2 += shares.area_m2[k];
    corner.moved += shares.moved[k];
    if (corner.partner_triangle == kNone) corner.partner_triangle = partner_triangle;
  }
}

void ContactMeter::collect(const Inputs& in) {
  if (beyond_corners_) {
    // A vertex out of reach has triangles around it that were not selected.
    patch_.triangles.resize(in.geometry.frame->topology->triangle_count());
    std::iota(patch_.triangles.begin(), patch_.triangles.end(), 0u);
  }
  order_.resize(corners_.size() + 1);  // what is not among them is written behind
  std::size_t count = 0;
  for (const Place& place : places_) {
    order_[count] = place.corner;
    count += place.epoch == epoch_;
  }
  for (std::size_t k = 0; k < count; ++k) {
    Corner& corner = corners_[order_[k]];
    if (corner.lumped_m2 > 0) {
      corner.area_m2 += corner.lumped_m2;
      Vec4f slip = corner.slip_m_per_s;
      slip.w() = slip.norm();
      corner.moved += corner.lumped_m2 * slip.cast<double>();
    }
    if (!(corner.area_m2 > 0)) continue;
    patch_.vertices.push_back(corner.vertex);
    patch_.areas_m2.push_back(corner.area_m2);
    // The mean direction with the mean speed: slips over a partner's two faces do not cancel.
    const Vec3d direction = corner.moved.head<3>();
    const double length = direction.norm();
    patch_.slips_m_per_s.push_back(length > 0 ? Vec3d(direction * (corner.moved.w() / (corner.area_m2 * length)))
                                              : Vec3d(Vec3d::Zero()));
    patch_.partner_triangles.push_back(corner.partner_triangle);
  }
}

}  // namespace rustle::analysis
