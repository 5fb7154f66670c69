#include "server/report/sheet_view.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <numeric>
#include <set>
#include <tuple>

#include "server/report/sheet_drawing.h"

namespace rustle::report {
namespace {

constexpr double kBackWorth = 0.9;              // of the sheet's back beside its front, in a view
constexpr std::size_t kMostPairs = 50'000'000;  // of triangles compared between two meshes

bool exists(const SheetView& view, const sheet::Triangle& t) {
  return std::all_of(t.begin(), t.end(),
                     [&](std::uint32_t v) { return v < view.positions_m.size() && view.positions_m[v].allFinite(); });
}

double area_m2(const SheetView& view, const sheet::Triangle& t) {
  if (!exists(view, t)) return 0;
  const Vec3d a = view.positions_m[t[0]].cast<double>(), b = view.positions_m[t[1]].cast<double>();
  const Vec3d c = view.positions_m[t[2]].cast<double>();
  return (b - a).cross(c - a).norm() / 2;
}

std::vector<std::set<std::uint32_t>> neighbours_of(const SheetView& view) {
  std::uint32_t regions = 0;
  const std::size_t count = std::min(view.triangles.size(), view.triangle_regions.size());
  for (std::size_t t = 0; t < count; ++t) {
    const std::uint32_t region = view.triangle_regions[t];
    if (region < view.triangles.size()) regions = std::max(regions, region + 1);
  }
  std::map<std::pair<std::uint32_t, std::uint32_t>, std::uint32_t> first_region;
  std::vector<std::set<std::uint32_t>> neighbours(regions);
  for (std::size_t t = 0; t < count; ++t) {
    const std::uint32_t region = view.triangle_regions[t];
    if (region >= regions) continue;
    for (std::size_t k = 0; k < 3; ++k) {
      const auto edge = std::minmax({view.triangles[t][k], view.triangles[t][(k + 1) % 3]});
      const auto [entry, is_new] = first_region.insert({edge, region});
      if (is_new || entry->second == region) continue;
      neighbours[region].insert(entry->second);
      neighbours[entry->second].insert(region);
    }
  }
  return neighbours;
}

using Taken = std::array<bool, kCategories>;

Taken taken_beside(const std::set<std::uint32_t>& neighbours, const std::vector<int>& categories) {
  Taken taken{};
  for (const std::uint32_t other : neighbours) {
    if (categories[other] >= 0) taken[static_cast<std::size_t>(categories[other])] = true;
  }
  return taken;
}

int first_free(const Taken& taken, int wanted) {
  int category = wanted;
  for (int tried = 0; tried < kCategories && taken[static_cast<std::size_t>(category)]; ++tried) {
    category = (category + 1) % kCategories;
  }
  return category;
}

bool has_flat_places(const SheetView& view) {
  return !view.positions_m.empty() && view.material_coordinates_m.size() == view.positions_m.size();
}

/// Where the triangles lie, so that those of two meshes of one sheet can be found in each other.
std::vector<Vec3d> places_of(const SheetView& view, bool flat) {
  Vec3d middle = Vec3d::Zero();
  double count = 0;
  for (const auto& p : view.positions_m) {
    if (!p.allFinite()) continue;
    middle += p.cast<double>();
    ++count;
  }
  if (count > 0) middle /= count;
  std::vector<Vec3d> places;
  for (const sheet::Triangle& t : view.triangles) {
    Vec3d place = Vec3d::Zero();
    for (const std::uint32_t v : t) {
      if (!exists(view, t)) break;
      if (flat) {
        const sheet::Vec2f& m = view.material_coordinates_m[v];
        place += Vec3d(static_cast<double>(m.x()), static_cast<double>(m.y()), 0) / 3;
      } else {
        place += (view.positions_m[v].cast<double>() - middle) / 3;
      }
    }
    places.push_back(place);
  }
  return places;
}

/// For each triangle of `view` the one of `before` at its place.
std::vector<std::size_t> corresponding(const SheetView& before, const SheetView& view) {
  std::vector<std::size_t> same(view.triangles.size());
  std::iota(same.begin(), same.end(), std::size_t{0});
  if (before.triangles == view.triangles || before.triangles.empty()) return same;
  const bool flat = has_flat_places(before) && has_flat_places(view);
  const std::vector<Vec3d> then = places_of(before, flat), now = places_of(view, flat);
  for (std::size_t t = 0; t < now.size(); ++t) {
    double least = 1e300;
    for (std::size_t k = 0; k < then.size(); ++k) {
      const double distance = (now[t] - then[k]).squaredNorm();
      if (distance < least) {
        least = distance;
        same[t] = k;
      }
    }
  }
  return same;
}

}  // namespace

ViewDirection best_view(std::span<const SheetView> views, const ViewDirection& from) {
  ViewDirection best = from;
  double most = -1;
  for (int k = 0; k < 8; ++k) {
    const ViewDirection candidate = {from.azimuth_deg + 45.0 * k, from.elevation_deg};
    const Vec3d toward = camera_of(candidate).toward;
    double seen = 0;
    for (const SheetView& view : views) {
      for (const sheet::Triangle& t : view.triangles) {
        if (!exists(view, t)) continue;
        const Vec3d a = view.positions_m[t[0]].cast<double>(), b = view.positions_m[t[1]].cast<double>();
        const Vec3d c = view.positions_m[t[2]].cast<double>();
        const double area = (b - a).cross(c - a).dot(toward);
        seen += area > 0 ? area : -kBackWorth * area;
      }
    }
    if (seen > most * (k == 0 ? 1 : 1.08)) {
      most = seen;
      best = candidate;
    }
  }
  return best;
}

std::vector<int> region_categories(const SheetView& view) {
  const auto neighbours = neighbours_of(view);
  std::vector<int> categories(neighbours.size(), -1);
  for (std::size_t region = 0; region < neighbours.size(); ++region) {
    categories[region] =
        first_free(taken_beside(neighbours[region], categories), static_cast<int>(region % std::size_t{kCategories}));
  }
  return categories;
}

std::vector<int> continued_categories(const SheetView& before, const SheetView& view) {
  if (before.triangles != view.triangles && before.triangles.size() * view.triangles.size() > kMostPairs)
    return region_categories(view);
  const auto neighbours = neighbours_of(view);
  const std::vector<std::size_t> at = corresponding(before, view);
  std::map<std::pair<std::uint32_t, std::uint32_t>, double> shared_m2;  // of (region, region before)
  std::vector<double> areas_m2(neighbours.size());
  for (std::size_t t = 0; t < std::min(view.triangles.size(), view.triangle_regions.size()); ++t) {
    const std::uint32_t region = view.triangle_regions[t];
    if (region >= neighbours.size()) continue;
    const double area = area_m2(view, view.triangles[t]);
    areas_m2[region] += area;
    if (at[t] < before.triangle_regions.size()) shared_m2[{region, before.triangle_regions[at[t]]}] += area;
  }
  std::vector<std::tuple<double, std::uint32_t, std::uint32_t>> shares;  // largest first
  for (const auto& [pair, area] : shared_m2) shares.push_back({-area, pair.first, pair.second});
  std::sort(shares.begin(), shares.end());
  std::vector<int> categories(neighbours.size(), -1);
  std::set<std::uint32_t> handed_on;
  for (const auto& [area, region, old] : shares) {
    if (categories[region] >= 0 || old >= before.region_colours.size() || handed_on.contains(old)) continue;
    const int category = before.region_colours[old];
    if (category < 0 || taken_beside(neighbours[region], categories)[static_cast<std::size_t>(category % kCategories)])
      continue;
    categories[region] = category % kCategories;
    handed_on.insert(old);
  }
  std::vector<std::size_t> order(neighbours.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) { return areas_m2[a] > areas_m2[b]; });
  std::array<int, kCategories> uses{};
  for (const int category : categories) {
    if (category >= 0) ++uses[static_cast<std::size_t>(category)];
  }
  for (const std::size_t region : order) {
    if (categories[region] >= 0) continue;
    const Taken taken = taken_beside(neighbours[region], categories);
    const auto least_used = std::min_element(uses.begin(), uses.end()) - uses.begin();
    int category = first_free(taken, static_cast<int>(least_used));
    for (int other = 0; other < kCategories; ++other) {
      if (!taken[static_cast<std::size_t>(other)] &&
          uses[static_cast<std::size_t>(other)] < uses[static_cast<std::size_t>(category)])
        category = other;
    }
    categories[region] = category;
    ++uses[static_cast<std::size_t>(category)];
  }
  return categories;
}

std::vector<std::size_t> largest_regions(const SheetView& view, std::size_t most) {
  std::vector<std::size_t> order(view.resonators.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::stable_sort(order.begin(), order.end(),
                   [&](std::size_t a, std::size_t b) { return view.resonators[a].area_m2 > view.resonators[b].area_m2; });
  order.resize(std::min(order.size(), most));
  return order;
}

}  // namespace rustle::report
