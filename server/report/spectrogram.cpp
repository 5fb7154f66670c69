#include "server/report/spectrogram.h"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <complex>
#include <numeric>

#include "server/report/levels.h"
#include "sound_db/dsp/fft.h"
#include "sound_db/dsp/window.h"

namespace rustle::report {
namespace {

/// The power of every bin of windowed pieces of a sound; a sine of magnitude 1 on a bin's centre has power 1.
class ShortTimePower {
 public:
  explicit ShortTimePower(std::size_t size) : window_(size), transform_(static_cast<int>(size)) {
    dsp::hann_window(window_);
    const double sum = std::accumulate(window_.begin(), window_.end(), 0.0);
    scale_ = 4 / (sum * sum);
  }

  std::size_t bins() const { return window_.size() / 2 + 1; }

  /// Adds the power of one channel around frame `centre`, times `weight`.
  void add(const Sound& sound, std::size_t channel, std::int64_t centre, double weight, std::span<double> power) {
    const auto size = static_cast<std::int64_t>(window_.size());
    const auto frames = static_cast<std::int64_t>(sound.frames());
    const std::span<float> time = transform_.time();
    for (std::int64_t i = 0; i < size; ++i) {
      const std::int64_t at = centre - size / 2 + i;
      float x = 0;
      if (at >= 0 && at < frames) {
        x = sound.samples[static_cast<std::size_t>(at) * static_cast<std::size_t>(sound.channels) + channel];
      }
      time[static_cast<std::size_t>(i)] = std::isfinite(x) ? x * window_[static_cast<std::size_t>(i)] : 0.0f;
    }
    transform_.forward();
    const std::span<const std::complex<float>> spectrum = transform_.spectrum();
    for (std::size_t k = 0; k < power.size(); ++k)
      power[k] += weight * scale_ * std::norm(std::complex<double>(spectrum[k]));
  }

 private:
  std::vector<float> window_;
  dsp::RealFft transform_;
  double scale_ = 1;
};

double decibel(double power) {
  return std::max(kSilenceDb, 10 * std::log10(std::max(power, 1e-30)));
}

}  // namespace

double SpectrogramGrid::row_hz(double row) const {
  const double u = 1 - row / rows;
  return scale == FrequencyScale::kLinear ? lowest_hz + u * (highest_hz - lowest_hz)
                                          : lowest_hz * std::pow(highest_hz / lowest_hz, u);
}

SpectrogramGrid spectrogram_grid(const Sound& sound, int columns, int rows, FrequencyScale scale, double lowest_hz) {
  assert(columns >= 1 && rows >= 1);
  SpectrogramGrid grid;
  grid.columns = columns;
  grid.rows = rows;
  grid.start_s = sound.start_s;
  grid.end_s = sound.end_s();
  grid.highest_hz = std::max(2.0, sound.rate_hz / 2);
  grid.lowest_hz = scale == FrequencyScale::kLinear ? 0 : std::clamp(lowest_hz, 1.0, grid.highest_hz / 2);
  grid.scale = scale;
  grid.level_db.assign(static_cast<std::size_t>(columns) * static_cast<std::size_t>(rows), static_cast<float>(kSilenceDb));
  if (sound.frames() == 0 || sound.rate_hz <= 0) return grid;

  const double wanted = std::log2(std::max(64.0, 0.043 * sound.rate_hz));
  const std::size_t size = std::size_t{1} << static_cast<unsigned>(std::lround(wanted));
  ShortTimePower transform(size);
  const double bin_hz = sound.rate_hz / static_cast<double>(size);
  const double frames_per_column = static_cast<double>(sound.frames()) / columns;
  const int windows = std::max(1, static_cast<int>(std::ceil(frames_per_column / (static_cast<double>(size) / 4))));
  const auto channels = static_cast<std::size_t>(sound.channels);

  std::vector<double> power(transform.bins()), greatest(transform.bins());
  for (int column = 0; column < columns; ++column) {
    std::fill(greatest.begin(), greatest.end(), 0.0);
    for (int k = 0; k < windows; ++k) {
      const auto centre = static_cast<std::int64_t>((column + (k + 0.5) / windows) * frames_per_column);
      std::fill(power.begin(), power.end(), 0.0);
      for (std::size_t c = 0; c < channels; ++c) transform.add(sound, c, centre, 1.0 / static_cast<double>(channels), power);
      for (std::size_t b = 0; b < power.size(); ++b) greatest[b] = std::max(greatest[b], power[b]);
    }
    const auto last = static_cast<double>(greatest.size() - 1);
    for (int row = 0; row < rows; ++row) {
      const double centre = std::min(last, grid.row_hz(row + 0.5) / bin_hz);
      const auto below = static_cast<std::size_t>(centre);
      const std::size_t above = std::min(below + 1, greatest.size() - 1);
      const double part = centre - static_cast<double>(below);
      double level_db = (1 - part) * decibel(greatest[below]) + part * decibel(greatest[above]);
      const auto from = static_cast<std::size_t>(std::ceil(grid.row_hz(row + 1) / bin_hz));
      const auto to = static_cast<std::size_t>(std::min(last, std::floor(grid.row_hz(row) / bin_hz)));
      for (std::size_t b = from; b <= to; ++b) level_db = std::max(level_db, decibel(greatest[b]));
      grid.level_db[static_cast<std::size_t>(row) * static_cast<std::size_t>(columns) + static_cast<std::size_t>(column)] =
          static_cast<float>(level_db);
    }
  }
  return grid;
}

}  // namespace rustle::report
