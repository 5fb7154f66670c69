#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "server/analysis/stencil.h"

namespace rustle::analysis {

/// kernel() whose weights are computed where they are used, for meshes much finer than its radius: the weights of their many
/// sources would fill the caches in every frame. Targets near one another share a block, whose targets look at one list of
/// sources, each at its own distances.
struct KernelBlocks {
  static constexpr std::size_t kLanes = 16;
  struct Block {
    std::array<float, kLanes> x_m{}, y_m{};           ///< the targets' places
    std::array<float, kLanes> per_radius2_per_m2{};   ///< 1/r²
    std::uint32_t first_target = 0;                   ///< in the order of targets
    std::uint32_t targets = 0;                        ///< 1 to kLanes
    std::uint32_t first_source = 0, last_source = 0;  ///< in `sources`
  };
  std::vector<Block> blocks;
  std::vector<std::uint32_t> sources;             ///< ascending within a block
  std::vector<std::array<float, 2>> source_at_m;  ///< [N]

  /// (1-(d/r)²)² of one target of a block, 0 beyond its radius.
  float weight(const Block& block, std::size_t lane, std::uint32_t source) const;
  std::span<const std::uint32_t> sources_of(const Block& block) const {
    return std::span(sources).subspan(block.first_source, block.last_source - block.first_source);
  }
};

/// Blocks of the targets in the given order, over the sources that `rows` names for them.
/// \pre rows = kernel(targets, radii_m, sources), and every target has a source within its radius
[[nodiscard]] KernelBlocks kernel_blocks(const Stencil& rows, std::span<const std::uint32_t> order,
                                         const PlanePoints& targets, std::span<const double> radii_m,
                                         const PlanePoints& sources);

/// Σ weight · moment of every target, in their order, times `response`: out_trace the sum of the first three of the four
/// numbers that gives, out_last the fourth; both by order[target]. \pre moments of all sources; sizes as in kernel_blocks()
void sum_blocks(const KernelBlocks& kernel, std::span<const Moment> moments, std::span<const std::uint32_t> order,
                std::span<const Moment> response, std::span<float> out_trace, std::span<float> out_last);

}  // namespace rustle::analysis
