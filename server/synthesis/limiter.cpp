#include "server/synthesis/limiter.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>

#include "server/sheet/simd.h"
#include "sound_db/dsp/level.h"

namespace rustle::synthesis {
namespace {

constexpr float kUnity = 0.99999F;  ///< a gain this near to 1 is 1 again

/// Whether every sample is finite and at most `knee` in magnitude: floats without their sign go in the order of their bits.
RUSTLE_SIMD bool quiet(const float* x, std::size_t samples, float knee) noexcept {
  std::uint32_t highest = 0;
  for (std::size_t n = 0; n < samples; ++n) {
    std::uint32_t bits = 0;
    std::memcpy(&bits, x + n, sizeof bits);
    highest = std::max(highest, bits & 0x7fffffffU);
  }
  return highest <= std::bit_cast<std::uint32_t>(knee);
}

}  // namespace

Limiter::Limiter(double rate_hz) noexcept : keep_(static_cast<float>(std::exp(-1 / (rate_hz * kLimiterRelease_s)))) {}

void Limiter::process(std::span<float* const> channels, std::size_t samples) noexcept {
  const auto knee = static_cast<float>(dsp::db_to_gain(kLimiterKnee_db));
  const bool idle = gain_ == 1 && std::all_of(channels.begin(), channels.end(),
                                              [&](const float* channel) { return quiet(channel, samples, knee); });
  if (idle) return;
  for (std::size_t n = 0; n < samples; ++n) {
    float peak = 0;
    for (float* channel : channels) {
      float& x = channel[n];
      if (!std::isfinite(x)) {
        x = 0;
        ++not_finite_;
      }
      peak = std::max(peak, std::abs(x));
    }
    float gain = 1 - (1 - gain_) * keep_;
    if (gain > kUnity) gain = 1;
    if (peak > knee) gain = std::min(gain, (knee + (1 - knee) * std::tanh((peak - knee) / (1 - knee))) / peak);
    gain_ = gain;
    if (gain == 1) continue;
    ++limited_;
    for (float* channel : channels) channel[n] = std::clamp(channel[n] * gain, -1.0F, 1.0F);
  }
}

}  // namespace rustle::synthesis
