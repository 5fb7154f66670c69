#include "sound_db/build/friction_average.h"

#include <algorithm>
#include <cassert>
#include <cmath>

#include "sound_db/dsp/fft.h"
#include "sound_db/dsp/level.h"
#include "sound_db/dsp/window.h"

namespace rustle::build {

namespace {

constexpr double kSlowest = 0.05;      // of the fastest
constexpr double kThreshold_db = -20;  // of the loudest tenth
constexpr int kValuesPerBin = 64;

struct Block {
  std::size_t start;
  double mean_square, speed_power;  // (v/v0)^2e
};

}  // namespace

FrictionSum& FrictionSum::operator+=(const FrictionSum& other) {
  if (power.empty()) power.assign(other.power.size(), 0.0);
  assert(other.power.empty() || other.power.size() == power.size());
  for (std::size_t k = 0; k < other.power.size(); ++k) power[k] += other.power[k];
  weight += other.weight;
  blocks += other.blocks;
  return *this;
}

std::vector<float> mean_spectrum(const FrictionSum& sum) {
  assert(sum.blocks >= kLeastBlocks && sum.weight > 0);
  const auto bins = static_cast<int>(sum.power.size());
  const int half = std::min(bins / 8, (kValuesPerBin / sum.blocks) / 2);
  std::vector<float> magnitudes(sum.power.size());
  for (int k = 0; k < bins; ++k) {
    double power = 0;
    int count = 0;
    for (int j = std::max(0, k - half); j <= std::min(bins - 1, k + half); ++j, ++count)
      power += sum.power[static_cast<std::size_t>(j)];
    magnitudes[static_cast<std::size_t>(k)] = static_cast<float>(std::sqrt(power / count / sum.weight));
  }
  return magnitudes;
}

FrictionBlocks average_friction(const PreparedTake& prepared, const Take& take, const SpeedTrack& speed, int fft_size,
                                double reference_speed_m_per_s, double speed_exponent) {
  const auto size = static_cast<std::size_t>(fft_size), hop = size / 2;
  std::vector<float> window(size);
  dsp::sine_window(window);
  const std::span<const float> signal = prepared.samples;
  const double hop_s = static_cast<double>(hop) / prepared.rate_hz, fastest = speed.fastest_m_per_s();

  FrictionBlocks result;
  std::vector<Block> blocks;
  for (std::size_t start = 0; start + size <= signal.size(); start += hop) {
    const double centre_s = prepared.from_s + static_cast<double>(start + hop) / prepared.rate_hz;
    const double v = speed.at(centre_s);
    if (is_clipped(prepared, start, start + size)) {
      result.clipped_s += hop_s;
    } else if (v <= 0 || v < kSlowest * fastest) {
      result.slow_s += hop_s;
    } else {
      double energy = 0;  // Σ w² = N/2
      for (std::size_t n = 0; n < size; ++n) {
        const double x = static_cast<double>(window[n]) * signal[start + n];
        energy += x * x;
      }
      blocks.push_back(
          {start, energy / static_cast<double>(hop), std::pow(v / reference_speed_m_per_s, 2 * speed_exponent)});
    }
  }
  if (blocks.empty()) return result;
  std::vector<double> levels;
  for (const Block& block : blocks) levels.push_back(block.mean_square / block.speed_power);
  const auto tenth = levels.begin() + static_cast<std::ptrdiff_t>(levels.size() * 9 / 10);
  std::nth_element(levels.begin(), tenth, levels.end());
  const double threshold = *tenth * std::pow(10.0, take.threshold_db.value_or(kThreshold_db) / 10);
  result.threshold_dbfs = threshold > 0 ? 10 * std::log10(threshold) : dsp::kSilenceDb;

  dsp::RealFft fft(fft_size);
  result.sum.power.assign(static_cast<std::size_t>(fft.bins()), 0.0);
  double energy = 0;
  for (const Block& block : blocks) {
    if (!(block.mean_square > 0) || block.mean_square / block.speed_power < threshold) {
      result.quiet_s += hop_s;
      continue;
    }
    for (std::size_t n = 0; n < size; ++n) fft.time()[n] = window[n] * signal[block.start + n];
    fft.forward();
    for (std::size_t k = 0; k < result.sum.power.size(); ++k)
      result.sum.power[k] += std::norm(std::complex<double>(fft.spectrum()[k])) / static_cast<double>(hop);
    result.sum.weight += block.speed_power;
    const double start_s = prepared.from_s + static_cast<double>(block.start) / prepared.rate_hz;
    if (result.sum.blocks++ == 0) result.from_s = start_s;
    result.to_s = start_s + 2 * hop_s;
    result.kept_s += hop_s;
    energy += block.mean_square;
  }
  if (result.sum.blocks > 0) result.level_dbfs = 10 * std::log10(energy / result.sum.blocks);
  return result;
}

}  // namespace rustle::build
