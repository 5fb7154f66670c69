#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "sound_db/pack/cloth_corpus.h"

namespace rustle::pack {

struct CorpusCut {
  double highpass_hz = 100;     ///< 5th-order Butterworth (An et al. 2012, 4.4); 0: none
  double pause_db = -75;        ///< below full scale: RMS in 5 ms of every channel that is silence
  double least_pause_s = 0.15;  ///< shorter ones stay
  double keep_s = 0.05;         ///< of a pause at both sides of the sound, so that there are quiet units too
  double least_s = 0.1;         ///< shorter stretches of sound are left out
};

/// A stretch of a recording, samples [begin, end).
struct CorpusStretch {
  std::size_t begin = 0, end = 0;
};

/// Channels of one moment, filtered and cut at their pauses into recordings that units can follow one another in (C5, C6).
/// Files are named by their number, `prefix`_01.flac and on, from `first_number`; where each lay goes to `stretches`.
/// Allocates; control side.
/// \pre channels are equally long
std::vector<SourceRecording> source_recordings(std::vector<std::vector<float>> channels, double rate_hz,
                                               const CorpusCut& cut, const std::string& prefix, int first_number = 1,
                                               std::vector<CorpusStretch>* stretches = nullptr);

}  // namespace rustle::pack
