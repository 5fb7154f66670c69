#include "server/analysis/plane_batch.h"

#include <algorithm>
#include <cmath>

#include "server/sheet/simd.h"

namespace rustle::analysis {
namespace {

struct GaussPoint {
  float place, share;  ///< on [0, 1]
};
constexpr std::array<GaussPoint, 3> kQuintic = {
    {{0.11270166537925831f, 5.0f / 18}, {0.5f, 8.0f / 18}, {0.88729833462074169f, 5.0f / 18}}};

/// By lane: one over differences of distance, the kinks of the weight as distances from that of the lowest corner, and the
/// sums that go to the corners.
struct Lines {
  PlaneBatch::Lanes per_rise, per_below, per_above, kinks[4];
  PlaneBatch::Lanes slip_m_per_s[3][3], speed_area[3], slip_area[3][3];
};

RUSTLE_SIMD void prepare(PlaneBatch& __restrict b, Lines& __restrict l) {
  for (std::size_t i = 0; i < PlaneBatch::kLanes; ++i) {
    const float d1 = b.middle_m[i], d2 = b.rise_m[i], above = d2 - d1;
    l.per_rise[i] = 1 / d2;
    l.per_below[i] = d1 > 0 ? 1 / d1 : 0.0f;
    l.per_above[i] = above > 0 ? 1 / above : 0.0f;
    const float low = b.lowest_m[i] > 0 ? b.lowest_m[i] : 0.0f, high = d2 < b.radius_m[i] ? d2 : b.radius_m[i];
    const float middle = d1 < low ? low : d1 > high ? high : d1;
    const float full = b.full_m[i] < low ? low : b.full_m[i] > high ? high : b.full_m[i];
    l.kinks[0][i] = low;
    l.kinks[1][i] = middle < full ? middle : full;
    l.kinks[2][i] = middle < full ? full : middle;
    l.kinks[3][i] = high;
    b.beyond[i] = 0;
  }
  for (std::size_t k = 0; k < 3; ++k) {
    for (std::size_t i = 0; i < PlaneBatch::kLanes; ++i) {
      for (std::size_t d = 0; d < 3; ++d) l.slip_m_per_s[k][d][i] = b.slip_m_per_s[k].at[i][d], l.slip_area[k][d][i] = 0;
      b.contact_m2[k][i] = l.speed_area[k][i] = 0;
    }
  }
}

/// Adds what lies about one of the points of an interval between kinks. The line at one distance runs from the side between
/// lowest and highest corner to one of the others.
RUSTLE_SIMD void add_lines(PlaneBatch& __restrict b, Lines& __restrict l, std::size_t interval, float place, float share,
                           float per_fade) {
  for (std::size_t i = 0; i < PlaneBatch::kLanes; ++i) {
    const float start = l.kinks[interval][i], height = l.kinks[interval + 1][i] - start, level = start + place * height;
    const bool below = level < b.middle_m[i];
    const float q = level * l.per_rise[i];
    const float p = below ? level * l.per_below[i] : (b.rise_m[i] - level) * l.per_above[i];
    const float b0 = 0.5f * (below ? 2 - q - p : 1 - q), b1 = 0.5f * p, b2 = 0.5f * (below ? q : 1 + q - p);
    const float x = (level - b.full_m[i]) * per_fade, faded = 1 - x * x * (3 - 2 * x);
    const float contact = 2 * b.area_m2[i] * p * l.per_rise[i] * share * height * (x <= 0 ? 1.0f : faded);
    float part0 = b.reached[0][i] * b0, part1 = b.reached[1][i] * b1, part2 = b.reached[2][i] * b2;
    // Without a corner within reach, to the nearest corner.
    const float reached = part0 + part1 + part2, alone = reached > 0 ? 0.0f : 1.0f;
    const float largest12 = b1 > b2 ? b1 : b2, first = b0 >= largest12 ? alone : 0.0f,
                second = b1 >= b2 ? alone - first : 0.0f;
    part0 += first, part1 += second, part2 += alone - first - second;
    b.beyond[i] += alone * contact;
    const float per_share = contact / (reached > 0 ? reached : 1.0f);
    part0 *= per_share, part1 *= per_share, part2 *= per_share;
    const float sx = b0 * l.slip_m_per_s[0][0][i] + b1 * l.slip_m_per_s[1][0][i] + b2 * l.slip_m_per_s[2][0][i],
                sy = b0 * l.slip_m_per_s[0][1][i] + b1 * l.slip_m_per_s[1][1][i] + b2 * l.slip_m_per_s[2][1][i],
                sz = b0 * l.slip_m_per_s[0][2][i] + b1 * l.slip_m_per_s[1][2][i] + b2 * l.slip_m_per_s[2][2][i];
    const float speed = std::sqrt(sx * sx + sy * sy + sz * sz);
    b.contact_m2[0][i] += part0, b.contact_m2[1][i] += part1, b.contact_m2[2][i] += part2;
    l.speed_area[0][i] += part0 * speed, l.speed_area[1][i] += part1 * speed, l.speed_area[2][i] += part2 * speed;
    l.slip_area[0][0][i] += part0 * sx, l.slip_area[0][1][i] += part0 * sy, l.slip_area[0][2][i] += part0 * sz;
    l.slip_area[1][0][i] += part1 * sx, l.slip_area[1][1][i] += part1 * sy, l.slip_area[1][2][i] += part1 * sz;
    l.slip_area[2][0][i] += part2 * sx, l.slip_area[2][1][i] += part2 * sy, l.slip_area[2][2][i] += part2 * sz;
  }
}

RUSTLE_SIMD void finish(PlaneBatch& __restrict b, const Lines& __restrict l) {
  for (std::size_t k = 0; k < 3; ++k) {
    for (std::size_t i = 0; i < PlaneBatch::kLanes; ++i) {
      for (std::size_t d = 0; d < 3; ++d) b.moved[k].at[i][d] = l.slip_area[k][d][i];
      b.moved[k].at[i][3] = l.speed_area[k][i];
    }
  }
}

}  // namespace

void integrate_lines(PlaneBatch& batch, float fade_m) {
  Lines lines;
  prepare(batch, lines);
  for (std::size_t interval = 0; interval < 3; ++interval) {
    for (const auto& [place, share] : kQuintic) add_lines(batch, lines, interval, place, share, 1 / fade_m);
  }
  finish(batch, lines);
}

}  // namespace rustle::analysis
