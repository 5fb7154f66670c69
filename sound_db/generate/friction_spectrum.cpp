#include "sound_db/generate/friction_spectrum.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "sound_db/pack/levels.h"

namespace rustle::generate {

namespace {

constexpr double kHighPass_hz = 250.0;
constexpr double kFloor = 0.05, kFullHiss_hz = 3000.0;
constexpr double kLowestCorner_hz = 1000.0;
constexpr double kBanding_db = 3.0, kBandingLoss = 0.04;
constexpr double kFadeFrom_hz = 2500.0, kFadeTo_hz = 6000.0;
constexpr double kFlatCorner_hz = 14000.0;
constexpr double kFlatBelow_db = 11.0;
constexpr double kCentroidFrom_hz = 50.0, kCentroidTo_hz = 15000.0;
constexpr double kLevelFrom_hz = 100.0, kLevelTo_hz = 16000.0;

/// Values at x by straight lines through (grid, values), held beyond the ends.
double interpolated(const std::vector<double>& grid, const std::vector<double>& values, double x) {
  if (x <= grid.front()) return values.front();
  if (x >= grid.back()) return values.back();
  const auto k = static_cast<std::size_t>(std::upper_bound(grid.begin(), grid.end(), x) - grid.begin()) - 1;
  const double part = (x - grid[k]) / (grid[k + 1] - grid[k]);
  return values[k] + part * (values[k + 1] - values[k]);
}

/// The mean of levels over an octave around each frequency: Hann-weighted on an even grid of log₂ f.
std::vector<double> octave_mean(const std::vector<double>& octaves, const std::vector<double>& level_db) {
  constexpr int kGrid = 600, kHalf = 40;
  std::array<double, 2 * kHalf + 1> weights{};
  double sum = 0;
  for (int i = 0; i <= 2 * kHalf; ++i) sum += weights[i] = 1 - std::cos(2 * std::numbers::pi * (i + 1) / (2 * kHalf + 2));
  std::vector<double> grid(kGrid), even(kGrid), smooth(kGrid, 0.0), mean(octaves.size());
  for (int i = 0; i < kGrid; ++i) {
    grid[i] = octaves.front() + (octaves.back() - octaves.front()) * i / (kGrid - 1);
    even[i] = interpolated(octaves, level_db, grid[i]);
  }
  for (int i = 0; i < kGrid; ++i) {
    for (int j = -kHalf; j <= kHalf; ++j) smooth[i] += weights[j + kHalf] / sum * even[std::clamp(i + j, 0, kGrid - 1)];
  }
  for (std::size_t k = 0; k < octaves.size(); ++k) mean[k] = interpolated(grid, smooth, octaves[k]);
  return mean;
}

/// Resonance bands as factors: the modes' Lorentzian peaks of relative width η over their own octave mean, scaled to
/// 3 dB rms √(0.04 / η) (100 Hz to 3 kHz) and held within twice that, faded where modes overlap too much to be heard singly.
std::vector<double> banding(const std::vector<double>& frequencies_hz, const Paper& paper, const pack::GridPoint& point) {
  const auto modes_hz =
      strip_modes_hz(paper, point.ruling_length_m, point.free_border_length_m / 2, kFrictionCompression, 2 * kFadeTo_hz);
  std::vector<double> octaves(frequencies_hz.size()), level_db(frequencies_hz.size());
  for (std::size_t k = 0; k < frequencies_hz.size(); ++k) {
    const double f = frequencies_hz[k];
    double power = 0;
    for (const double mode : modes_hz) {
      const double width = paper.loss_factor * mode, off = f - mode;
      power += width / (off * off + width * width / 4);
    }
    octaves[k] = std::log2(f);
    level_db[k] = 10 * std::log10(power + 1e-9);
  }
  const auto mean_db = octave_mean(octaves, level_db);
  const double depth_db = kBanding_db * std::sqrt(kBandingLoss / paper.loss_factor), most_db = 2 * depth_db;
  double square = 0;
  int count = 0;
  for (std::size_t k = 0; k < level_db.size(); ++k) {
    level_db[k] = std::clamp(level_db[k] - mean_db[k], -most_db, most_db);
    if (frequencies_hz[k] <= 100 || frequencies_hz[k] >= 3000) continue;
    square += level_db[k] * level_db[k];
    ++count;
  }
  const double rms_db = count ? std::sqrt(square / count) : 0.0;
  std::vector<double> factors(level_db.size());
  for (std::size_t k = 0; k < level_db.size(); ++k) {
    const double fade = std::clamp(std::log(kFadeTo_hz / frequencies_hz[k]) / std::log(kFadeTo_hz / kFadeFrom_hz), 0.0, 1.0);
    const double scaled_db = std::clamp(level_db[k] * depth_db / std::max(1e-9, rms_db), -most_db, most_db);
    factors[k] = std::pow(10.0, fade * scaled_db / 20);
  }
  return factors;
}

double centroid_hz(const std::vector<double>& frequencies_hz, const std::vector<double>& magnitudes) {
  double weighted = 0, total = 0;
  for (std::size_t k = 0; k < magnitudes.size(); ++k) {
    if (frequencies_hz[k] < kCentroidFrom_hz || frequencies_hz[k] > kCentroidTo_hz) continue;
    weighted += frequencies_hz[k] * magnitudes[k];
    total += magnitudes[k];
  }
  return weighted / total;
}

/// Multiplies magnitudes by the power f^β that gives them this centroid.
void bring_to_centroid(const std::vector<double>& frequencies_hz, double wanted_hz, std::vector<double>& magnitudes) {
  double low = -0.5, high = 0.5;
  std::vector<double> leant(magnitudes.size());
  for (int i = 0; i < 40; ++i) {
    const double power = (low + high) / 2;
    for (std::size_t k = 0; k < leant.size(); ++k) leant[k] = magnitudes[k] * std::pow(frequencies_hz[k] / 1000, power);
    (centroid_hz(frequencies_hz, leant) > wanted_hz ? high : low) = power;
  }
  magnitudes = leant;
}

}  // namespace

double friction_corner_hz(const Paper& paper, const pack::GridPoint& point) {
  const double border = point.free_border_length_m / 0.2;
  const double law_hz = 6500.0 * std::pow(point.ruling_length_m / 0.1, -0.75) * std::pow((1 + border * border) / 2, -0.55);
  return brightness(paper) * std::hypot(law_hz, kLowestCorner_hz);
}

std::vector<float> friction_heard(const Paper& paper, const pack::GridPoint& point, int bins, double rate_hz) {
  // From the first bin on: nothing is heard at 0 Hz.
  std::vector<double> frequencies_hz, shape;
  for (int k = 1; k < bins; ++k) frequencies_hz.push_back(rate_hz / 2 * k / (bins - 1));
  const double corner_hz = point.constrained() ? brightness(paper) * kFlatCorner_hz : friction_corner_hz(paper, point);
  const double bright = brightness(paper);
  const double hiss = bright * kFloor * std::pow(std::min(1.0, corner_hz / (bright * kFullHiss_hz)), 0.2);
  std::vector<double> bands, smooth;
  if (!point.constrained()) bands = banding(frequencies_hz, paper, point);
  for (std::size_t k = 0; k < frequencies_hz.size(); ++k) {
    const double f = frequencies_hz[k], low = kHighPass_hz / f, high = f / corner_hz;
    const double high_pass = 1 / std::sqrt(1 + low * low);
    if (point.constrained()) {
      shape.push_back(high_pass / std::sqrt(1 + high * high));
    } else {
      smooth.push_back(high_pass * (1 / (1 + high * high) + hiss));
      shape.push_back(high_pass * (bands[k] / (1 + high * high) + hiss));
    }
  }
  if (!point.constrained()) bring_to_centroid(frequencies_hz, centroid_hz(frequencies_hz, smooth), shape);
  double power = 0;
  int count = 0;
  for (std::size_t k = 0; k < shape.size(); ++k) {
    if (frequencies_hz[k] <= kLevelFrom_hz || frequencies_hz[k] >= kLevelTo_hz) continue;
    power += shape[k] * shape[k];
    ++count;
  }
  const double level = point.constrained() ? std::pow(10.0, -kFlatBelow_db / 20)
                                           : std::sqrt(point.disc_radius_m() / pack::kReferencePoint.disc_radius_m());
  const double gain = level / std::sqrt(power / std::max(1, count));
  std::vector<float> magnitudes(static_cast<std::size_t>(bins), 0.0f);
  for (std::size_t k = 0; k < shape.size(); ++k) magnitudes[k + 1] = static_cast<float>(gain * shape[k]);
  return magnitudes;
}

}  // namespace rustle::generate
