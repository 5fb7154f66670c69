#pragma once

#include <algorithm>
#include <cmath>
#include <span>

/// Levels relative to full scale: 0 dBFS is a constant (RMS) or a sample (peak) of 1.
namespace rustle::dsp {

inline constexpr double kSilenceDb = -300.0;  ///< what an empty or all-zero signal reads

inline double gain_to_db(double gain) noexcept {
  return gain > 1e-15 ? 20.0 * std::log10(gain) : kSilenceDb;
}
inline double db_to_gain(double db) noexcept {
  return std::pow(10.0, db / 20.0);
}

inline double rms(std::span<const float> signal) noexcept {
  double sum = 0;
  for (const float x : signal) sum += static_cast<double>(x) * x;
  return signal.empty() ? 0.0 : std::sqrt(sum / static_cast<double>(signal.size()));
}

inline double peak(std::span<const float> signal) noexcept {
  float most = 0;
  for (const float x : signal) most = std::max(most, std::abs(x));
  return most;
}

inline double rms_dbfs(std::span<const float> signal) noexcept {
  return gain_to_db(rms(signal));
}
inline double peak_dbfs(std::span<const float> signal) noexcept {
  return gain_to_db(peak(signal));
}

}  // namespace rustle::dsp
