#include "sound_db/dsp/stft.h"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <cstdint>

#include "sound_db/dsp/fft.h"
#include "sound_db/dsp/window.h"

namespace rustle::dsp {

Spectrogram power_spectrogram(std::span<const float> signal, double rate_hz, int fft_size, int hop, double floor_db) {
  assert(hop >= 1 && rate_hz > 0);
  RealFft fft(fft_size);
  std::vector<float> window(static_cast<std::size_t>(fft_size));
  hann_window(window);
  Spectrogram result;
  result.bins = fft.bins();
  result.frames = static_cast<int>(signal.size() / static_cast<std::size_t>(hop)) + 1;
  result.hop_s = hop / rate_hz;
  result.bin_hz = rate_hz / fft_size;
  result.power_db.resize(static_cast<std::size_t>(result.frames) * static_cast<std::size_t>(result.bins));
  // A sine of amplitude 1 gives |X| = Σw / 2 = N / 4.
  const double scale = 16.0 / (static_cast<double>(fft_size) * fft_size);
  const double floor_power = std::pow(10.0, floor_db / 10.0);
  const auto samples = static_cast<std::int64_t>(signal.size());
  for (int frame = 0; frame < result.frames; ++frame) {
    const std::int64_t start = static_cast<std::int64_t>(frame) * hop - fft_size / 2;
    const auto block = fft.time();
    for (int n = 0; n < fft_size; ++n) {
      const std::int64_t at = start + n;
      block[n] = at >= 0 && at < samples ? signal[static_cast<std::size_t>(at)] * window[n] : 0.0f;
    }
    fft.forward();
    float* row = &result.power_db[static_cast<std::size_t>(frame) * static_cast<std::size_t>(result.bins)];
    for (int k = 0; k < result.bins; ++k) {
      const double power = scale * std::norm(fft.spectrum()[k]);
      row[k] = static_cast<float>(10.0 * std::log10(std::max(power, floor_power)));
    }
  }
  return result;
}

}  // namespace rustle::dsp
