#include "server/analysis/rulings.h"

#include <algorithm>
#include <limits>

#include "server/sheet/simd.h"

namespace rustle::analysis {
namespace {

using sheet::Vec2f;

constexpr float kNowhere = std::numeric_limits<float>::infinity();

using Lanes = float[SideBlock::kLanes];

/// Where a line crosses each side, along it from its start; infinity where it does not.
RUSTLE_SIMD void cross(const SideBlock& b, float from_x, float from_y, float x, float y, Lanes& out_m) {
  for (std::size_t i = 0; i < SideBlock::kLanes; ++i) {
    const float ax = b.start_x[i] - from_x, ay = b.start_y[i] - from_y, bx = b.end_x[i] - from_x, by = b.end_y[i] - from_y;
    const float off_a = x * ay - y * ax, off_b = x * by - y * bx, at_a = x * ax + y * ay, at_b = x * bx + y * by;
    const float left_a = off_a > 0 ? 1.0f : 0.0f, left_b = off_b > 0 ? 1.0f : 0.0f, crossed = left_a - left_b;
    const float at = at_a + off_a / (crossed != 0 ? off_a - off_b : 1.0f) * (at_b - at_a);
    out_m[i] = crossed != 0 ? at : kNowhere;
  }
}

}  // namespace

void outline_regions(const RegionStencils& s, const RegionMap& map, Outlines& out) {
  const auto interior = s.topology->interior_edges();
  const auto borders = s.topology->border_edges();
  constexpr std::uint32_t kLanes = SideBlock::kLanes;
  std::vector<std::uint32_t>& next = out.next;
  next.assign(map.region_count, 0);
  for (const auto& e : borders) ++next[map.region[e.triangle]];
  for (const std::uint32_t k : map.cuts) ++next[map.region[interior[k].left]], ++next[map.region[interior[k].right]];
  out.start.assign(map.region_count + 1, 0);
  for (std::size_t r = 0; r < map.region_count; ++r) {
    out.start[r + 1] = out.start[r] + (next[r] + kLanes - 1) / kLanes;
    next[r] = kLanes * out.start[r];
  }
  out.blocks.assign(out.start.back(), SideBlock());
  const auto add = [&](std::uint32_t region, std::uint32_t start, std::uint32_t end, bool is_border) {
    const std::uint32_t place = next[region]++, i = place % kLanes;
    SideBlock& block = out.blocks[place / kLanes];
    const Vec2f &a = s.rest_m[start], &b = s.rest_m[end];
    block.start_x[i] = a.x(), block.start_y[i] = a.y(), block.end_x[i] = b.x(), block.end_y[i] = b.y();
    block.is_border[i] = is_border;
  };
  for (const auto& e : borders) add(map.region[e.triangle], e.start, e.end, true);
  for (const std::uint32_t k : map.cuts) {
    add(map.region[interior[k].left], interior[k].start, interior[k].end, false);
    add(map.region[interior[k].right], interior[k].start, interior[k].end, false);
  }
}

/// How far one way the line goes. It starts inside, and every crossing changes sides.
float RulingTracer::reach_m(std::vector<Crossing>& crossings, float gap_m) {
  std::sort(crossings.begin(), crossings.end(), [](const Crossing& a, const Crossing& b) { return a.at_m < b.at_m; });
  float reach = 0;
  for (std::size_t k = 0; k < crossings.size(); k += 2) {
    reach = crossings[k].at_m;
    if (crossings[k].is_border || k + 1 >= crossings.size()) break;
    if (crossings[k + 1].is_border || crossings[k + 1].at_m - reach > gap_m) break;
  }
  return reach;
}

double RulingTracer::length_m(const Outlines& outlines, std::uint32_t region, const Vec2f& from, const Vec2f& direction,
                              float gap_m) {
  ahead_.clear();
  behind_.clear();
  Lanes at_m;
  for (std::uint32_t k = outlines.start[region]; k < outlines.start[region + 1]; ++k) {
    const SideBlock& block = outlines.blocks[k];
    cross(block, from.x(), from.y(), direction.x(), direction.y(), at_m);
    for (std::size_t i = 0; i < SideBlock::kLanes; ++i) {
      const float at = at_m[i];
      if (at == kNowhere) continue;
      const bool is_border = block.is_border[i] != 0;
      if (at > 0) {
        ahead_.push_back({at, is_border});
      } else {
        behind_.push_back({-at, is_border});
      }
    }
  }
  return static_cast<double>(reach_m(ahead_, gap_m) + reach_m(behind_, gap_m));
}

}  // namespace rustle::analysis
