#include "server/analysis/regions.h"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <map>
#include <numeric>

#include "server/sheet/simd.h"

namespace rustle::analysis {
namespace {

using sheet::kNone;
using sheet::Vec2d;
using sheet::Vec2f;
using sheet::Vec3f;
using sheet::Vec4f;

constexpr double kSharpPull = 0.1;  // a side across a fold ties a sliver to its neighbour this much
constexpr double kEmptyFit = 1e-9;  // of the trace: with less left after masking, nothing is known
constexpr int kRidgeLayers = 2;
constexpr float kNearLimit = 0.6f;  // of a_max: with less mean bending around a corner, no ridge is sought there
constexpr float kInside = 0.7f;     // of the level nearby: what a place well inside a bend has
constexpr std::size_t kBatch = 128;
using Lanes = float[kBatch];

/// Principal values of symmetric tensors (xx, xy, yy): the one of largest size, the other, and the doubled direction of the
/// other, which is that of the rulings.
struct Principal {
  Lanes xx, xy, yy, largest, least, cosine, sine;
};
RUSTLE_SIMD void find_principal(Principal& p) {
  for (std::size_t i = 0; i < kBatch; ++i) {
    const float mean = (p.xx[i] + p.yy[i]) / 2, d = (p.xx[i] - p.yy[i]) / 2, half = std::sqrt(d * d + p.xy[i] * p.xy[i]);
    const float signed_half = mean >= 0 ? half : -half, scale = half > 0 ? -1 / signed_half : 0.0f;
    p.largest[i] = mean + signed_half;
    p.least[i] = mean - signed_half;
    p.cosine[i] = half > 0 ? d * scale : 1.0f;
    p.sine[i] = p.xy[i] * scale;
  }
}

/// Calls take(i, principal, lane) for the tensors give(i), i < count.
template <class Give, class Take>
void each_principal(std::size_t count, Give&& give, Take&& take) {
  Principal p{};
  for (std::size_t first = 0; first < count; first += kBatch) {
    const std::size_t lanes = std::min(kBatch, count - first);
    for (std::size_t i = 0; i < lanes; ++i) {
      const Moment m = give(first + i);
      p.xx[i] = m[0], p.xy[i] = m[1], p.yy[i] = m[2];
    }
    find_principal(p);
    for (std::size_t i = 0; i < lanes; ++i) take(first + i, p, i);
  }
}

/// Adds to a set of faces, once, the neighbours beyond an edge whose bending exceeds a limit.
void grow(const sheet::Topology& topology, const std::vector<float>& bend_rad, double limit_rad,
          const std::vector<std::uint8_t>& faces, std::vector<std::uint8_t>& out) {
  const auto limit = static_cast<float>(limit_rad);
  out = faces;
  for (const auto& e : topology.interior_edges()) {
    if (faces[e.right] && bend_rad[e.left] > limit) out[e.left] = kRidge;
    if (faces[e.left] && bend_rad[e.right] > limit) out[e.right] = kRidge;
  }
}

/// M at every vertex, of all hinges.
void fit_tensor(const RegionStencils& s, RegionScratch& scratch) {
  scratch.tensor.resize(s.tensor.rows());
  for (std::size_t i = 0; i < s.tensor.rows(); ++i) {
    const Eigen::Vector3f m = s.inverse[i] * weighted_sum(s.tensor.row(i), scratch.moments).matrix().head<3>();
    scratch.tensor[i] = {m[0], m[1], m[2], 0.0f};
  }
}

/// M again where hinges inside a fold took part, without them, so that the fold does not curve the flats beside it.
void leave_out_folds(const RegionStencils& s, RegionScratch& scratch) {
  const auto edges = s.topology->interior_edges();
  scratch.removed.assign(s.nodes.normal_matrix.size(), Eigen::Matrix3d::Zero());
  scratch.changed.assign(s.nodes.normal_matrix.size(), 0);
  for (std::size_t k = 0; k < edges.size(); ++k) {
    if (!scratch.skirt[edges[k].left] && !scratch.skirt[edges[k].right]) continue;
    scratch.angles_rad[k] = 0;
    for (const std::uint32_t n : s.nodes.ends[k]) {
      scratch.removed[n] += s.nodes.hinge_normal[k];
      scratch.changed[n] = 1;
    }
  }
  gather_moments(s.nodes, scratch.angles_rad, scratch.moments);
  for (std::size_t i = 0; i < s.tensor.rows(); ++i) {
    const auto row = s.tensor.row(i);
    if (std::none_of(row.begin(), row.end(), [&](const auto& entry) { return scratch.changed[entry.source] != 0; }))
      continue;
    Eigen::Matrix3d whole = Eigen::Matrix3d::Zero(), removed = Eigen::Matrix3d::Zero();
    for (const auto& [node, weight] : row) {
      whole += static_cast<double>(weight) * s.nodes.normal_matrix[node];
      if (scratch.changed[node]) removed += static_cast<double>(weight) * scratch.removed[node];
    }
    const Eigen::Matrix3d left = whole - removed;
    Eigen::Vector3d m = Eigen::Vector3d::Zero();
    if (left.trace() > kEmptyFit * whole.trace()) {
      m = inverted_normal_matrix(left) * weighted_sum(row, scratch.moments).matrix().head<3>().cast<double>();
    }
    scratch.tensor[i] = Eigen::Array4d(m[0], m[1], m[2], 0).cast<float>();
  }
}

Moment tensor_of(const RegionStencils& s, const RegionScratch& scratch, std::size_t triangle) {
  const sheet::Triangle& v = s.topology->triangles()[triangle];
  return (scratch.tensor[v[0]] + scratch.tensor[v[1]] + scratch.tensor[v[2]]) / 3.0f;
}

/// Largest principal bending over the ridge width: that of the smooth fit, and what the hinges show beyond it. A smooth bend
/// so counts for what it is on any mesh. Calls take(triangle, bending) for the triangles of a list.
template <class Take>
void bend_over_ridge_width(const RegionStencils& s, const RegionScratch& scratch, std::span<const std::uint32_t> triangles,
                           Take&& take) {
  each_principal(
      triangles.size(),
      [&](std::size_t i) {
        const std::uint32_t f = triangles[i];
        const Moment sharp = s.ridge_scale[f] * weighted_sum(s.ridge.row(f), scratch.ridge_moments);
        return Moment(s.ridge_width_m[f] * (sharp + tensor_of(s, scratch, f)));
      },
      [&](std::size_t i, const Principal& p, std::size_t lane) { take(triangles[i], std::fabs(p.largest[lane])); });
}

void find_ridges(const RegionStencils& s, const Parameters& parameters, RegionScratch& scratch, RegionMap& map) {
  const auto count = static_cast<std::uint32_t>(map.areas_m2.size());
  const auto limit = static_cast<float>(parameters.ridge_angle_rad);
  map.ridge.assign(count, 0);
  map.bend_rad.assign(count, 0.0f);
  scratch.skirt.clear();
  // Where the mean bending |θ||e| over the hinge areas around a corner does not come near a_max, there is no ridge.
  std::vector<std::uint8_t>& bent = scratch.bent;
  bent.resize(scratch.moments.size());
  std::uint8_t anywhere = 0;
  for (std::size_t n = 0; n < bent.size(); ++n) {
    bent[n] = scratch.moments[n][3] * s.node_ridge_share[n] > kNearLimit * limit;
    anywhere |= bent[n];
  }
  if (!anywhere) return;
  scratch.ridges.clear();
  for (std::uint32_t f = 0; f < count; ++f) {
    const sheet::Triangle& v = s.topology->triangles()[f];
    const auto& node = s.nodes.of_vertex;
    if (bent[node[v[0]]] | bent[node[v[1]]] | bent[node[v[2]]]) scratch.ridges.push_back(f);
  }
  if (scratch.ridges.empty()) return;
  const auto& hinges = s.basis.hinges;
  scratch.ridge_moments.resize(hinges.size());
  for (std::size_t k = 0; k < hinges.size(); ++k) {
    const Moment smooth = s.hinge_response[k] * (scratch.tensor[hinges[k][0]] + scratch.tensor[hinges[k][1]]);
    scratch.ridge_moments[k] = (scratch.angles_rad[k] - smooth[0] - smooth[1] - smooth[2]) * s.ridge_factor[k];
  }
  bool any = false;
  bend_over_ridge_width(s, scratch, scratch.ridges, [&](std::uint32_t f, float bend_rad) {
    if (bend_rad > limit) map.ridge[f] = kRidge, any = true;
  });
  if (!any) return;
  scratch.ridges.resize(count);
  std::iota(scratch.ridges.begin(), scratch.ridges.end(), 0u);
  bend_over_ridge_width(s, scratch, scratch.ridges, [&](std::uint32_t f, float bend_rad) { map.bend_rad[f] = bend_rad; });
  for (int layer = 0; layer < kRidgeLayers; ++layer) {
    grow(*s.topology, map.bend_rad, parameters.ridge_low_rad, map.ridge, scratch.grown);
    map.ridge.swap(scratch.grown);
  }
  grow(*s.topology, map.bend_rad, parameters.ridge_skirt_rad, map.ridge, scratch.skirt);
}

/// Largest bending of each sign near every vertex. The kernel blurs borders: what a place near one shows is less than what
/// the region has. Vertices wholly inside ridges are passed over.
void prepare_levels(const RegionStencils& s, RegionScratch& scratch, const RegionMap& map) {
  const std::size_t vertices = scratch.tensor.size();
  scratch.vertex_curvature_per_m.resize(vertices);
  each_principal(
      vertices, [&](std::size_t i) { return scratch.tensor[i]; },
      [&](std::size_t i, const Principal& p, std::size_t lane) { scratch.vertex_curvature_per_m[i] = p.largest[lane]; });
  if (!scratch.skirt.empty()) {
    scratch.hidden.assign(vertices, 1);
    for (std::size_t f = 0; f < map.ridge.size(); ++f) {
      if (map.ridge[f]) continue;
      for (const std::uint32_t v : s.topology->triangles()[f]) scratch.hidden[v] = 0;
    }
    for (std::size_t i = 0; i < vertices; ++i) {
      if (scratch.hidden[i]) scratch.vertex_curvature_per_m[i] = 0;
    }
  }
  constexpr std::size_t kLanes = RegionStencils::kNearLanes;
  scratch.level_per_m.resize((vertices + kLanes - 1) / kLanes * kLanes);
  const float* curvature_per_m = scratch.vertex_curvature_per_m.data();
  for (std::size_t slice = 0; slice + 1 < s.near_start.size(); ++slice) {
    float up[kLanes] = {}, down[kLanes] = {};
    for (std::uint32_t k = s.near_start[slice]; k < s.near_start[slice + 1]; ++k) {
      for (std::size_t i = 0; i < kLanes; ++i) {
        const float here = curvature_per_m[s.near_lanes[k][i]];
        up[i] = up[i] > here ? up[i] : here;
        down[i] = down[i] > -here ? down[i] : -here;
      }
    }
    for (std::size_t i = 0; i < kLanes; ++i) scratch.level_per_m[slice * kLanes + i] = {up[i], down[i]};
  }
}

RegionScratch::Level level_of(const RegionStencils& s, const RegionScratch& scratch, std::uint32_t triangle) {
  const sheet::Triangle& v = s.topology->triangles()[triangle];
  const auto &a = scratch.level_per_m[v[0]], &b = scratch.level_per_m[v[1]], &c = scratch.level_per_m[v[2]];
  return {std::max({a.up, b.up, c.up}), std::max({a.down, b.down, c.down})};
}

/// Border edges by the curvature along them; where it has fallen off, by the largest nearby, for the kernel blurs where a
/// bend begins.
void measure_border(const RegionStencils& s, const RegionScratch& scratch, const Parameters& parameters, RegionMap& map) {
  const auto flat = static_cast<float>(parameters.flat_bending_per_m);
  const auto borders = s.topology->border_edges();
  map.border_curvature_per_m.resize(borders.size());
  map.free_border.resize(borders.size());
  for (std::size_t k = 0; k < borders.size(); ++k) {
    const float cosine = s.border_twice[k].x(), sine = s.border_twice[k].y();
    const Moment direction((1 + cosine) / 2, sine, (1 - cosine) / 2, 0);
    const auto along = [&](const Moment& tensor) { return std::fabs((direction * tensor).sum()); };
    float most = 0;
    for (const std::uint32_t end : {borders[k].start, borders[k].end}) {
      for (const auto& [j, weight] : s.near.row(end)) {
        if (scratch.skirt.empty() || !scratch.hidden[j]) most = std::max(most, along(scratch.tensor[j]));
      }
    }
    const float here = along((scratch.tensor[borders[k].start] + scratch.tensor[borders[k].end]) / 2);
    const float curvature = here >= kInside * most ? here : most;
    map.border_curvature_per_m[k] = curvature;
    map.free_border[k] = std::clamp((curvature / flat - 0.75f) / 0.5f, 0.0f, 1.0f);
  }
}

/// Everything but the labels.
void find_bending(const RegionStencils& s, const RegionFrame& frame, const Parameters& parameters, RegionScratch& scratch,
                  RegionMap& map) {
  assert(frame.positions_m.size() == s.topology->vertex_count());
  sheet::face_areas_m2(*s.topology, frame.positions_m, map.areas_m2);
  if (frame.angles_rad.empty()) {
    scratch.angles_rad.resize(s.basis.hinges.size());
    sheet::dihedral_angles_rad(s.basis.hinges, frame.positions_m, scratch.angles_rad);
  } else {
    assert(frame.angles_rad.size() == s.basis.hinges.size());
    scratch.angles_rad.assign(frame.angles_rad.begin(), frame.angles_rad.end());
  }
  if (frame.moments.empty()) {
    gather_moments(s.nodes, scratch.angles_rad, scratch.moments);
  } else {
    assert(frame.moments.size() == s.nodes.points.at_m.size());
    scratch.moments.assign(frame.moments.begin(), frame.moments.end());
  }
  fit_tensor(s, scratch);
  find_ridges(s, parameters, scratch, map);
  if (!scratch.skirt.empty()) leave_out_folds(s, scratch);
  const auto triangles = s.topology->triangles();
  map.curvature_per_m.resize(triangles.size());
  map.least_curvature_per_m.resize(triangles.size());
  map.ruling_twice.resize(triangles.size());
  each_principal(
      triangles.size(), [&](std::size_t f) { return tensor_of(s, scratch, f); },
      [&](std::size_t f, const Principal& p, std::size_t lane) {
        map.curvature_per_m[f] = p.largest[lane];
        map.least_curvature_per_m[f] = p.least[lane];
        map.ruling_twice[f] = {p.cosine[lane], p.sine[lane]};
      });
  prepare_levels(s, scratch, map);
  measure_border(s, scratch, parameters, map);
}

/// Faces of one kind, by their level: between flat and curved the border lies where half the curvature of the curved side
/// is reached; between the two signs of an S it lies at zero, and there is no flat strip.
void find_signs(const RegionStencils& s, const RegionState* state, const Parameters& parameters, const RegionMap& map,
                std::vector<std::uint8_t>& curved, RegionScratch& scratch) {
  const std::size_t count = map.curvature_per_m.size();
  const auto flat = static_cast<float>(parameters.flat_bending_per_m),
             enter = static_cast<float>(parameters.flat_enter_per_m),
             leave = static_cast<float>(parameters.flat_leave_per_m);
  scratch.sign.resize(count);
  curved.resize(count);
  const auto threshold = [&](std::size_t f) { return state == nullptr ? flat : state->curved[f] ? enter : leave; };
  for (std::uint32_t f = 0; f < count; ++f) {
    const float k = map.curvature_per_m[f], size = std::fabs(k);
    const auto [up, down] = level_of(s, scratch, f);
    const bool is_curved = size >= threshold(f), inflection = (up > flat) & (down > flat);
    const bool bent = inflection | (is_curved & (size >= 0.5f * std::max(up, down)));
    curved[f] = is_curved;
    scratch.sign[f] = static_cast<std::int8_t>(static_cast<int>(bent) * ((k > 0) - (k < 0)));
  }
}

/// Labels connected faces of one kind whose rulings agree from neighbour to neighbour. Ridge faces have none.
void label_faces(const RegionStencils& s, RegionScratch& scratch, RegionMap& map) {
  const auto count = static_cast<std::uint32_t>(map.ridge.size());
  const auto edges = s.topology->interior_edges();
  const auto agree = [&](std::uint32_t f, std::uint32_t g, std::uint32_t edge) {
    return scratch.sign[f] == scratch.sign[g] &&
           (scratch.sign[f] == 0 || !(map.ruling_twice[f].dot(map.ruling_twice[g]) < s.agree_cosine[edge]));
  };
  // Down a tree that spans the sheet, then across what it leaves out, where that joins anything.
  map.region.resize(count);
  std::uint32_t begun = 0;
  for (const auto& [f, parent, edge] : s.tree) {
    std::uint32_t label = kNone;
    if (!map.ridge[f]) {
      label = parent != kNone && map.region[parent] != kNone && agree(f, parent, edge) ? map.region[parent] : begun++;
    }
    map.region[f] = label;
  }
  scratch.sets.reset(begun);
  for (const std::uint32_t k : s.links) {
    const std::uint32_t f = edges[k].left, g = edges[k].right, a = map.region[f], b = map.region[g];
    if (a != b && a != kNone && b != kNone && agree(f, g, k)) scratch.sets.join(a, b);
  }
  // Numbered in the order of their first faces.
  scratch.numbers.assign(begun, kNone);
  for (std::uint32_t b = 0; b < begun; ++b) scratch.numbers[b] = scratch.sets.find(b);
  scratch.renumbered.assign(begun, kNone);
  map.region_count = 0;
  for (std::uint32_t& label : map.region) {
    if (label == kNone) continue;
    std::uint32_t& number = scratch.renumbered[scratch.numbers[label]];
    if (number == kNone) number = map.region_count++;
    label = number;
  }
}

/// Ridge faces join a side, lowest bending first, so a ridge becomes a line; one lower than all its neighbours starts a
/// facet of its own: a crumpled sheet is facets between ridges, not one region.
void flood_ridges(const RegionStencils& s, RegionScratch& scratch, RegionMap& map) {
  if (scratch.skirt.empty()) return;
  std::vector<std::uint32_t>& label = map.region;
  scratch.ridges.clear();
  for (std::uint32_t f = 0; f < label.size(); ++f) {
    if (map.ridge[f]) scratch.ridges.push_back(f);
  }
  std::sort(scratch.ridges.begin(), scratch.ridges.end(), [&](std::uint32_t a, std::uint32_t b) {
    return map.bend_rad[a] != map.bend_rad[b] ? map.bend_rad[a] < map.bend_rad[b] : a < b;
  });
  for (const std::uint32_t f : scratch.ridges) {
    std::uint32_t best = kNone;
    for (std::size_t k = 0; k < 3; ++k) {
      const std::uint32_t side = s.beyond[3 * f + k];
      if (side == kNone) continue;
      const std::uint32_t g = side / 3;
      if (label[g] != kNone && (best == kNone || map.bend_rad[g] < map.bend_rad[best])) best = g;
    }
    label[f] = best == kNone ? map.region_count++ : label[best];
  }
}

void find_cuts(const RegionStencils& s, RegionMap& map) {
  const auto interior = s.topology->interior_edges();
  map.cuts.resize(interior.size());
  std::size_t count = 0;
  for (std::uint32_t k = 0; k < interior.size(); ++k) {
    map.cuts[count] = k;
    count += map.region[interior[k].left] != map.region[interior[k].right];
  }
  map.cuts.resize(count);
}

RegionScratch::Beside& beside(RegionScratch::Part& part, std::uint32_t region) {
  for (auto& b : part.beside) {
    if (b.region == region) return b;
  }
  return part.beside.emplace_back(RegionScratch::Beside{region, 0, 0});
}

void part_from(RegionScratch::Part& part, std::uint32_t region) {
  std::erase_if(part.beside, [&](const auto& b) { return b.region == region; });
}

/// Smallest first, a region thinner than the least width joins the neighbour it is tied to most. Twice the width is asked of
/// one with smooth neighbours: a facet between ridges may be narrow.
void merge_slivers(const RegionStencils& s, std::span<const Vec4f> x, const Parameters& parameters, RegionScratch& scratch,
                   RegionMap& map) {
  std::vector<std::uint32_t>& label = map.region;
  const std::uint32_t count = map.region_count;
  auto& parts = scratch.parts;
  if (parts.size() < count) parts.resize(count);
  for (std::uint32_t r = 0; r < count; ++r) {
    parts[r].area_m2 = parts[r].perimeter_m = parts[r].coarse_m3 = 0;
    parts[r].alive = true;
    parts[r].beside.clear();
  }
  for (std::size_t f = 0; f < label.size(); ++f) {
    parts[label[f]].area_m2 += static_cast<double>(map.areas_m2[f]);
    parts[label[f]].coarse_m3 += static_cast<double>(map.areas_m2[f]) * 0.5 * s.edge_length_m[f];
  }
  for (const auto& e : s.topology->border_edges()) {
    parts[label[e.triangle]].perimeter_m += static_cast<double>((x[e.end] - x[e.start]).norm());
  }
  const auto interior = s.topology->interior_edges();
  find_cuts(s, map);
  for (const std::uint32_t k : map.cuts) {
    const auto& e = interior[k];
    const std::uint32_t a = label[e.left], b = label[e.right];
    const auto length = static_cast<double>((x[e.end] - x[e.start]).norm());
    const double bend = static_cast<double>(map.bend_rad[e.left]) + static_cast<double>(map.bend_rad[e.right]);
    const double tie = bend > 2 * parameters.ridge_angle_rad ? kSharpPull * length : length;
    for (const auto& [i, j] : {std::pair{a, b}, std::pair{b, a}}) {
      parts[i].perimeter_m += length;
      auto& side = beside(parts[i], j);
      side.tie_m += tie;
      side.length_m += length;
    }
  }
  const auto is_sliver = [&](const RegionScratch::Part& part) {
    if (!part.alive || part.beside.empty()) return false;
    double tie = 0, length = 0;
    for (const auto& b : part.beside) tie += b.tie_m, length += b.length_m;
    const double limit = tie > 0.5 * length ? std::max(part.width_m, 2 * parameters.min_region_width_m) : part.width_m;
    return 2 * part.area_m2 < limit * std::max(part.perimeter_m, 1e-30);
  };
  for (std::uint32_t r = 0; r < count; ++r) {
    parts[r].width_m = std::max(parameters.min_region_width_m, parts[r].coarse_m3 / std::max(parts[r].area_m2, 1e-30));
    parts[r].sliver = is_sliver(parts[r]);
  }
  scratch.numbers.resize(count);
  for (std::uint32_t r = 0; r < count; ++r) scratch.numbers[r] = r;
  while (true) {
    std::uint32_t r = kNone;
    for (std::uint32_t i = 0; i < count; ++i) {
      if (parts[i].sliver && (r == kNone || parts[i].area_m2 < parts[r].area_m2)) r = i;
    }
    if (r == kNone) break;
    RegionScratch::Beside most = parts[r].beside.front();
    for (const auto& b : parts[r].beside) {
      if (b.tie_m > most.tie_m || (b.tie_m == most.tie_m && b.region < most.region)) most = b;
    }
    RegionScratch::Part& host = parts[most.region];
    host.area_m2 += parts[r].area_m2;
    host.perimeter_m += parts[r].perimeter_m - 2 * most.length_m;
    part_from(host, r);
    for (const auto& b : parts[r].beside) {
      if (b.region == most.region) continue;
      part_from(parts[b.region], r);
      for (const auto& [i, j] : {std::pair{most.region, b.region}, std::pair{b.region, most.region}}) {
        auto& side = beside(parts[i], j);
        side.tie_m += b.tie_m;
        side.length_m += b.length_m;
      }
      parts[b.region].sliver = is_sliver(parts[b.region]);
    }
    parts[r].alive = parts[r].sliver = false;
    parts[r].beside.clear();
    host.sliver = is_sliver(host);
    scratch.numbers[r] = most.region;
  }
  // Those left are numbered in their order; every other takes the number of what it joined.
  map.region_area_m2.clear();
  map.region_perimeter_m.clear();
  std::vector<std::uint32_t>& number = scratch.renumbered;
  number.resize(count);
  for (std::uint32_t r = 0; r < count; ++r) {
    if (!parts[r].alive) continue;
    number[r] = static_cast<std::uint32_t>(map.region_area_m2.size());
    map.region_area_m2.push_back(parts[r].area_m2);
    map.region_perimeter_m.push_back(parts[r].perimeter_m);
  }
  map.region_count = static_cast<std::uint32_t>(map.region_area_m2.size());
  if (map.region_count == count) return;
  for (std::uint32_t r = 0; r < count; ++r) {
    std::uint32_t host = r;
    while (scratch.numbers[host] != host) host = scratch.numbers[host];
    if (host != r) number[r] = number[host];
  }
  for (std::uint32_t& l : label) l = number[l];
  std::erase_if(map.cuts, [&](std::uint32_t k) { return label[interior[k].left] == label[interior[k].right]; });
}

/// Where along the border one smooth region ends and the next begins, within the edges on either side: between the signs of
/// an S where the curvature is zero, between flat and curved where it is half its level nearby.
void shift_border_ends(const RegionStencils& s, std::span<const Vec4f> x, RegionScratch& scratch, RegionMap& map) {
  map.border_shifts.clear();
  if (map.region_count < 2) return;
  const auto borders = s.topology->border_edges();
  for (const auto& [first, second] : s.border_neighbours) {
    const auto &a = borders[first], &b = borders[second];  // a ends where b starts
    const std::uint32_t from = map.region[a.triangle], to = map.region[b.triangle];
    if (from == to || map.ridge[a.triangle] || map.ridge[b.triangle]) continue;
    const auto& k = scratch.vertex_curvature_per_m;
    const bool inflection = map.region_curved[from] && map.region_curved[to];
    const auto here_level = level_of(s, scratch, a.triangle), next_level = level_of(s, scratch, b.triangle);
    const float half_level = 0.5f * std::max({here_level.up, here_level.down, next_level.up, next_level.down});
    const auto past = [&](std::uint32_t vertex) {  // grows from one region to the other through 0
      const float curvature = k[vertex];
      if (inflection) return k[a.start] > k[b.end] ? -curvature : curvature;
      const float curved = std::fabs(curvature) - half_level;
      return map.region_curved[from] ? -curved : curved;
    };
    const float before = past(a.start), here = past(b.start), after = past(b.end);
    if (before < 0 && here >= 0) {  // inside a: its last part is the next region's
      const float part = here / (here - before) * (x[a.end] - x[a.start]).norm();
      map.border_shifts.push_back({from, to, part, static_cast<std::uint32_t>(first)});
    } else if (here < 0 && after >= 0) {
      const float part = here / (here - after) * (x[b.end] - x[b.start]).norm();
      map.border_shifts.push_back({to, from, part, static_cast<std::uint32_t>(second)});
    }
  }
}

void measure_regions(const RegionStencils& s, std::span<const Vec4f> x, RegionMap& map) {
  map.region_area_m2.assign(map.region_count, 0.0);
  map.region_perimeter_m.assign(map.region_count, 0.0);
  for (std::size_t f = 0; f < map.region.size(); ++f) {
    map.region_area_m2[map.region[f]] += static_cast<double>(map.areas_m2[f]);
  }
  const auto add = [&](std::uint32_t region, const auto& e) {
    map.region_perimeter_m[region] += static_cast<double>((x[e.end] - x[e.start]).norm());
  };
  for (const auto& e : s.topology->border_edges()) add(map.region[e.triangle], e);
  find_cuts(s, map);
  for (const std::uint32_t k : map.cuts) {
    const auto& e = s.topology->interior_edges()[k];
    add(map.region[e.left], e), add(map.region[e.right], e);
  }
}

}  // namespace

Vec2d ruling_direction(const RegionMap& map, std::size_t triangle) {
  const Vec2d twice = map.ruling_twice[triangle].cast<double>();
  const double cosine = std::sqrt(std::max((1 + twice.x()) / 2, 0.0)), sine = std::sqrt(std::max((1 - twice.x()) / 2, 0.0));
  return {cosine, twice.y() < 0 ? -sine : sine};
}

Vec3f ruling_in_space(const RegionStencils& s, const RegionMap& map, std::span<const Vec4f> x, std::size_t triangle) {
  const sheet::Triangle& v = s.topology->triangles()[triangle];
  const auto& r = s.plane.coordinates_m;
  const Vec2d a = r[v[1]] - r[v[0]], b = r[v[2]] - r[v[0]], d = ruling_direction(map, triangle);
  const double det = a.x() * b.y() - a.y() * b.x();
  if (std::fabs(det) < 1e-16) return Vec3f::UnitX();
  const auto along_a = static_cast<float>((d.x() * b.y() - d.y() * b.x()) / det);
  const auto along_b = static_cast<float>((a.x() * d.y() - a.y() * d.x()) / det);
  const Vec3f out = (along_a * (x[v[1]] - x[v[0]]) + along_b * (x[v[2]] - x[v[0]])).head<3>();
  const float length = out.norm();
  return length > 0 ? Vec3f(out / length) : Vec3f::UnitX();
}

bool usable(const sheet::SentPartition& partition, const sheet::Topology& topology) {
  return partition.triangle_regions.size() == topology.triangle_count() && topology.triangle_count() > 0;
}

void segment(const RegionStencils& s, const RegionFrame& frame, double time_s, const Parameters& parameters,
             RegionState* state, RegionScratch& scratch, RegionMap& map) {
  const std::span<const Vec4f> x = frame.positions_m;
  find_bending(s, frame, parameters, scratch, map);
  const std::size_t count = map.ridge.size();
  const bool known = state != nullptr && state->topology == s.topology && state->curved.size() == count &&
                     std::fabs(time_s - state->time_s) <= parameters.flat_memory_s;
  std::vector<std::uint8_t>& curved = scratch.curved;
  find_signs(s, known ? state : nullptr, parameters, map, curved, scratch);
  label_faces(s, scratch, map);
  flood_ridges(s, scratch, map);
  merge_slivers(s, x, parameters, scratch, map);
  scratch.curved_area_m2.assign(map.region_count, 0.0);
  for (std::size_t f = 0; f < count; ++f) {
    scratch.curved_area_m2[map.region[f]] += curved[f] ? static_cast<double>(map.areas_m2[f]) : 0.0;
  }
  map.region_curved.resize(map.region_count);
  for (std::size_t r = 0; r < map.region_count; ++r) {
    map.region_curved[r] = scratch.curved_area_m2[r] > 0.5 * map.region_area_m2[r];
  }
  shift_border_ends(s, x, scratch, map);
  if (state != nullptr) {
    state->topology = s.topology;
    state->time_s = time_s;
    state->curved.swap(curved);
  }
}

void adopt_partition(const sheet::SentPartition& partition, const RegionStencils& s, const RegionFrame& frame,
                     const Parameters& parameters, RegionScratch& scratch, RegionMap& map) {
  find_bending(s, frame, parameters, scratch, map);
  const std::size_t count = map.ridge.size();
  assert(partition.triangle_regions.size() == count);
  const auto sent = [&](std::size_t f) {
    const std::uint32_t r = partition.triangle_regions[f];
    return r < partition.region_curved.size() ? r : kNone;
  };
  scratch.sets.reset(count);
  for (const auto& e : s.topology->interior_edges()) {
    if (sent(e.left) == kNone && sent(e.right) == kNone) scratch.sets.join(e.left, e.right);
  }
  const auto regions = static_cast<std::uint32_t>(partition.region_curved.size());
  map.region.resize(count);
  std::map<std::uint32_t, std::uint32_t> extra;
  for (std::uint32_t f = 0; f < count; ++f) {
    map.region[f] = sent(f);
    if (map.region[f] == kNone) {
      map.region[f] =
          extra.try_emplace(scratch.sets.find(f), regions + static_cast<std::uint32_t>(extra.size())).first->second;
    }
  }
  map.region_count = regions + static_cast<std::uint32_t>(extra.size());
  map.border_shifts.clear();
  map.region_curved = partition.region_curved;
  map.region_curved.resize(map.region_count, false);
  measure_regions(s, frame.positions_m, map);
}

}  // namespace rustle::analysis
