#include "server/comparison/sound_difference.h"

#include <algorithm>
#include <cassert>
#include <cmath>

#include "sound_db/dsp/features.h"
#include "sound_db/dsp/level.h"
#include "sound_db/dsp/stft.h"

namespace rustle::comparison {
namespace {

constexpr double kHeard_db = 60, kBandsHeard_db = 40, kSilent_db = -140;
constexpr int kFftSize = 4096;

std::vector<double> level_track(std::span<const float> sound, std::size_t window, std::size_t windows) {
  std::vector<double> out(windows, kSilent_db);
  for (std::size_t k = 0; k < windows && k * window < sound.size(); ++k) {
    const auto part = sound.subspan(k * window, std::min(window, sound.size() - k * window));
    out[k] = std::max(kSilent_db, dsp::rms_dbfs(part));
  }
  return out;
}

/// Mean power of each bin over the sound's duration.
std::vector<double> mean_power(std::span<const float> sound, double rate_hz) {
  const auto spectrogram = dsp::power_spectrogram(sound, rate_hz, kFftSize, kFftSize / 2);
  std::vector<double> out(static_cast<std::size_t>(spectrogram.bins), 0.0);
  for (int m = 0; m < spectrogram.frames; ++m) {
    for (int b = 0; b < spectrogram.bins; ++b) {
      out[static_cast<std::size_t>(b)] += std::pow(10, spectrogram.at(m, b) / 10.0) / spectrogram.frames;
    }
  }
  return out;
}

double band_db(const std::vector<double>& power, double bin_hz, double low_hz, double high_hz) {
  double sum = 0;
  for (std::size_t b = 0; b < power.size(); ++b) {
    // A bin counts by the share of it that lies in the band: low bands are narrower than a bin.
    const double from = (static_cast<double>(b) - 0.5) * bin_hz, to = from + bin_hz;
    sum += power[b] * std::max(0.0, std::min(to, high_hz) - std::max(from, low_hz)) / bin_hz;
  }
  return std::max(kSilent_db, 10 * std::log10(sum + 1e-30));
}

/// Pearson's correlation; 1 where neither varies, 0 where only one does.
double correlation(const std::vector<double>& a, const std::vector<double>& b) {
  double mean_a = 0, mean_b = 0, aa = 0, bb = 0, ab = 0;
  const auto count = static_cast<double>(a.size());
  for (std::size_t k = 0; k < a.size(); ++k) mean_a += a[k] / count, mean_b += b[k] / count;
  for (std::size_t k = 0; k < a.size(); ++k) {
    aa += (a[k] - mean_a) * (a[k] - mean_a), bb += (b[k] - mean_b) * (b[k] - mean_b);
    ab += (a[k] - mean_a) * (b[k] - mean_b);
  }
  if (aa < 1e-9 && bb < 1e-9) return 1;
  return aa < 1e-9 || bb < 1e-9 ? 0 : ab / std::sqrt(aa * bb);
}

void compare_levels(std::span<const float> reference, std::span<const float> other, double rate_hz, SoundDifference& out) {
  const auto window = std::max<std::size_t>(1, static_cast<std::size_t>(std::llround(out.window_s * rate_hz)));
  const std::size_t windows = (std::max(reference.size(), other.size()) + window - 1) / window;
  out.reference_track_db = level_track(reference, window, windows);
  out.other_track_db = level_track(other, window, windows);
  double loudest = kSilent_db;
  for (const auto* track : {&out.reference_track_db, &out.other_track_db}) {
    for (const double level : *track) loudest = std::max(loudest, level);
  }
  const double floor = std::max(kSilent_db, loudest - kHeard_db);
  std::vector<double> a, b;
  for (std::size_t k = 0; k < windows; ++k) {
    if (std::max(out.reference_track_db[k], out.other_track_db[k]) <= floor) continue;
    a.push_back(std::max(floor, out.reference_track_db[k]));
    b.push_back(std::max(floor, out.other_track_db[k]));
    out.mean_level_difference_db += std::abs(a.back() - b.back());
  }
  if (a.empty()) return;
  out.mean_level_difference_db /= static_cast<double>(a.size());
  out.level_correlation = correlation(a, b);
}

void compare_spectra(std::span<const float> reference, std::span<const float> other, double rate_hz, SoundDifference& out) {
  const auto powers = mean_power(reference, rate_hz), other_powers = mean_power(other, rate_hz);
  const double bin_hz = rate_hz / kFftSize;
  double loudest = kSilent_db;
  for (int third = -13; third <= 12; ++third) {
    const double centre_hz = 1000 * std::pow(2, third / 3.0), half = std::pow(2, 1.0 / 6);
    if (centre_hz * half > rate_hz / 2) break;
    out.bands.push_back({centre_hz, band_db(powers, bin_hz, centre_hz / half, centre_hz * half),
                         band_db(other_powers, bin_hz, centre_hz / half, centre_hz * half)});
    loudest = std::max({loudest, out.bands.back().reference_db, out.bands.back().other_db});
  }
  const double raised_db = out.other_db - out.reference_db;
  double heard = 0;
  for (const BandLevels& band : out.bands) {
    if (loudest <= kSilent_db || std::max(band.reference_db, band.other_db) < loudest - kBandsHeard_db) continue;
    out.mean_band_difference_db += std::abs(band.other_db - band.reference_db - raised_db);
    heard += 1;
  }
  if (heard > 0) out.mean_band_difference_db /= heard;
}

}  // namespace

SoundDifference compare_sounds(std::span<const float> reference, std::span<const float> other, double rate_hz) {
  assert(rate_hz > 0);
  SoundDifference out;
  out.identical = std::equal(reference.begin(), reference.end(), other.begin(), other.end());
  out.reference_db = std::max(kSilent_db, dsp::rms_dbfs(reference));
  out.other_db = std::max(kSilent_db, dsp::rms_dbfs(other));
  out.reference_centroid_hz = dsp::sound_features(reference, rate_hz).centroid_hz;
  out.other_centroid_hz = dsp::sound_features(other, rate_hz).centroid_hz;
  compare_levels(reference, other, rate_hz, out);
  compare_spectra(reference, other, rate_hz, out);
  return out;
}

}  // namespace rustle::comparison
