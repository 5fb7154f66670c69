#pragma once

#include <span>
#include <vector>

namespace rustle::pack {

/// Magnitudes for another FFT size and rate, of the same sound: the power density per Hz is kept, so magnitudes grow by
/// √(to_rate / from_rate) (see Spectrum). Between bins magnitudes are interpolated linearly; into wider bins their mean
/// power is taken; above the source's Nyquist frequency there is nothing.
/// \pre magnitudes.size() ≥ 2, bins ≥ 2, rates > 0
std::vector<float> resampled_spectrum(std::span<const float> magnitudes, double from_rate_hz, int bins, double to_rate_hz);

/// RMS of noise with these magnitudes: √(mean of M² over the bins, the first and the last counted half).
double noise_rms(std::span<const float> magnitudes);

}  // namespace rustle::pack
