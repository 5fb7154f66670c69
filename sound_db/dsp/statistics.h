#pragma once

#include <span>
#include <vector>

/// What two sounds are compared by (P12).
namespace rustle::dsp {

/// Mean over Hann blocks of the magnitude spectrum, fft_size / 2 + 1 bins; a shorter signal is padded with zeros.
std::vector<float> mean_magnitude(std::span<const float> signal, int fft_size = 2048, int hop = 1024);

/// Magnitudes from 0 Hz to Nyquist as a histogram of `bins` equal bins (areas kept), normalised to sum 1.
/// All zeros give a flat histogram.
std::vector<double> spectrum_histogram(std::span<const float> magnitudes, int bins = 256);

/// √((p-q)ᵀ A (p-q)), A_ij = 1 - |i-j| / (N-1): the distance of Schreck et al. 2016, Table 1 (P12). For histograms of equal
/// sum it is √(2/(N-1) Σ_k (P_k-Q_k)²) with the cumulative sums P and Q, which is how it is computed.
/// \pre p.size() == q.size() ≥ 2, Σp == Σq
double quadratic_form_distance(std::span<const double> p, std::span<const double> q);

/// The same between the mean magnitude spectra of two signals of the same rate.
double spectrum_distance(std::span<const float> a, std::span<const float> b);

/// Mean frequency weighted by magnitude between low_hz and high_hz; 0 for silence.
double spectral_centroid_hz(std::span<const float> magnitudes, double rate_hz, double low_hz = 50, double high_hz = 15000);

/// Fourth central moment over the squared variance: 3 for Gaussian noise; 0 for a constant.
double kurtosis(std::span<const float> signal);

}  // namespace rustle::dsp
