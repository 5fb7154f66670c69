#pragma once

#include <cmath>
#include <cstddef>
#include <numbers>
#include <span>

namespace rustle::dsp {

/// w_n = sin(π (n + ½) / N). Its squares, half a window apart, add to one: random-phase blocks keep their power (P8).
inline void sine_window(std::span<float> out) noexcept {
  const double step = std::numbers::pi / static_cast<double>(out.size());
  for (std::size_t n = 0; n < out.size(); ++n) out[n] = static_cast<float>(std::sin(step * (static_cast<double>(n) + 0.5)));
}

/// w_n = ½ (1 - cos(2πn / N)), periodic: windows half a length apart add to one.
inline void hann_window(std::span<float> out) noexcept {
  const double step = 2 * std::numbers::pi / static_cast<double>(out.size());
  for (std::size_t n = 0; n < out.size(); ++n) {
    out[n] = static_cast<float>(0.5 * (1.0 - std::cos(step * static_cast<double>(n))));
  }
}

}  // namespace rustle::dsp
