#include "server/spatial/hrtf_level.h"

#include <algorithm>
#include <cmath>
#include <complex>
#include <numbers>

namespace rustle::spatial {
namespace {

constexpr int kFrequencies = 200;
constexpr double kLowest_hz = 100, kHighest_hz = 16000;

double power(std::span<const float> filter, double radians_per_sample) {
  std::complex<double> sum = 0;
  for (std::size_t n = 0; n < filter.size(); ++n) {
    sum += static_cast<double>(filter[n]) * std::polar(1.0, -radians_per_sample * static_cast<double>(n));
  }
  return std::norm(sum);
}

}  // namespace

void level_ahead(double rate_hz, std::span<Hrtf::Response> responses) {
  const std::size_t ahead = static_cast<std::size_t>(Hrtf::kElevations / 2) * Hrtf::kAzimuths;
  const double top_hz = std::min(kHighest_hz, 0.45 * rate_hz);
  double sum = 0;
  for (int k = 0; k < kFrequencies; ++k) {
    const double f_hz = kLowest_hz * std::pow(top_hz / kLowest_hz, (k + 0.5) / kFrequencies);
    const double w = 2 * std::numbers::pi * f_hz / rate_hz;
    sum += power(responses[2 * ahead].filter, w) + power(responses[2 * ahead + 1].filter, w);
  }
  const auto gain = static_cast<float>(std::sqrt(2 * kFrequencies / std::max(sum, 1e-30)));
  for (Hrtf::Response& response : responses) {
    for (float& x : response.filter) x *= gain;
  }
}

}  // namespace rustle::spatial
