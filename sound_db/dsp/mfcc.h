#pragma once

#include <array>
#include <span>
#include <vector>

namespace rustle::dsp {

/// Mel-frequency cepstral coefficients: Hann blocks of the power spectrum through triangular bands evenly spaced in
/// mel(f) = 2595 log10(1 + f/700), ln(energy + 1e-10), orthonormal DCT-II.
struct MfccOptions {
  int coefficients = 13;
  int bands = 26;
  int fft_size = 1024;
  int hop = 512;
  double low_hz = 50;
  double high_hz = 15000;  ///< at most half the rate is used
};

/// [frames][coefficients]; coefficient 0 is level.
struct Mfcc {
  int frames = 0;
  int coefficients = 0;
  std::vector<float> values;
  std::span<const float> frame(int index) const {
    const auto width = static_cast<std::size_t>(coefficients);
    return {values.data() + static_cast<std::size_t>(index) * width, width};
  }
};

/// One frame per hop that fits; a signal shorter than a block is padded with zeros. Allocates; any thread.
/// \pre 1 ≤ coefficients ≤ bands, fft_size even, hop ≥ 1, low_hz < rate_hz / 2
Mfcc mfcc(std::span<const float> signal, double rate_hz, const MfccOptions& options = {});

inline constexpr int kMeanMfccCoefficients = 13;
using MeanMfcc = std::array<double, kMeanMfccCoefficients>;

/// What a sound's colour is compared by: the signal brought to an RMS of 0.1, bands up to 11 kHz (where recordings differ
/// least by their equipment), mean of the frames whose level lies within 30 dB of the loudest. All zeros for silence.
MeanMfcc mean_mfcc(std::span<const float> signal, double rate_hz);

/// Euclidean distance without coefficient 0.
double mfcc_distance(const MeanMfcc& a, const MeanMfcc& b);

}  // namespace rustle::dsp
