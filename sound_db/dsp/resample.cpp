#include "sound_db/dsp/resample.h"

#include <cassert>
#include <cmath>

#include <samplerate.h>

namespace rustle::dsp {

std::vector<float> resample(std::span<const float> clip, double from_hz, double to_hz) {
  const double ratio = to_hz / from_hz;
  assert(src_is_valid_ratio(ratio) && "rates within a factor of 256");
  if (from_hz == to_hz || clip.empty()) return {clip.begin(), clip.end()};
  const auto length = static_cast<long>(std::lround(static_cast<double>(clip.size()) * ratio));
  std::vector<float> out(static_cast<std::size_t>(length) + 16, 0.0f);
  SRC_DATA job{};
  job.data_in = clip.data();
  job.input_frames = static_cast<long>(clip.size());
  job.data_out = out.data();
  job.output_frames = static_cast<long>(out.size());
  job.end_of_input = 1;
  job.src_ratio = ratio;
  [[maybe_unused]] const int failed = src_simple(&job, ratio < 1 ? SRC_SINC_BEST_QUALITY : SRC_SINC_MEDIUM_QUALITY, 1);
  assert(!failed && "libsamplerate refuses only wrong arguments");
  out.resize(static_cast<std::size_t>(length));
  return out;
}

}  // namespace rustle::dsp
