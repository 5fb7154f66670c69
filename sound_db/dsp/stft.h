#pragma once

#include <span>
#include <vector>

namespace rustle::dsp {

/// Power over time and frequency, for pictures and for tests.
struct Spectrogram {
  int bins = 0;
  int frames = 0;
  double hop_s = 0;  ///< frame m is centred on m * hop_s
  double bin_hz = 0;
  std::vector<float> power_db;  ///< [frames][bins]; a full-scale sine on a bin's centre reads 0 dB
  float at(int frame, int bin) const { return power_db[static_cast<std::size_t>(frame) * bins + bin]; }
};

/// Short-time Fourier transform with a Hann window, zero outside the signal; frames 0 .. ⌊samples / hop⌋.
/// Allocates; control side.
/// \pre fft_size even, hop ≥ 1, rate_hz > 0
Spectrogram power_spectrogram(std::span<const float> signal, double rate_hz, int fft_size, int hop,
                              double floor_db = -140.0);

}  // namespace rustle::dsp
