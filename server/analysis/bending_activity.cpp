#include "server/analysis/bending_activity.h"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <utility>

#include "server/sheet/face_geometry.h"

namespace rustle::analysis {
namespace {

using sheet::Vec2d;
using sheet::Vec3d;
using sheet::Vec4f;

constexpr double kGridCells = 12;  // of a sheet's bounding box
constexpr double kSamples = 1500;  // that stay with the material of a sheet
constexpr std::size_t kRanks = 257;
constexpr std::size_t kMostSampledTriangles = 512;  // that tell the patches' normals

const auto kYield = static_cast<float>(kYieldCurvature_per_m);
const auto kLeastSlack = static_cast<float>(kLeastYield_per_m);

/// H_p after a way from flat to `mean_per_m`.
float bent_from_flat(float mean_per_m) {
  return mean_per_m > kYield ? mean_per_m - kYield : mean_per_m < -kYield ? mean_per_m + kYield : 0.0f;
}

float slack_of_steps(float step_per_m) {
  return kLeastSlack + static_cast<float>(kRemeshSlack) * step_per_m;
}

float at(const sheet::Transfer::Origin& o, std::span<const float> values) {
  return o.weights[0] * values[o.vertices[0]] + o.weights[1] * values[o.vertices[1]] + o.weights[2] * values[o.vertices[2]];
}

Vec4f at(const sheet::Transfer::Origin& o, std::span<const Vec4f> values) {
  return o.weights[0] * values[o.vertices[0]] + o.weights[1] * values[o.vertices[1]] + o.weights[2] * values[o.vertices[2]];
}

void loosen_vertices(const CurvatureStencils& stencils, std::span<const float> mean_per_m, std::vector<float>& slack_per_m) {
  for (std::size_t i = 0; i < mean_per_m.size(); ++i) {
    float step = 0;
    for (std::uint32_t k = stencils.neighbour_start[i]; k < stencils.neighbour_start[i + 1]; ++k) {
      step = std::max(step, std::abs(mean_per_m[stencils.neighbour[k]] - mean_per_m[i]));
    }
    slack_per_m[i] = slack_of_steps(step);
  }
}

void loosen_samples(std::span<const sheet::Transfer::Origin> on_mesh, std::span<const float> mean_per_m,
                    std::vector<float>& slack_per_m) {
  for (std::size_t i = 0; i < on_mesh.size(); ++i) {
    const float a = mean_per_m[on_mesh[i].vertices[0]], b = mean_per_m[on_mesh[i].vertices[1]];
    const float c = mean_per_m[on_mesh[i].vertices[2]];
    slack_per_m[i] = slack_of_steps(std::max({a, b, c}) - std::min({a, b, c}));
  }
}

std::shared_ptr<const sheet::Topology> points_at(std::vector<sheet::Vec2f> material_coordinates_m) {
  sheet::Topology::Input input;
  input.vertex_count = material_coordinates_m.size();
  input.material_coordinates_m = std::move(material_coordinates_m);
  auto made = sheet::Topology::make(std::move(input));
  assert(made);
  return *made;
}

/// Calls visit(index, rank) from the least |value| on, rank the share of the area passed at its middle.
template <class Visit>
void by_rank(std::span<const float> values, std::span<const float> areas_m2, Visit&& visit) {
  std::vector<std::uint32_t> order(values.size());
  double total_m2 = 0;
  for (std::uint32_t i = 0; i < order.size(); ++i) order[i] = i, total_m2 += static_cast<double>(areas_m2[i]);
  std::sort(order.begin(), order.end(), [&](std::uint32_t a, std::uint32_t b) {
    return std::pair(std::abs(values[a]), a) < std::pair(std::abs(values[b]), b);
  });
  double passed_m2 = 0;
  for (const std::uint32_t i : order) {
    visit(i, (passed_m2 + 0.5 * static_cast<double>(areas_m2[i])) / std::max(total_m2, 1e-30));
    passed_m2 += static_cast<double>(areas_m2[i]);
  }
}

void take_ranked(std::span<const float> mean_per_m, std::span<const float> areas_m2, BendingState& state) {
  const std::vector<float>& ranked = state.ranked_per_m;
  state.stays_per_m.resize(mean_per_m.size());
  state.slack_per_m.resize(mean_per_m.size());
  by_rank(mean_per_m, areas_m2, [&](std::uint32_t i, double rank) {
    const double place = rank * static_cast<double>(ranked.size() - 1);
    const auto below = std::min(static_cast<std::size_t>(place), ranked.size() - 2);
    const auto share = static_cast<float>(place - static_cast<double>(below));
    const float stays = ranked[below] + share * (ranked[below + 1] - ranked[below]);
    state.stays_per_m[i] = mean_per_m[i] < 0 ? -stays : stays;
  });
  state.ranked_per_m.clear();
}

struct Changed {
  double change_m = 0;
  Vec3d moment = Vec3d::Zero();
  Eigen::Matrix3d second = Eigen::Matrix3d::Zero();
};

void orient(const BendingPatches& patches, std::uint32_t patch, std::span<const Vec4f> relative_m,
            observation::BendingPatch& out) {
  const auto vector_area = [&](std::uint32_t k) {
    const sheet::Triangle& t = patches.triangles[k];
    const Vec4f a = relative_m[t[1]] - relative_m[t[0]], b = relative_m[t[2]] - relative_m[t[0]];
    return Vec3d(a.cross3(b).head<3>().cast<double>());
  };
  const std::uint32_t first = patches.triangle_start[patch], last = patches.triangle_start[patch + 1];
  Vec3d sum = Vec3d::Zero();
  for (std::uint32_t k = first; k < last; ++k) sum += vector_area(k);
  const double size = sum.norm();
  if (!(size > 0)) return;
  out.normal = sum / size;
  double areas = 0, aslant = 0;
  for (std::uint32_t k = first; k < last; ++k) {
    const Vec3d area = vector_area(k);
    const double norm = area.norm();
    if (!(norm > 0)) continue;
    const double cosine = area.dot(out.normal) / norm;
    areas += norm;
    aslant += norm * std::max(0.0, 1 - cosine * cosine);
  }
  out.normal_spread = areas > 0 ? std::sqrt(aslant / areas) : 0;
}

}  // namespace

std::uint32_t BendingPatches::at(const Vec2d& point_m) const {
  const Vec2d share = (point_m - low_m).cwiseQuotient(extent_m);
  const auto place = [](double x, std::uint32_t cells) {
    return std::min(static_cast<std::uint32_t>(std::max(0.0, x) * cells), cells - 1);
  };
  return place(share.y(), rows) * columns + place(share.x(), columns);
}

BendingPatches bending_patches(const sheet::Topology& topology, const sheet::RestPlane& plane) {
  BendingPatches out;
  const std::size_t vertices = topology.vertex_count();
  const auto triangles = topology.triangles();
  assert(plane.coordinates_m.size() == vertices);
  out.area_m2.assign(vertices, 0.0f);
  for (const sheet::Triangle& t : triangles) {
    const Vec2d a = plane.coordinates_m[t[1]] - plane.coordinates_m[t[0]];
    const Vec2d b = plane.coordinates_m[t[2]] - plane.coordinates_m[t[0]];
    const double third_m2 = std::abs(a.x() * b.y() - a.y() * b.x()) / 6;
    for (const std::uint32_t v : t) out.area_m2[v] += static_cast<float>(third_m2);
  }
  Vec2d high = Vec2d::Zero();
  if (vertices > 0) out.low_m = high = plane.coordinates_m[0];
  for (const Vec2d& p : plane.coordinates_m) out.low_m = out.low_m.cwiseMin(p), high = high.cwiseMax(p);
  out.extent_m = (high - out.low_m).cwiseMax(1e-9);
  const double cell_m = std::sqrt(out.extent_m.x() * out.extent_m.y() / kGridCells);
  const auto cells = [&](double length_m, double most) {
    return static_cast<std::uint32_t>(std::clamp(std::round(length_m / cell_m), 1.0, most));
  };
  out.columns = cells(out.extent_m.x(), kMostPatches);
  out.rows = cells(out.extent_m.y(), kMostPatches / out.columns);
  out.of_vertex.resize(vertices);
  for (std::size_t i = 0; i < vertices; ++i) {
    const std::uint32_t patch = out.at(plane.coordinates_m[i]);
    out.of_vertex[i] = static_cast<std::uint8_t>(patch);
    out.patch_area_m2[patch] += static_cast<double>(out.area_m2[i]);
  }
  const std::size_t stride = (triangles.size() + kMostSampledTriangles - 1) / kMostSampledTriangles;
  out.triangle_start.assign(out.count() + 1, 0);
  for (std::uint32_t patch = 0; patch < out.count(); ++patch) {
    for (std::size_t f = 0; f < triangles.size(); f += stride) {
      if (out.of_vertex[triangles[f][0]] == patch) out.triangles.push_back(triangles[f]);
    }
    out.triangle_start[patch + 1] = static_cast<std::uint32_t>(out.triangles.size());
  }
  return out;
}

void find_bending(const BendingInputs& in, BendingState& state, std::vector<observation::BendingPatch>& out) {
  const bool sampled = state.samples.points != nullptr;
  const auto& on_mesh = state.samples.on_mesh;
  std::span<const float> mean_per_m = in.mean_per_m;
  if (sampled) {
    state.gathered_per_m.resize(on_mesh.size());
    for (std::size_t i = 0; i < on_mesh.size(); ++i) state.gathered_per_m[i] = at(on_mesh[i], in.mean_per_m);
    mean_per_m = state.gathered_per_m;
  }
  const std::size_t points = mean_per_m.size();
  if (!sampled && !state.ranked_per_m.empty()) take_ranked(mean_per_m, in.patches.area_m2, state);
  if (state.stays_per_m.size() != points) {
    state.stays_per_m.resize(points);
    state.slack_per_m.assign(points, kLeastSlack);
    for (std::size_t i = 0; i < points; ++i) state.stays_per_m[i] = bent_from_flat(mean_per_m[i]);
    return;
  }
  if (in.remeshed && sampled) loosen_samples(on_mesh, in.mean_per_m, state.slack_per_m);
  if (in.remeshed && !sampled) loosen_vertices(in.stencils, in.mean_per_m, state.slack_per_m);
  std::array<Changed, kMostPatches> changed;
  bool any = false;
  for (std::size_t i = 0; i < points; ++i) {
    const float off = mean_per_m[i] - state.stays_per_m[i], beyond = std::abs(off) - kYield;
    if (!(beyond > state.slack_per_m[i])) continue;
    any = true;
    state.stays_per_m[i] += off > 0 ? beyond : -beyond;
    state.slack_per_m[i] = kLeastSlack;
    const auto weight_m = static_cast<double>(beyond * (sampled ? state.samples.area_m2 : in.patches.area_m2[i]));
    const Vec3d place = (sampled ? at(on_mesh[i], in.relative_m) : in.relative_m[i]).head<3>().cast<double>();
    Changed& patch = changed[sampled ? state.samples.patch[i] : in.patches.of_vertex[i]];
    patch.change_m += weight_m;
    patch.moment += weight_m * place;
    patch.second += weight_m * place * place.transpose();
  }
  if (!any) return;
  for (std::uint32_t p = 0; p < in.patches.count(); ++p) {
    const Changed& patch = changed[p];
    if (!(patch.change_m > 0) || !std::isfinite(patch.change_m)) continue;
    observation::BendingPatch& told = out.emplace_back();
    told.patch = p;
    told.change_m = patch.change_m;
    told.area_m2 = in.patches.patch_area_m2[p];
    const Vec3d centre = patch.moment / patch.change_m;
    told.position_m = in.origin_m + centre;
    told.covariance_m2 = patch.second / patch.change_m - centre * centre.transpose();
    orient(in.patches, p, in.relative_m, told);
  }
}

void carry(const sheet::Transfer& transfer, BendingState& state) {
  if (state.stays_per_m.empty()) return;
  BendingState next;
  for (const auto& o : transfer.origins) next.stays_per_m.push_back(state.stays_per_m[o.closest()]);
  next.slack_per_m.assign(next.stays_per_m.size(), kLeastSlack);
  state = std::move(next);
}

void carry_by_material(const sheet::Topology& from, const BendingPatches& before, const sheet::Topology& to,
                       BendingState& state) {
  if (state.stays_per_m.empty()) return;
  if (state.samples.points == nullptr) {
    const double cell_m = std::sqrt(before.extent_m.x() * before.extent_m.y() / kSamples);
    std::vector<sheet::Vec2f> grid_m, inside_m;
    for (double y = cell_m / 2; y < before.extent_m.y(); y += cell_m) {
      for (double x = cell_m / 2; x < before.extent_m.x(); x += cell_m) {
        grid_m.push_back((before.low_m + Vec2d(x, y)).cast<float>());
      }
    }
    const auto all = points_at(std::move(grid_m));
    const auto places = sheet::transfer_by_material(from, *all).origins;
    BendingState sampled;
    for (std::size_t i = 0; i < places.size(); ++i) {
      sheet::Vec2f met = sheet::Vec2f::Zero();
      for (std::size_t k = 0; k < 3; ++k) met += places[i].weights[k] * from.material_coordinates_m()[places[i].vertices[k]];
      const sheet::Vec2f& wanted = all->material_coordinates_m()[i];
      if (static_cast<double>((met - wanted).norm()) > 0.1 * cell_m) continue;
      inside_m.push_back(wanted);
      sampled.samples.patch.push_back(static_cast<std::uint8_t>(before.at(wanted.cast<double>())));
      sampled.stays_per_m.push_back(at(places[i], state.stays_per_m));
    }
    if (sampled.stays_per_m.empty()) {
      state = {};
      return;
    }
    double area_m2 = 0;
    for (const float a : before.area_m2) area_m2 += static_cast<double>(a);
    sampled.samples.area_m2 = static_cast<float>(area_m2 / static_cast<double>(sampled.stays_per_m.size()));
    sampled.samples.points = points_at(std::move(inside_m));
    sampled.slack_per_m.assign(sampled.stays_per_m.size(), kLeastSlack);
    state = std::move(sampled);
  }
  state.samples.on_mesh = sheet::transfer_by_material(to, *state.samples.points).origins;
}

void carry_by_rank(const BendingPatches& before, BendingState& state) {
  if (state.stays_per_m.empty()) return;
  BendingState next;
  const std::vector<float> equal_m2(state.samples.points ? state.stays_per_m.size() : 0, state.samples.area_m2);
  const std::span<const float> areas_m2 = state.samples.points ? std::span<const float>(equal_m2) : before.area_m2;
  double last_rank = 0;
  float last = 0;
  bool begun = false;
  by_rank(state.stays_per_m, areas_m2, [&](std::uint32_t i, double rank) {
    const float stays = std::abs(state.stays_per_m[i]);
    if (!begun) last = stays, begun = true;
    while (next.ranked_per_m.size() < kRanks && static_cast<double>(next.ranked_per_m.size()) / (kRanks - 1) <= rank) {
      const double wanted = static_cast<double>(next.ranked_per_m.size()) / (kRanks - 1);
      const double share = rank > last_rank ? (wanted - last_rank) / (rank - last_rank) : 1;
      next.ranked_per_m.push_back(last + static_cast<float>(share) * (stays - last));
    }
    last = stays;
    last_rank = rank;
  });
  next.ranked_per_m.resize(kRanks, last);
  state = std::move(next);
}

}  // namespace rustle::analysis
