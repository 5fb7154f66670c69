#include "sound_db/dsp/unit_features.h"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <numbers>

namespace rustle::dsp {

namespace {

constexpr double kHighest_hz = 20000.0;
constexpr double kPowerFloor = 1e-10;

double mel(double frequency_hz) {
  return 2595.0 * std::log10(1.0 + frequency_hz / 700.0);
}

double from_mel(double value) {
  return 700.0 * (std::pow(10.0, value / 2595.0) - 1.0);
}

/// Orthonormal DCT-II of the bands' logarithms.
void cosine_transform(const std::array<double, kUnitFeatures>& logarithms, std::span<float> out) noexcept {
  static const auto matrix = [] {
    std::array<std::array<double, kUnitFeatures>, kUnitFeatures> m{};
    for (int c = 0; c < kUnitFeatures; ++c) {
      const double scale = std::sqrt((c == 0 ? 1.0 : 2.0) / kUnitFeatures);
      for (int b = 0; b < kUnitFeatures; ++b) m[c][b] = scale * std::cos(std::numbers::pi * c * (b + 0.5) / kUnitFeatures);
    }
    return m;
  }();
  for (std::size_t c = 0; c < matrix.size(); ++c) {
    double sum = 0;
    for (std::size_t b = 0; b < logarithms.size(); ++b) sum += matrix[c][b] * logarithms[b];
    out[c] = static_cast<float>(sum);
  }
}

/// Σ taps · past over those of the last taps.size() units that there are, oldest first; `at(age)` is the value so many units
/// before the present one, ages down to `newest_age` (negative: ahead).
template <class Value>
float weighted(std::span<const double> taps, std::ptrdiff_t newest_age, std::ptrdiff_t oldest_there,
               std::ptrdiff_t newest_there, const Value& at) noexcept {
  double sum = 0, weight = 0;
  const auto count = static_cast<std::ptrdiff_t>(taps.size());
  for (std::ptrdiff_t k = 0; k < count; ++k) {
    const std::ptrdiff_t age = newest_age + count - 1 - k;
    if (age > oldest_there || age < newest_there) continue;
    sum += taps[static_cast<std::size_t>(k)] * static_cast<double>(at(age));
    weight += taps[static_cast<std::size_t>(k)];
  }
  return static_cast<float>(sum / weight);
}

}  // namespace

int unit_length(double unit_s, double rate_hz) noexcept {
  return std::max(16, 2 * static_cast<int>(std::lround(unit_s * rate_hz / 2)));
}

UnitFeatures::UnitFeatures(int unit_samples, double rate_hz)
    : fft_(unit_samples), window_(static_cast<std::size_t>(unit_samples)) {
  const double size = unit_samples, step = rate_hz / size;
  double energy = 0;
  for (std::size_t n = 0; n < window_.size(); ++n) {
    const double w = 0.5 - 0.5 * std::cos(2 * std::numbers::pi * (static_cast<double>(n) + 0.5) / size);
    window_[n] = static_cast<float>(w);
    energy += w * w;
  }
  const double scale = 2.0 / (size * energy), top = mel(kHighest_hz);
  for (std::size_t b = 0; b < bands_.size(); ++b) {
    const double low_hz = from_mel(top * static_cast<double>(b) / kUnitFeatures);
    const double high_hz = from_mel(top * static_cast<double>(b + 1) / kUnitFeatures);
    for (int k = 0; k < fft_.bins(); ++k) {
      const double from = std::max(0.0, (k - 0.5) * step), to = std::min((k + 0.5) * step, rate_hz / 2);
      const double share = (std::min(to, high_hz) - std::max(from, low_hz)) / (to - from);
      if (share <= 0) continue;
      if (bands_[b].weights.empty()) bands_[b].first = static_cast<std::size_t>(k);
      bands_[b].weights.push_back(static_cast<float>(share * scale * (k == 0 ? 0.5 : 1.0)));
    }
  }
}

void UnitFeatures::operator()(std::span<const float> unit, std::span<float> features) noexcept {
  assert(unit.size() == window_.size() && features.size() == kUnitFeatures);
  const auto block = fft_.time();
  for (std::size_t n = 0; n < window_.size(); ++n) block[n] = unit[n] * window_[n];
  fft_.forward();
  const auto spectrum = fft_.spectrum();
  std::array<double, kUnitFeatures> logarithms{};
  for (std::size_t b = 0; b < bands_.size(); ++b) {
    const Band& band = bands_[b];
    double power = 0;
    for (std::size_t k = 0; k < band.weights.size(); ++k) {
      power += static_cast<double>(band.weights[k] * std::norm(spectrum[band.first + k]));
    }
    logarithms[b] = std::log(power + kPowerFloor);
  }
  cosine_transform(logarithms, features);
}

std::vector<float> unit_features(std::span<const float> signal, int unit_samples, double rate_hz) {
  const auto length = static_cast<std::size_t>(unit_samples), units = signal.size() / length;
  UnitFeatures features(unit_samples, rate_hz);
  std::vector<float> result(units * kUnitFeatures);
  for (std::size_t j = 0; j < units; ++j) {
    features(signal.subspan(j * length, length), std::span(result).subspan(j * kUnitFeatures, kUnitFeatures));
  }
  return result;
}

std::vector<double> gaussian_taps(int width, bool causal) {
  const int half = width / 2;
  const double sigma = width / 4.0;
  std::vector<double> taps;
  double sum = 0;
  for (int k = -half; k <= (causal ? 0 : half); ++k) {
    taps.push_back(std::exp(-0.5 * (k / sigma) * (k / sigma)));
    sum += taps.back();
  }
  for (double& t : taps) t /= sum;
  return taps;
}

std::vector<float> filtered_features(std::span<const float> features, int dims, std::span<const int> widths,
                                     std::span<const std::uint32_t> first_unit, bool causal) {
  const auto columns = static_cast<std::size_t>(dims);
  assert(!first_unit.empty() && features.size() == first_unit.back() * columns);
  std::vector<float> result(features.size());
  for (std::size_t d = 0; d < columns; ++d) {
    const int width = widths[d % widths.size()];
    const std::vector<double> taps = gaussian_taps(width, causal);
    const std::ptrdiff_t ahead = causal ? 0 : -(width / 2);
    for (std::size_t r = 0; r + 1 < first_unit.size(); ++r) {
      const auto first = static_cast<std::ptrdiff_t>(first_unit[r]), end = static_cast<std::ptrdiff_t>(first_unit[r + 1]);
      for (std::ptrdiff_t i = first; i < end; ++i) {
        const auto place = [&](std::ptrdiff_t unit) { return static_cast<std::size_t>(unit) * columns + d; };
        result[place(i)] =
            weighted(taps, ahead, i - first, i - (end - 1), [&](std::ptrdiff_t age) { return features[place(i - age)]; });
      }
    }
  }
  return result;
}

CausalFeatureFilter::CausalFeatureFilter(int dims, std::span<const int> widths) {
  for (int d = 0; d < dims; ++d) {
    taps_.push_back(gaussian_taps(widths[static_cast<std::size_t>(d) % widths.size()], true));
    depth_ = std::max(depth_, taps_.back().size());
  }
  past_.assign(depth_ * taps_.size(), 0.0F);
}

void CausalFeatureFilter::push(std::span<const float> features, std::span<float> filtered) noexcept {
  assert(features.size() == taps_.size() && filtered.size() == taps_.size());
  const std::size_t dims = taps_.size(), now = count_ % depth_;
  std::copy(features.begin(), features.end(), past_.begin() + static_cast<std::ptrdiff_t>(now * dims));
  const auto oldest = static_cast<std::ptrdiff_t>(std::min(count_, depth_ - 1));
  for (std::size_t d = 0; d < dims; ++d) {
    filtered[d] = weighted(taps_[d], 0, oldest, 0, [&](std::ptrdiff_t age) {
      return past_[(now + depth_ - static_cast<std::size_t>(age)) % depth_ * dims + d];
    });
  }
  ++count_;
}

}  // namespace rustle::dsp
