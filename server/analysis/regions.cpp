#include "server/analysis/regions.h"

#include <algorithm>
#include <array>
#include <cassert>
#include <cmath>
#include <map>
#include <numbers>

#include "server/sheet/disjoint_sets.h"

namespace rustle::analysis {
namespace {

using sheet::kNone;
using sheet::Vec2d;
using sheet::Vec3f;

constexpr float kSharpPull = 0.1f;  // a side across a fold ties a sliver to its neighbour this much
constexpr double kEmptyFit = 1e-9;  // of the trace: with less left after masking, nothing is known
constexpr int kRidgeLayers = 2;

struct HingeGeometry {
  std::vector<float> angle_rad, length_m, area_m2;
  std::vector<Vec3f> along;
};

HingeGeometry measure_hinges(const RegionStencils& s, std::span<const Vec3f> x, const std::vector<float>& face_areas_m2) {
  HingeGeometry out;
  const std::size_t n = s.basis.hinges.size();
  out.angle_rad.resize(n);
  sheet::dihedral_angles_rad(s.basis.hinges, x, out.angle_rad);
  out.length_m.resize(n);
  out.area_m2.resize(n);
  out.along.resize(n);
  const auto edges = s.topology->interior_edges();
  for (std::size_t k = 0; k < n; ++k) {
    const Vec3f e = x[edges[k].end] - x[edges[k].start];
    out.length_m[k] = e.norm();
    out.along[k] = out.length_m[k] > 0 ? Vec3f(e / out.length_m[k]) : Vec3f::Zero();
    out.area_m2[k] = (face_areas_m2[edges[k].left] + face_areas_m2[edges[k].right]) / 3;
  }
  return out;
}

/// Whether any hinge alone bends by a_max over the widest ridge width: otherwise there is no ridge.
bool ridges_possible(const RegionStencils& s, const HingeGeometry& h, double limit_rad) {
  double width = 0;
  for (double w : s.ridge_width_m) width = std::max(width, w);
  for (std::size_t k = 0; k < h.angle_rad.size(); ++k) {
    if (std::fabs(h.angle_rad[k]) * h.length_m[k] * width > limit_rad * h.area_m2[k]) return true;
  }
  return false;
}

/// Largest principal bending in the face's plane, summed over the ridge width.
std::vector<float> bending_over_ridge_width(const RegionStencils& s, const HingeGeometry& h,
                                            const std::vector<Vec3f>& normals) {
  std::vector<float> out(s.ridge.rows(), 0.0f);
  for (std::size_t f = 0; f < out.size(); ++f) {
    float xx = 0, yy = 0, zz = 0, xy = 0, yz = 0, xz = 0, area = 0;
    for (std::uint32_t k = s.ridge.start[f]; k < s.ridge.start[f + 1]; ++k) {
      const std::uint32_t e = s.ridge.source[k];
      const float w = s.ridge.weight[k] * h.angle_rad[e] * h.length_m[e];
      const Vec3f& u = h.along[e];
      xx += w * u.x() * u.x(), yy += w * u.y() * u.y(), zz += w * u.z() * u.z();
      xy += w * u.x() * u.y(), yz += w * u.y() * u.z(), xz += w * u.x() * u.z();
      area += s.ridge.weight[k] * h.area_m2[e];
    }
    if (!(area > 0)) continue;
    Eigen::Matrix3f tensor;
    tensor << xx, xy, xz, xy, yy, yz, xz, yz, zz;
    const Vec3f across = tensor * normals[f];
    const float normal_part = normals[f].dot(across);
    const float trace = tensor.trace() - normal_part;
    const float squares = tensor.squaredNorm() - 2 * across.squaredNorm() + normal_part * normal_part;
    const float half = std::sqrt(std::max(squares / 2 - trace * trace / 4, 0.0f));
    out[f] = (std::fabs(trace) / 2 + half) / area * static_cast<float>(s.ridge_width_m[f]);
  }
  return out;
}

/// Adds to a set of faces, once, the neighbours beyond an edge whose bending exceeds a limit.
std::vector<std::uint8_t> grown(const sheet::Topology& topology, const std::vector<std::uint8_t>& faces,
                                const std::vector<float>& bend_rad, double limit_rad) {
  std::vector<std::uint8_t> out = faces;
  for (const auto& e : topology.interior_edges()) {
    if (faces[e.right] && bend_rad[e.left] > limit_rad) out[e.left] = kRidge;
    if (faces[e.left] && bend_rad[e.right] > limit_rad) out[e.right] = kRidge;
  }
  return out;
}

/// The fitted tensor's principal values and rulings; hinges inside a fold are left out, so it does not curve the flats
/// beside it.
void fit_bending(const RegionStencils& s, const HingeGeometry& h, const std::vector<std::uint8_t>& skirt, RegionMap& map) {
  const std::size_t hinges = h.angle_rad.size(), faces = s.tensor.rows();
  std::vector<std::array<float, 4>> moment(hinges);
  std::vector<Eigen::Matrix3d> removed;
  std::vector<bool> changed;
  const auto edges = s.topology->interior_edges();
  for (std::size_t k = 0; k < hinges; ++k) {
    if (skirt[edges[k].left] || skirt[edges[k].right]) {
      moment[k] = {};
      if (changed.empty()) removed.assign(faces, Eigen::Matrix3d::Zero()), changed.assign(faces, false);
      const Eigen::Matrix3d own = s.basis.weight_m2[k] * s.basis.response[k] * s.basis.response[k].transpose();
      for (std::uint32_t u = s.tensor_user_start[k]; u < s.tensor_user_start[k + 1]; ++u) {
        removed[s.tensor_user[u]] += static_cast<double>(s.tensor_user_weight[u]) * own;
        changed[s.tensor_user[u]] = true;
      }
      continue;
    }
    const Eigen::Vector3d m =
        s.basis.weight_m2[k] / s.basis.crossing_m[k] * static_cast<double>(h.angle_rad[k]) * s.basis.response[k];
    moment[k] = {static_cast<float>(m[0]), static_cast<float>(m[1]), static_cast<float>(m[2]), 0.0f};
  }
  map.curvature_per_m.resize(faces);
  map.least_curvature_per_m.resize(faces);
  map.ruling_rad.resize(faces);
  for (std::size_t f = 0; f < faces; ++f) {
    Eigen::Array4f sum = Eigen::Array4f::Zero();
    for (std::uint32_t k = s.tensor.start[f]; k < s.tensor.start[f + 1]; ++k) {
      sum += s.tensor.weight[k] * Eigen::Map<const Eigen::Array4f>(moment[s.tensor.source[k]].data());
    }
    Eigen::Vector3f m = Eigen::Vector3f::Zero();
    if (changed.empty() || !changed[f]) {
      m = s.inverse[f] * sum.matrix().head<3>();
    } else {
      const Eigen::Matrix3d left = s.normal_matrix[f] - removed[f];
      if (left.trace() > kEmptyFit * s.normal_matrix[f].trace()) {
        m = (inverted_normal_matrix(left) * sum.matrix().head<3>().cast<double>()).cast<float>();
      }
    }
    const float mean = (m[0] + m[2]) / 2, d = (m[0] - m[2]) / 2, half = std::sqrt(d * d + m[1] * m[1]),
                sign = mean >= 0 ? 1.0f : -1.0f;
    map.curvature_per_m[f] = mean + sign * half;
    map.least_curvature_per_m[f] = mean - sign * half;
    map.ruling_rad[f] = 0.5f * std::atan2(m[1] * sign, d * sign) + std::numbers::pi_v<float> / 2;
  }
}

/// A rest-plane direction as a unit direction in space.
Vec3f to_space(const RegionStencils& s, std::span<const Vec3f> x, std::size_t f, float angle) {
  const sheet::Triangle& v = s.topology->triangles()[f];
  const auto& r = s.plane.coordinates_m;
  const Vec2d a = r[v[1]] - r[v[0]], b = r[v[2]] - r[v[0]], d(std::cos(angle), std::sin(angle));
  const double det = a.x() * b.y() - a.y() * b.x();
  if (std::fabs(det) < 1e-16) return Vec3f::UnitX();
  const auto along_a = static_cast<float>((d.x() * b.y() - d.y() * b.x()) / det);
  const auto along_b = static_cast<float>((a.x() * d.y() - a.y() * d.x()) / det);
  const Vec3f out = along_a * (x[v[1]] - x[v[0]]) + along_b * (x[v[2]] - x[v[0]]);
  const float length = out.norm();
  return length > 0 ? Vec3f(out / length) : Vec3f::UnitX();
}

/// Largest bending of each sign within the kernel's reach. The kernel blurs borders: what a face near one shows is less than
/// what the region has.
struct NearbyLevel {
  std::vector<float> up, down;
};
NearbyLevel nearby_level(const RegionStencils& s, const RegionMap& map) {
  NearbyLevel out{std::vector<float>(s.near.rows(), 0.0f), std::vector<float>(s.near.rows(), 0.0f)};
  for (std::size_t f = 0; f < s.near.rows(); ++f) {
    for (std::uint32_t k = s.near.start[f]; k < s.near.start[f + 1]; ++k) {
      const std::uint32_t g = s.near.source[k];
      if (map.ridge[g]) continue;
      out.up[f] = std::max(out.up[f], map.curvature_per_m[g]);
      out.down[f] = std::max(out.down[f], -map.curvature_per_m[g]);
    }
  }
  return out;
}

/// Renumbers labels from 0 in their order; returns how many there are.
std::uint32_t compact(std::vector<std::uint32_t>& label) {
  if (label.empty()) return 0;
  std::vector<std::uint32_t> number(std::size_t{*std::max_element(label.begin(), label.end())} + 1, 0);
  for (std::uint32_t l : label) number[l] = 1;
  std::uint32_t next = 0;
  for (std::uint32_t& n : number) n = n != 0 ? next++ : 0;
  for (std::uint32_t& l : label) l = number[l];
  return next;
}

std::vector<std::uint32_t> labels_of(sheet::DisjointSets& sets, std::size_t count) {
  std::vector<std::uint32_t> label(count);
  for (std::uint32_t i = 0; i < count; ++i) label[i] = sets.find(i);
  return label;
}

/// Ridge faces join a side, lowest bending first, so a ridge becomes a line; one lower than all its neighbours starts a
/// facet of its own: a crumpled sheet is facets between ridges, not one region.
void flood_ridges(const sheet::Topology& topology, const RegionMap& map, std::vector<std::uint32_t>& label) {
  std::vector<std::uint32_t> ridges;
  auto next = static_cast<std::uint32_t>(label.size());
  for (std::uint32_t f = 0; f < label.size(); ++f) {
    if (map.ridge[f]) label[f] = kNone, ridges.push_back(f);
  }
  std::stable_sort(ridges.begin(), ridges.end(),
                   [&](std::uint32_t a, std::uint32_t b) { return map.bend_rad[a] < map.bend_rad[b]; });
  for (std::uint32_t f : ridges) {
    std::uint32_t best = kNone;
    for (std::uint32_t k : topology.triangle_edges()[f]) {
      if (k == kNone) continue;
      const auto& e = topology.interior_edges()[k];
      const std::uint32_t g = e.left == f ? e.right : e.left;
      if (label[g] != kNone && (best == kNone || map.bend_rad[g] < map.bend_rad[best])) best = g;
    }
    label[f] = best == kNone ? next++ : label[best];
  }
}

/// Smallest first, a region thinner than the least width joins the neighbour it is tied to most. Twice the width is asked of
/// one with smooth neighbours: a facet between ridges may be narrow.
void merge_slivers(const RegionStencils& s, std::span<const Vec3f> x, const RegionMap& map, const HingeGeometry& h,
                   const Parameters& parameters, std::vector<std::uint32_t>& label) {
  struct Border {
    double tie = 0, length = 0;
  };
  struct Region {
    double area = 0, perimeter = 0, coarse = 0, width = 0;
    std::map<std::uint32_t, Border> beside;
    bool alive = true;
  };
  std::vector<Region> regions(compact(label));
  for (std::size_t f = 0; f < label.size(); ++f) {
    regions[label[f]].area += map.areas_m2[f];
    regions[label[f]].coarse += map.areas_m2[f] * 0.5 * s.edge_length_m[f];
  }
  for (const auto& e : s.topology->border_edges()) regions[label[e.triangle]].perimeter += (x[e.end] - x[e.start]).norm();
  const auto edges = s.topology->interior_edges();
  for (std::size_t k = 0; k < edges.size(); ++k) {
    const std::uint32_t a = label[edges[k].left], b = label[edges[k].right];
    if (a == b) continue;
    const bool sharp = map.bend_rad[edges[k].left] + map.bend_rad[edges[k].right] > 2 * parameters.ridge_angle_rad;
    for (const auto& [i, j] : {std::pair{a, b}, std::pair{b, a}}) {
      regions[i].perimeter += h.length_m[k];
      regions[i].beside[j].tie += h.length_m[k] * (sharp ? kSharpPull : 1.0f);
      regions[i].beside[j].length += h.length_m[k];
    }
  }
  for (Region& r : regions) r.width = std::max(parameters.min_region_width_m, r.coarse / std::max(r.area, 1e-30));
  const auto is_sliver = [&](const Region& r) {
    if (!r.alive || r.beside.empty()) return false;
    double tie = 0, length = 0;
    for (const auto& [other, border] : r.beside) tie += border.tie, length += border.length;
    const double limit = tie > 0.5 * length ? std::max(r.width, 2 * parameters.min_region_width_m) : r.width;
    return 2 * r.area < limit * std::max(r.perimeter, 1e-30);
  };
  std::vector<bool> sliver(regions.size());
  for (std::size_t i = 0; i < regions.size(); ++i) sliver[i] = is_sliver(regions[i]);
  std::vector<std::uint32_t> to(regions.size());
  for (std::uint32_t i = 0; i < to.size(); ++i) to[i] = i;
  while (true) {
    std::uint32_t r = kNone;
    for (std::uint32_t i = 0; i < regions.size(); ++i) {
      if (sliver[i] && (r == kNone || regions[i].area < regions[r].area)) r = i;
    }
    if (r == kNone) break;
    const std::uint32_t g =
        std::max_element(regions[r].beside.begin(), regions[r].beside.end(), [](const auto& a, const auto& b) {
          return a.second.tie < b.second.tie;
        })->first;
    regions[g].area += regions[r].area;
    regions[g].perimeter += regions[r].perimeter - 2 * regions[r].beside[g].length;
    for (const auto& [j, border] : regions[r].beside) {
      regions[j].beside.erase(r);
      if (j == g) continue;
      for (const auto& [a, b] : {std::pair{g, j}, std::pair{j, g}}) {
        regions[a].beside[b].tie += border.tie;
        regions[a].beside[b].length += border.length;
      }
      sliver[j] = is_sliver(regions[j]);
    }
    regions[r].alive = false;
    regions[r].beside.clear();
    sliver[r] = false;
    sliver[g] = is_sliver(regions[g]);
    to[r] = g;
  }
  for (std::uint32_t& l : label) {
    while (to[l] != l) l = to[l];
  }
}

/// Border edges by their curvature across the border: κ across the ruling, the other along it.
void measure_border(const RegionStencils& s, std::span<const Vec3f> x, const NearbyLevel& level,
                    const Parameters& parameters, RegionMap& map) {
  const double flat = parameters.flat_bending_per_m;
  for (const auto& e : s.topology->border_edges()) {
    const std::uint32_t f = e.triangle;
    const Vec3f along = x[e.end] - x[e.start];
    const float length = along.norm();
    const float cosine = length > 0 ? along.dot(map.ruling[f]) / length : 1.0f, c = cosine * cosine;
    float bending = std::max(level.up[f], level.down[f]) * (1 - c);
    if (std::fabs(map.curvature_per_m[f]) > static_cast<float>(flat)) bending += std::fabs(map.least_curvature_per_m[f]) * c;
    map.border_curvature_per_m.push_back(bending);
    map.free_border.push_back(static_cast<float>(std::clamp((static_cast<double>(bending) / flat - 0.75) / 0.5, 0.0, 1.0)));
  }
}

struct Bending {
  RegionMap map;
  HingeGeometry hinges;
  NearbyLevel level;
};

/// Everything but the labels.
Bending find_bending(const RegionStencils& s, std::span<const Vec3f> x, const Parameters& parameters) {
  Bending out;
  sheet::FaceGeometry faces;
  sheet::face_geometry(*s.topology, x, faces);
  RegionMap& map = out.map;
  map.normals = std::move(faces.normals);
  map.areas_m2 = std::move(faces.areas_m2);
  out.hinges = measure_hinges(s, x, map.areas_m2);
  const std::size_t count = map.areas_m2.size();
  map.ridge.assign(count, 0);
  map.bend_rad.assign(count, 0.0f);
  std::vector<std::uint8_t> skirt = map.ridge;
  if (ridges_possible(s, out.hinges, parameters.ridge_angle_rad)) {
    map.bend_rad = bending_over_ridge_width(s, out.hinges, map.normals);
    for (std::size_t f = 0; f < count; ++f) map.ridge[f] = map.bend_rad[f] > parameters.ridge_angle_rad ? kRidge : 0;
    for (int layer = 0; layer < kRidgeLayers; ++layer) {
      map.ridge = grown(*s.topology, map.ridge, map.bend_rad, parameters.ridge_low_rad);
    }
    skirt = grown(*s.topology, map.ridge, map.bend_rad, parameters.ridge_skirt_rad);
  }
  fit_bending(s, out.hinges, skirt, map);
  map.ruling.resize(count);
  for (std::size_t f = 0; f < count; ++f) map.ruling[f] = to_space(s, x, f, map.ruling_rad[f]);
  out.level = nearby_level(s, map);
  measure_border(s, x, out.level, parameters, map);
  return out;
}

}  // namespace

RegionMap segment(const RegionStencils& s, std::span<const Vec3f> x, double time_s, const Parameters& parameters,
                  RegionState* state) {
  assert(x.size() == s.topology->vertex_count());
  Bending found = find_bending(s, x, parameters);
  RegionMap& map = found.map;
  const std::size_t count = map.areas_m2.size();
  const double flat = parameters.flat_bending_per_m;
  const bool known = state != nullptr && state->topology == s.topology && state->curved.size() == count &&
                     std::fabs(time_s - state->time_s) <= parameters.flat_memory_s;
  // Between flat and curved the border lies where half the curvature of the curved side is reached; between the two signs of
  // an S it lies at zero, and there is no flat strip.
  std::vector<std::int8_t> sign(count);
  std::vector<bool> curved(count);
  for (std::size_t f = 0; f < count; ++f) {
    const double k = map.curvature_per_m[f], size = std::fabs(k), up = found.level.up[f], down = found.level.down[f];
    const double threshold = !known ? flat : state->curved[f] ? parameters.flat_enter_per_m : parameters.flat_leave_per_m;
    curved[f] = size >= threshold;
    const bool inflection = up > flat && down > flat;
    const bool bent = inflection || (curved[f] && size >= 0.5 * std::max(up, down));
    sign[f] = !bent ? 0 : k > 0 ? 1 : k < 0 ? -1 : 0;
  }
  sheet::DisjointSets sets(count);
  for (const auto& e : s.topology->interior_edges()) {
    if (map.ridge[e.left] || map.ridge[e.right] || sign[e.left] != sign[e.right]) continue;
    if (sign[e.left] != 0) {
      double turn = std::fmod(static_cast<double>(map.ruling_rad[e.left]) - map.ruling_rad[e.right] + 2.5 * std::numbers::pi,
                              std::numbers::pi);
      turn = std::fabs(turn - std::numbers::pi / 2);
      const double distance = (s.centres.at_m[e.left] - s.centres.at_m[e.right]).norm();
      if (turn > parameters.ruling_agree_rad * std::max(1.0, distance / parameters.ruling_agree_m)) continue;
    }
    sets.join(e.left, e.right);
  }
  map.region = labels_of(sets, count);
  flood_ridges(*s.topology, map, map.region);
  merge_slivers(s, x, map, found.hinges, parameters, map.region);
  map.region_count = compact(map.region);
  std::vector<double> area(map.region_count, 0.0), curved_area(map.region_count, 0.0);
  for (std::size_t f = 0; f < count; ++f) {
    area[map.region[f]] += map.areas_m2[f];
    if (curved[f]) curved_area[map.region[f]] += map.areas_m2[f];
  }
  for (std::size_t r = 0; r < map.region_count; ++r) map.region_curved.push_back(curved_area[r] > 0.5 * area[r]);
  if (state != nullptr) *state = {s.topology, time_s, std::move(curved)};
  return std::move(map);
}

RegionMap adopt_partition(const sheet::SentPartition& partition, const RegionStencils& s, std::span<const Vec3f> x,
                          const Parameters& parameters) {
  RegionMap map = find_bending(s, x, parameters).map;
  const std::size_t count = map.areas_m2.size();
  assert(partition.triangle_regions.size() == count);
  const auto sent = [&](std::size_t f) {
    const std::uint32_t r = partition.triangle_regions[f];
    return r < partition.region_curved.size() ? r : kNone;
  };
  sheet::DisjointSets loose(count);
  for (const auto& e : s.topology->interior_edges()) {
    if (sent(e.left) == kNone && sent(e.right) == kNone) loose.join(e.left, e.right);
  }
  const auto regions = static_cast<std::uint32_t>(partition.region_curved.size());
  map.region.resize(count);
  std::map<std::uint32_t, std::uint32_t> extra;
  for (std::uint32_t f = 0; f < count; ++f) {
    map.region[f] = sent(f);
    if (map.region[f] == kNone) {
      map.region[f] = extra.try_emplace(loose.find(f), regions + static_cast<std::uint32_t>(extra.size())).first->second;
    }
  }
  map.region_count = regions + static_cast<std::uint32_t>(extra.size());
  map.region_curved = partition.region_curved;
  map.region_curved.resize(map.region_count, false);
  return map;
}

}  // namespace rustle::analysis
