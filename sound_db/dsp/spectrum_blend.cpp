#include "sound_db/dsp/spectrum_blend.h"

#include <algorithm>
#include <cassert>
#include <iterator>

namespace rustle::dsp {

namespace {

constexpr double kFloor = 1e-9;

/// Lower edge of bin k of K + 1, in bins; edge K + 1 is the upper one of the last.
double edge(std::size_t k, std::size_t bins) noexcept {
  return k == 0 ? 0.0 : k >= bins ? static_cast<double>(bins - 1) : static_cast<double>(k) - 0.5;
}

/// Mass below each edge, [bins + 1], strictly rising from 0 to 1.
std::vector<double> cumulative(std::span<const float> magnitudes) {
  const std::size_t bins = magnitudes.size();
  const double span = static_cast<double>(bins - 1);
  double total = 0;
  for (std::size_t k = 0; k < bins; ++k) total += static_cast<double>(magnitudes[k]) * (edge(k + 1, bins) - edge(k, bins));
  std::vector<double> mass(bins + 1);
  for (std::size_t k = 0; k < bins; ++k) {
    const double width = edge(k + 1, bins) - edge(k, bins);
    mass[k + 1] = mass[k] + static_cast<double>(magnitudes[k]) * width + kFloor * total * width / span;
  }
  const double all = mass.back() > 0 ? mass.back() : 1.0;
  for (double& m : mass) m /= all;
  return mass;
}

/// Edge at which the cumulative mass is reached, walking on from segment `k`.
double inverse(const std::vector<double>& mass, double wanted, std::size_t bins, std::size_t& k) {
  while (k + 2 < mass.size() && mass[k + 1] < wanted) ++k;
  const double low = edge(k, bins), high = edge(k + 1, bins), rise = mass[k + 1] - mass[k];
  return rise > 0 ? low + std::clamp((wanted - mass[k]) / rise, 0.0, 1.0) * (high - low) : low;
}

}  // namespace

SpectrumBlend::SpectrumBlend(std::span<const float> from, std::span<const float> to) : bins_(from.size()) {
  assert(from.size() == to.size() && from.size() >= 2);
  const std::vector<double> from_mass = cumulative(from), to_mass = cumulative(to);
  std::vector<double> all;
  std::set_union(from_mass.begin(), from_mass.end(), to_mass.begin(), to_mass.end(), std::back_inserter(all));
  std::size_t i = 0, j = 0;
  for (const double mass : all)
    knots_.push_back({mass, inverse(from_mass, mass, bins_, i), inverse(to_mass, mass, bins_, j)});
}

void SpectrumBlend::at(double alpha, std::span<float> out) const noexcept {
  assert(out.size() == bins_);
  std::size_t knot = 0;
  double below = 0;
  for (std::size_t k = 0; k < bins_; ++k) {
    const double low = edge(k, bins_), high = edge(k + 1, bins_);
    const auto frequency = [&](std::size_t n) { return (1 - alpha) * knots_[n].from + alpha * knots_[n].to; };
    while (knot + 2 < knots_.size() && frequency(knot + 1) < high) ++knot;
    const double f0 = frequency(knot), f1 = frequency(knot + 1);
    const double part = f1 > f0 ? std::clamp((high - f0) / (f1 - f0), 0.0, 1.0) : 1.0;
    const double above = k + 1 == bins_ ? 1.0 : knots_[knot].mass + part * (knots_[knot + 1].mass - knots_[knot].mass);
    out[k] = static_cast<float>((above - below) / (high - low));
    below = above;
  }
}

}  // namespace rustle::dsp
