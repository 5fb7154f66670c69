#pragma once

#include <span>
#include <vector>

#include "server/report/plot.h"

/// Measures of sounds that several groups share. Pure.
namespace rustle::validation {

/// Mean magnitude spectrum (Hann, 2048 samples) without the first and last `skip_s`.
std::vector<float> spectrum_of(std::span<const float> samples, double skip_s = 0.25);

/// Table 1's distance between two mean magnitude spectra (P12).
double distance(std::span<const float> spectrum_a, std::span<const float> spectrum_b);

double centroid_hz(std::span<const float> spectrum);

/// Mean power density of a signal by Hann blocks of `size`, half overlapped: size / 2 + 1 bins, white noise of variance 1
/// has 1 in every bin.
std::vector<double> power_density(std::span<const float> samples, int size);

/// Power between two frequencies of a density from 0 to Nyquist.
double band_power(std::span<const double> density, double from_hz, double to_hz);

/// Level in dB over frequency by third octaves' halves, 0 dB the loudest, for a plot.
std::vector<report::Point> smoothed_db(std::span<const float> spectrum, double from_hz = 100, double to_hz = 20000);

/// T60 of a decaying sound from the line through its backward-integrated energy between -5 and -25 dB after the loudest
/// 2 ms; NaN when it does not fall that far.
double t60_s(std::span<const float> samples);

/// The same, of the band around a frequency.
double band_t60_s(std::span<const float> samples, double low_hz, double high_hz);

/// Middle of the last window of 5 ms within 30 dB of the loudest one, after the loudest one.
double last_within_30_db_s(std::span<const float> samples);

/// Exponent of p(v) ∝ v^-a on [low, high] by maximum likelihood, both ends truncated; values outside are left out.
struct PowerLaw {
  double exponent = 0;
  int count = 0;
};
PowerLaw fitted_power_law(std::span<const double> values, double low, double high);

/// Rank correlation, -1 to 1. \pre x.size() == y.size()
double rank_correlation(std::span<const double> x, std::span<const double> y);

}  // namespace rustle::validation
