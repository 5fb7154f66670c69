#include "server/synthesis/cloth/friction_powers.h"

#include <algorithm>
#include <cassert>
#include <cmath>

namespace rustle::cloth {
namespace {

constexpr double kSlowest = 0.05;  ///< of the slowest measured speed: -52 dB against it

}  // namespace

FrictionPowers::FrictionPowers(const pack::FrictionSweep& sweep)
    : bins_(sweep.bins()), compression_(sweep.compression), slowest_(kSlowest * sweep.speeds_m_per_s.front()) {
  const double fastest = sweep.speeds_m_per_s.back();
  octave_rows_ = (kRows - 2) / std::log2(fastest / slowest_);
  const pack::FrictionSpectra spectra(sweep);
  powers_.resize(kRows * bins_);
  for (std::size_t row = 0; row < kRows; ++row) {
    const double speed = row == 0           ? 0
                         : row + 1 == kRows ? fastest
                                            : slowest_ * std::exp2(static_cast<double>(row - 1) / octave_rows_);
    speeds_m_per_s_.push_back(speed);
    const auto power = std::span(powers_).subspan(row * bins_, bins_);
    if (speed > 0) spectra.at(speed, power);
    for (float& p : power) p *= p;
  }
}

void FrictionPowers::weigh(double speed_m_per_s, double weight, std::span<double> row_weights) const noexcept {
  assert(row_weights.size() == rows());
  speed_m_per_s = compression_(speed_m_per_s);
  if (!(speed_m_per_s > 0)) return;
  const double last = static_cast<double>(kRows - 1);
  std::size_t row = 0;
  if (speed_m_per_s >= slowest_) {
    const double at = 1 + octave_rows_ * std::log2(speed_m_per_s / slowest_);
    row = static_cast<std::size_t>(std::min(at, last - 1));
    // The logarithm may round across a row.
    if (speed_m_per_s < speeds_m_per_s_[row] && row > 1) --row;
  }
  const double low = speeds_m_per_s_[row], high = speeds_m_per_s_[row + 1];
  const double part = std::clamp((speed_m_per_s - low) / (high - low), 0.0, 1.0);
  row_weights[row] += (1 - part) * weight;
  row_weights[row + 1] += part * weight;
}

void FrictionPowers::sum(std::span<const double> row_weights, std::span<float> power) const noexcept {
  assert(row_weights.size() == rows() && power.size() == bins_);
  std::ranges::fill(power, 0.0F);
  for (std::size_t row = 1; row < rows(); ++row) {
    if (row_weights[row] == 0) continue;
    const auto weight = static_cast<float>(row_weights[row]);
    const float* from = powers_.data() + row * bins_;
    for (std::size_t k = 0; k < bins_; ++k) power[k] += weight * from[k];
  }
}

}  // namespace rustle::cloth
