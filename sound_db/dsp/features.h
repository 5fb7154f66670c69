#pragma once

#include <span>

#include "sound_db/dsp/mfcc.h"

/// What recordings and synthesized sounds are compared by, class by class.
namespace rustle::dsp {

/// Part of the signal from the first to the last block of `window_s` whose energy lies within `below_peak_db` of the
/// loudest; empty for silence.
std::span<const float> without_silence(std::span<const float> signal, double rate_hz, double below_peak_db = 40,
                                       double window_s = 0.005);

/// Standard deviation of frequency weighted by magnitude between low_hz and high_hz, about its mean; 0 for silence.
double spectral_bandwidth_hz(std::span<const float> magnitudes, double rate_hz, double low_hz = 50, double high_hz = 15000);

/// Time from the start of the loudest block of `window_s` to the end of the last one within `drop_db` of it.
double decay_time_s(std::span<const float> signal, double rate_hz, double drop_db = 30, double window_s = 0.005);

struct SoundFeatures {
  double centroid_hz = 0;   ///< of the mean magnitude spectrum (Hann, 1024, hop 256), 50 Hz to 15 kHz
  double bandwidth_hz = 0;  ///< of the same
  double decay_s = 0;       ///< decay_time_s over 30 dB
  double kurtosis = 0;
  MeanMfcc mfcc{};
};

/// Of a sound without the silence around it. All zeros for silence. Costs less than 5 ms per second of sound. Allocates;
/// any thread.
SoundFeatures sound_features(std::span<const float> signal, double rate_hz);

}  // namespace rustle::dsp
