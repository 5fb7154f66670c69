#pragma once

#include <vector>

#include "server/report/sound_event.h"

namespace rustle::report {

enum class FrequencyScale : std::uint8_t { kLogarithmic, kLinear };

/// Levels over time (columns) and frequency (rows), sized as they are drawn.
struct SpectrogramGrid {
  int columns = 0, rows = 0;
  double start_s = 0, end_s = 0;
  double lowest_hz = 0, highest_hz = 0;
  FrequencyScale scale = FrequencyScale::kLogarithmic;
  std::vector<float> level_db;  ///< [rows * columns], row 0 the highest; 0 dB: a sine of magnitude 1

  float at(int row, int column) const {
    return level_db[static_cast<std::size_t>(row) * static_cast<std::size_t>(columns) + static_cast<std::size_t>(column)];
  }
  double row_hz(double row) const;  ///< row 0: highest_hz, row `rows`: lowest_hz
};

/// Short-time spectrum by a Hann window of about 43 ms, at least one per column: a cell shows the greatest power among its
/// windows and bins (between bins where it is narrower than one), averaged over the channels.
/// Linear scale starts at 0, logarithmic at `lowest_hz`; both end at half the rate.
/// Pure. Silence and no samples at all give kSilenceDb everywhere. \pre columns, rows >= 1
SpectrogramGrid spectrogram_grid(const Sound& sound, int columns, int rows,
                                 FrequencyScale scale = FrequencyScale::kLogarithmic, double lowest_hz = 50);

}  // namespace rustle::report
