#include "sound_db/pack/emission.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "sound_db/pack/bent_strip.h"
#include "sound_db/pack/spectra.h"

namespace rustle::pack {

namespace {

constexpr double kLeastShare = 0.3;
constexpr int kGridBins = 513;
constexpr double kGridTop_hz = 24000.0;

double radians(double degrees) {
  return degrees * std::numbers::pi / 180.0;
}

double direct_gain(const RecordingGeometry& geometry) {
  return std::max(0.1, std::sin(radians(geometry.elevation_deg))) / geometry.distance_m;
}

}  // namespace

double transfer_magnitude(const DipoleOverPlane& dipole, double frequency_hz) noexcept {
  const double h = std::max(dipole.height_m, kLeastImageHeight_m);
  const double along = dipole.listener_distance_m * std::cos(radians(dipole.listener_elevation_deg));
  const double up = dipole.listener_distance_m * std::sin(radians(dipole.listener_elevation_deg));
  const double direct_m = std::hypot(along, up - h), image_m = std::hypot(along, up + h);
  const double direct = (up - h) / (direct_m * direct_m), image = -(up + h) / (image_m * image_m);
  const double delay_s = (image_m - direct_m) / kSoundSpeed_m_per_s;
  const double delay_per_m = ((up + h) / image_m + (up - h) / direct_m) / kSoundSpeed_m_per_s;
  const double w = 2 * std::numbers::pi * frequency_hz, blur = w * dipole.height_spread_m * delay_per_m;
  return std::sqrt(std::max(
      0.0, direct * direct + image * image + 2 * direct * image * std::cos(w * delay_s) * std::exp(-0.5 * blur * blur)));
}

std::vector<double> reference_transfer(const RecordingGeometry& geometry, const GridPoint& point,
                                       const std::vector<double>& frequencies_hz) {
  if (point.constrained() || !geometry.plane) return std::vector<double>(frequencies_hz.size(), direct_gain(geometry));
  const BentStrip strip = bent_strip(point.free_border_length_m / 2, geometry.compression);
  const DipoleOverPlane dipole{strip.mean_height_m, strip.height_spread_m, geometry.distance_m, geometry.elevation_deg};
  double power = 0;
  for (int k = 0; k < kGridBins; ++k) {
    const double h = transfer_magnitude(dipole, kGridTop_hz * k / (kGridBins - 1));
    power += h * h / kGridBins;
  }
  const double least = std::max(1e-6, kLeastShare * std::sqrt(power));
  std::vector<double> result(frequencies_hz.size());
  std::transform(frequencies_hz.begin(), frequencies_hz.end(), result.begin(),
                 [&](double f) { return std::max(least, transfer_magnitude(dipole, f)); });
  return result;
}

std::vector<float> emission_spectrum(const FrictionSection& section, const Spectrum& spectrum, int bins, double rate_hz) {
  std::vector<float> emission = resampled_spectrum(spectrum.magnitudes, section.rate_hz, bins, rate_hz);
  std::vector<double> frequencies_hz(emission.size());
  for (int k = 0; k < bins; ++k) frequencies_hz[static_cast<std::size_t>(k)] = rate_hz / 2 * k / (bins - 1);
  const std::vector<double> reference = reference_transfer(section.geometry, spectrum.point, frequencies_hz);
  for (std::size_t k = 0; k < emission.size(); ++k) emission[k] = static_cast<float>(emission[k] / reference[k]);
  return emission;
}

double emission_gain(const RecordingGeometry& geometry) noexcept {
  return 1.0 / direct_gain(geometry);
}

}  // namespace rustle::pack
