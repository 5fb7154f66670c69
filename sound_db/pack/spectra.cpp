#include "sound_db/pack/spectra.h"

#include <algorithm>
#include <cassert>
#include <cmath>

namespace rustle::pack {

namespace {

/// ∫ of the piecewise linear power from bin 0 to bin position `at`.
double power_below(std::span<const float> magnitudes, std::span<const double> cumulative, double at) {
  const auto k = std::min(static_cast<std::size_t>(at), magnitudes.size() - 2);
  const double part = at - static_cast<double>(k);
  const double left = static_cast<double>(magnitudes[k]) * magnitudes[k];
  const double right = static_cast<double>(magnitudes[k + 1]) * magnitudes[k + 1];
  return cumulative[k] + part * (left + 0.5 * part * (right - left));
}

}  // namespace

std::vector<float> resampled_spectrum(std::span<const float> magnitudes, double from_rate_hz, int bins, double to_rate_hz) {
  assert(magnitudes.size() >= 2 && bins >= 2 && from_rate_hz > 0 && to_rate_hz > 0);
  const std::size_t last = magnitudes.size() - 1;
  const double step = to_rate_hz / (bins - 1) / (from_rate_hz / static_cast<double>(last));
  const double scale = std::sqrt(to_rate_hz / from_rate_hz);
  std::vector<double> cumulative(magnitudes.size(), 0.0);
  for (std::size_t k = 0; k < last; ++k) {
    const double left = magnitudes[k], right = magnitudes[k + 1];
    cumulative[k + 1] = cumulative[k] + 0.5 * (left * left + right * right);
  }
  std::vector<float> out(static_cast<std::size_t>(bins), 0.0f);
  const double top = static_cast<double>(last);
  for (int b = 0; b < bins; ++b) {
    const double at = step * b;
    double magnitude = 0;
    if (step > 1.0 + 1e-9) {
      const double low = std::clamp(at - step / 2, 0.0, top), high = std::clamp(at + step / 2, 0.0, top);
      const double width = b == 0 || b == bins - 1 ? step / 2 : step;
      magnitude = std::sqrt(
          std::max(0.0, power_below(magnitudes, cumulative, high) - power_below(magnitudes, cumulative, low)) / width);
    } else if (at <= top * (1 + 1e-12)) {
      const auto k = std::min(static_cast<std::size_t>(at + 1e-9), last - 1);
      const double part = std::clamp(at - static_cast<double>(k), 0.0, 1.0);
      magnitude = magnitudes[k] + part * (static_cast<double>(magnitudes[k + 1]) - magnitudes[k]);
    }
    out[static_cast<std::size_t>(b)] = static_cast<float>(scale * magnitude);
  }
  return out;
}

double noise_rms(std::span<const float> magnitudes) {
  assert(magnitudes.size() >= 2);
  double sum = 0;
  for (std::size_t k = 0; k < magnitudes.size(); ++k) {
    const double weight = k == 0 || k + 1 == magnitudes.size() ? 0.5 : 1.0;
    sum += weight * magnitudes[k] * magnitudes[k];
  }
  return std::sqrt(sum / static_cast<double>(magnitudes.size() - 1));
}

}  // namespace rustle::pack
