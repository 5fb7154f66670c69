#include "sound_db/pack/friction_sweep.h"

#include <algorithm>
#include <cassert>
#include <cmath>

#include "sound_db/pack/spectra.h"

namespace rustle::pack {

namespace {

/// The interval [speed i, speed i + 1) that holds a speed within the measured range, and where in it.
struct Place {
  std::size_t slower = 0;
  double alpha = 0;
};

Place place_of(const FrictionSweep& sweep, double speed_m_per_s) noexcept {
  const auto& speeds = sweep.speeds_m_per_s;
  const auto above = std::upper_bound(speeds.begin(), speeds.end(), speed_m_per_s);
  const auto slower = static_cast<std::size_t>(above - speeds.begin()) - 1;
  return {slower, (speed_m_per_s - speeds[slower]) / (speeds[slower + 1] - speeds[slower])};
}

}  // namespace

double SpeedCompression::operator()(double speed_m_per_s) const noexcept {
  if (!(speed_m_per_s > 0)) return 0;
  return *this == SpeedCompression{} ? speed_m_per_s : std::pow(speed_m_per_s / divisor, exponent);
}

int friction_clip_length(double rate_hz) noexcept {
  return 2 * static_cast<int>(std::lround(kFrictionClip_s * rate_hz / 2));
}

double friction_rms(const FrictionSweep& sweep, double speed_m_per_s) noexcept {
  const auto& speeds = sweep.speeds_m_per_s;
  if (!(speed_m_per_s > 0)) return 0;
  if (speed_m_per_s <= speeds.front()) return sweep.rms.front() * std::pow(speed_m_per_s / speeds.front(), 2);
  if (speed_m_per_s >= speeds.back()) return sweep.rms.back();
  const auto [slower, alpha] = place_of(sweep, speed_m_per_s);
  return (1 - alpha) * sweep.rms[slower] + alpha * sweep.rms[slower + 1];
}

FrictionSpectra::FrictionSpectra(const FrictionSweep& sweep) : sweep_(sweep) {
  for (std::size_t i = 0; i + 1 < sweep.speeds_m_per_s.size(); ++i)
    blends_.emplace_back(sweep.spectrum(i), sweep.spectrum(i + 1));
}

void FrictionSpectra::at(double speed_m_per_s, std::span<float> out) const noexcept {
  assert(out.size() == sweep_.bins());
  const auto& speeds = sweep_.speeds_m_per_s;
  double shape_rms = 0;
  if (!(speed_m_per_s > speeds.front()) || speed_m_per_s >= speeds.back()) {
    const std::size_t nearest = speed_m_per_s > speeds.front() ? speeds.size() - 1 : 0;
    const auto spectrum = sweep_.spectrum(nearest);
    std::copy(spectrum.begin(), spectrum.end(), out.begin());
    shape_rms = sweep_.rms[nearest];
  } else {
    const auto [slower, alpha] = place_of(sweep_, speed_m_per_s);
    blends_[slower].at(alpha, out);
    shape_rms = noise_rms(out);
  }
  const auto gain = static_cast<float>(shape_rms > 0 ? friction_rms(sweep_, speed_m_per_s) / shape_rms : 0.0);
  for (float& m : out) m *= gain;
}

}  // namespace rustle::pack
