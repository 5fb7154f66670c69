#include "server/synthesis/stick_slip.h"

#include <algorithm>
#include <cmath>
#include <complex>
#include <numbers>

#include "sound_db/dsp/fft.h"
#include "sound_db/dsp/random.h"

namespace rustle::synthesis {
namespace {

constexpr double kLeastGap_s = 0.004, kMostGap_s = 0.016;
constexpr double kFirstGain = 2.0, kGainDecay_s = 0.020;
constexpr double kAttack_s = 0.0002;

}  // namespace

std::vector<Slip> slips(std::uint64_t seed, double rate_hz) {
  dsp::Random random(seed);
  std::vector<Slip> out;
  for (double t_s = 0; t_s < kSlipsLast_s; t_s += random.log_uniform(kLeastGap_s, kMostGap_s)) {
    out.push_back({std::llround(t_s * rate_hz), kFirstGain * std::exp(-t_s / kGainDecay_s)});
  }
  return out;
}

std::vector<float> slip_unit(const std::vector<float>& emission, double rate_hz, std::uint64_t seed) {
  const int size = 2 * (static_cast<int>(emission.size()) - 1);
  dsp::RealFft fft(size);
  dsp::Random random(seed);
  const double scale = std::sqrt(static_cast<double>(size));
  for (std::size_t k = 1; k + 1 < emission.size(); ++k) {
    fft.spectrum()[k] = std::polar(scale * static_cast<double>(emission[k]), 2 * std::numbers::pi * random.uniform());
  }
  fft.spectrum().front() = fft.spectrum().back() = 0;
  fft.inverse();
  const auto count = std::min(fft.time().size(), static_cast<std::size_t>(kSlip_s * rate_hz));
  std::vector<float> out(count);
  for (std::size_t n = 0; n < count; ++n) {
    const double t_s = (static_cast<double>(n) + 0.5) / rate_hz,
                 left = 1 - (static_cast<double>(n) + 0.5) / static_cast<double>(count);
    const double envelope = std::min(1.0, t_s / kAttack_s) * std::exp(-t_s / kSlipDecay_s) * std::min(1.0, 8 * left);
    out[n] = static_cast<float>(envelope) * fft.time()[n];
  }
  return out;
}

}  // namespace rustle::synthesis
