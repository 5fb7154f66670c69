#include "sound_db/pack/sweep_measure.h"

#include <cmath>
#include <complex>
#include <utility>

#include "sound_db/dsp/fft.h"
#include "sound_db/pack/spectra.h"

namespace rustle::pack {

SweepMeasure::SweepMeasure(double rate_hz, std::vector<double> speeds_m_per_s)
    : rate_hz_(rate_hz), wanted_(std::move(speeds_m_per_s)), sums_(wanted_.size()) {
  const auto bins = static_cast<std::size_t>(friction_clip_length(rate_hz) / 2 + 1);
  for (Sum& sum : sums_) sum.power.assign(bins, 0.0);
}

int SweepMeasure::add(std::span<const float> signal, const std::function<double(double)>& speed_at, double tolerance,
                      const std::function<bool(std::size_t, std::size_t)>& usable) {
  const auto size = static_cast<std::size_t>(friction_clip_length(rate_hz_));
  dsp::RealFft fft(static_cast<int>(size));
  std::vector<float> window(size);
  double energy = 0;
  for (std::size_t n = 0; n < size; ++n) {
    const double half = static_cast<double>(size) / 2;
    const double w = 1 - std::abs((static_cast<double>(n) + 0.5) / half - 1);
    window[n] = static_cast<float>(w);
    energy += w * w;
  }
  int counted = 0;
  for (std::size_t at = 0; at + size <= signal.size(); at += size / 2) {
    const double speed = speed_at((static_cast<double>(at) + static_cast<double>(size) / 2) / rate_hz_);
    bool measured = false;
    for (std::size_t i = 0; i < wanted_.size(); ++i) {
      if (!(std::abs(speed / wanted_[i] - 1) < tolerance) || (usable && !usable(at, at + size))) continue;
      if (!measured) {
        for (std::size_t n = 0; n < size; ++n) fft.time()[n] = signal[at + n] * window[n];
        fft.forward();
      }
      measured = true;
      Sum& sum = sums_[i];
      for (std::size_t k = 0; k < sum.power.size(); ++k) {
        sum.power[k] += static_cast<double>(std::norm(fft.spectrum()[k])) / energy;
      }
      sum.speeds += speed;
      ++sum.clips;
    }
    counted += measured;
  }
  return counted;
}

FrictionSweep SweepMeasure::sweep(int least_clips) const {
  FrictionSweep result;
  result.fft_size = static_cast<std::uint32_t>(friction_clip_length(rate_hz_));
  for (const Sum& sum : sums_) {
    if (sum.clips < least_clips || sum.clips == 0) continue;
    const double speed = sum.speeds / sum.clips;
    if (!result.speeds_m_per_s.empty() && speed <= result.speeds_m_per_s.back()) continue;
    std::vector<float> magnitudes;
    for (const double power : sum.power) magnitudes.push_back(static_cast<float>(std::sqrt(power / sum.clips)));
    const double rms = noise_rms(magnitudes);
    if (!(rms > 0)) continue;
    result.speeds_m_per_s.push_back(speed);
    result.rms.push_back(rms);
    result.magnitudes.insert(result.magnitudes.end(), magnitudes.begin(), magnitudes.end());
  }
  return result;
}

std::vector<double> geometric_speeds(double slowest_m_per_s, double fastest_m_per_s, int count) {
  std::vector<double> speeds;
  for (int i = 0; i < count; ++i) {
    speeds.push_back(slowest_m_per_s * std::pow(fastest_m_per_s / slowest_m_per_s, i / (count - 1.0)));
  }
  return speeds;
}

}  // namespace rustle::pack
