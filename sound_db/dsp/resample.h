#pragma once

#include <span>
#include <vector>

namespace rustle::dsp {

/// Band-limited change of rate of a whole clip (libsamplerate's sinc, its delay removed). The result has
/// round(N to_hz / from_hz) samples. The spectrum is kept up to 0.96 of the new Nyquist frequency going down and 0.90 of the
/// old one going up, where the longer filter would cost three times as much for what nobody hears.
/// Allocates; control side.
/// \pre rates are positive and within a factor of 256 of each other
std::vector<float> resample(std::span<const float> clip, double from_hz, double to_hz);

}  // namespace rustle::dsp
