#include "server/analysis/kernel_blocks.h"

#include <algorithm>
#include <cassert>
#include <cstring>
#include <utility>

#include "server/sheet/simd.h"

namespace rustle::analysis {
namespace {

constexpr std::uint32_t kNoBlock = 0xffffffff;

using Lanes = float __attribute__((vector_size(KernelBlocks::kLanes * sizeof(float))));

/// All blocks; what is written is that of sum_blocks().
RUSTLE_SIMD void sum_all(const KernelBlocks& kernel, const Moment* moments, const std::uint32_t* order,
                         const Moment* response, float* out_trace, float* out_last) {
  for (const KernelBlocks::Block& block : kernel.blocks) {
    Lanes x, y, per_radius2;
    std::memcpy(&x, block.x_m.data(), sizeof x);
    std::memcpy(&y, block.y_m.data(), sizeof y);
    std::memcpy(&per_radius2, block.per_radius2_per_m2.data(), sizeof per_radius2);
    Lanes sums[4] = {};
    for (std::uint32_t k = block.first_source; k < block.last_source; ++k) {
      const std::uint32_t source = kernel.sources[k];
      const Moment& moment = moments[source];
      const Lanes dx = x - kernel.source_at_m[source][0], dy = y - kernel.source_at_m[source][1];
      const Lanes inside = 1.0f - (dx * dx + dy * dy) * per_radius2;
      const Lanes root = inside > 0.0f ? inside : Lanes{}, weight = root * root;
      for (std::size_t c = 0; c < 4; ++c) sums[c] += weight * moment[static_cast<Eigen::Index>(c)];
    }
    for (std::uint32_t lane = 0; lane < block.targets; ++lane) {
      const std::uint32_t place = block.first_target + lane, target = order[place];
      const Moment& factor = response[place];
      out_trace[target] = sums[0][lane] * factor[0] + sums[1][lane] * factor[1] + sums[2][lane] * factor[2];
      out_last[target] = sums[3][lane] * factor[3];
    }
  }
}

}  // namespace

float KernelBlocks::weight(const Block& block, std::size_t lane, std::uint32_t source) const {
  const float dx = block.x_m[lane] - source_at_m[source][0], dy = block.y_m[lane] - source_at_m[source][1];
  const float inside = 1.0f - (dx * dx + dy * dy) * block.per_radius2_per_m2[lane], root = inside > 0 ? inside : 0.0f;
  return root * root;
}

KernelBlocks kernel_blocks(const Stencil& rows, std::span<const std::uint32_t> order, const PlanePoints& targets,
                           std::span<const double> radii_m, const PlanePoints& sources) {
  KernelBlocks out;
  out.source_at_m.reserve(sources.at_m.size());
  for (const sheet::Vec2d& p : sources.at_m) {
    out.source_at_m.push_back({static_cast<float>(p.x()), static_cast<float>(p.y())});
  }
  std::vector<std::uint32_t> seen, seen_by(sources.at_m.size(), kNoBlock);
  for (std::uint32_t first = 0; first < order.size();) {
    KernelBlocks::Block block;
    block.first_target = first;
    block.first_source = static_cast<std::uint32_t>(out.sources.size());
    const std::uint32_t component = targets.component[order[first]];
    seen.clear();
    while (block.targets < KernelBlocks::kLanes && first + block.targets < order.size() &&
           targets.component[order[first + block.targets]] == component) {
      const std::uint32_t target = order[first + block.targets];
      block.x_m[block.targets] = static_cast<float>(targets.at_m[target].x());
      block.y_m[block.targets] = static_cast<float>(targets.at_m[target].y());
      block.per_radius2_per_m2[block.targets] = static_cast<float>(1 / (radii_m[target] * radii_m[target]));
      for (const auto& entry : rows.row(target)) {
        if (std::exchange(seen_by[entry.source], first) != first) seen.push_back(entry.source);
      }
      ++block.targets;
    }
    std::sort(seen.begin(), seen.end());
    out.sources.insert(out.sources.end(), seen.begin(), seen.end());
    block.last_source = static_cast<std::uint32_t>(out.sources.size());
    out.blocks.push_back(block);
    first += block.targets;
  }
  return out;
}

void sum_blocks(const KernelBlocks& kernel, std::span<const Moment> moments, std::span<const std::uint32_t> order,
                std::span<const Moment> response, std::span<float> out_trace, std::span<float> out_last) {
  assert(moments.size() == kernel.source_at_m.size() && response.size() == order.size());
  assert(out_trace.size() == order.size() && out_last.size() == order.size());
  sum_all(kernel, moments.data(), order.data(), response.data(), out_trace.data(), out_last.data());
}

}  // namespace rustle::analysis
