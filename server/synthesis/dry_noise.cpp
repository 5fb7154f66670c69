#include "server/synthesis/dry_noise.h"

#include <algorithm>

namespace rustle::synthesis {

DryNoise::DryNoise(int most, int block_size)
    : block_size_(static_cast<std::size_t>(block_size)),
      sources_(2 * static_cast<std::size_t>(most)),
      sums_(sources_.size() * block_size_) {}

void DryNoise::next_hop() noexcept {
  const std::size_t hop = block_size_ / 2;
  for (Source& source : sources_) {
    if (source.hops_left == 0) continue;
    --source.hops_left;
    const auto sum = std::span(sums_).subspan(place_of(source), block_size_);
    std::copy(sum.begin() + static_cast<std::ptrdiff_t>(hop), sum.end(), sum.begin());
    std::fill(sum.begin() + static_cast<std::ptrdiff_t>(hop), sum.end(), 0.0F);
  }
}

std::span<float> DryNoise::block(std::uint64_t id, Bus bus, const spatial::Emitter& emitter) noexcept {
  Source* chosen = nullptr;
  for (Source& source : sources_) {
    if (source.hops_left > 0 && source.id == id) {
      chosen = &source;
      break;
    }
    if (source.hops_left == 0 && !chosen) chosen = &source;
  }
  if (!chosen) return {};
  const auto sum = std::span(sums_).subspan(place_of(*chosen), block_size_);
  if (chosen->hops_left == 0) std::ranges::fill(sum, 0.0F);
  *chosen = {id, bus, emitter, 2};
  return sum;
}

std::span<const float> DryNoise::heard(const Source& source) const noexcept {
  return std::span(sums_).subspan(place_of(source), block_size_ / 2);
}

}  // namespace rustle::synthesis
