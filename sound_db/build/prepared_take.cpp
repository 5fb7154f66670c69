#include "sound_db/build/prepared_take.h"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include "sound_db/build/recording.h"
#include "sound_db/dsp/filter.h"
#include "sound_db/dsp/level.h"
#include "sound_db/dsp/resample.h"

namespace rustle::build {

namespace {

/// Three samples running at full scale, or four alike at the file's own peak: what a converter or an editor cut off.
std::vector<Segment> clipped_parts(const Recording& recording) {
  constexpr float kFullScale = 0.999f;
  constexpr std::size_t kRunAtFullScale = 3, kRunAtPeak = 4;
  std::vector<Segment> parts;
  const auto channels = static_cast<std::size_t>(recording.channels);
  for (std::size_t c = 0; c < channels; ++c) {
    const auto at = [&](std::size_t n) { return recording.interleaved[n * channels + c]; };
    float peak = 0;
    for (std::size_t n = 0; n < recording.frames(); ++n) peak = std::max(peak, std::abs(at(n)));
    if (peak < 1e-3f) continue;
    for (std::size_t n = 0; n < recording.frames();) {
      std::size_t end = n + 1;
      const bool full = std::abs(at(n)) >= kFullScale;
      if (!full && std::abs(at(n)) < peak) {
        n = end;
        continue;
      }
      while (end < recording.frames() && (full ? at(end) * at(n) > 0 && std::abs(at(end)) >= kFullScale : at(end) == at(n)))
        ++end;
      if (end - n >= (full ? kRunAtFullScale : kRunAtPeak)) parts.push_back({n, end});
      n = end;
    }
  }
  std::sort(parts.begin(), parts.end(), [](const Segment& a, const Segment& b) { return a.begin < b.begin; });
  return parts;
}

}  // namespace

tl::expected<PreparedTake, std::string> prepare(const std::filesystem::path& file, const Take& take, double rate_hz,
                                                double highpass_hz) {
  const auto recording = read_recording(file);
  if (!recording) return tl::unexpected(recording.error());
  if (take.channel > recording->channels) {
    return tl::unexpected(fmt::format("has {} channel{}, but channel {} is asked for", recording->channels,
                                      recording->channels == 1 ? "" : "s", take.channel));
  }
  const double recorded_hz = recording->rate_hz, ratio = rate_hz / recorded_hz;
  if (ratio > 24 || ratio < 1.0 / 96) return tl::unexpected(fmt::format("has a rate of {} Hz", recording->rate_hz));
  PreparedTake result;
  result.rate_hz = rate_hz;
  result.recorded_rate_hz = recording->rate_hz;
  result.channels = recording->channels;
  result.duration_s = recording->duration_s();

  std::vector<float> samples = dsp::resample(channel_of(*recording, take.channel), recorded_hz, rate_hz);
  double mean = 0;
  for (const float x : samples) mean += x / static_cast<double>(samples.size());
  const auto gain = static_cast<float>(dsp::db_to_gain(take.gain_db));
  for (float& x : samples) x = gain * (x - static_cast<float>(mean));
  if (highpass_hz > 0) {
    dsp::CascadeState state;
    dsp::filter(dsp::butterworth_highpass(5, highpass_hz, rate_hz), state, samples);
  }
  const auto index = [&](double time_s) {
    return static_cast<std::size_t>(std::clamp(std::round(time_s * rate_hz), 0.0, static_cast<double>(samples.size())));
  };
  const std::size_t begin = index(take.from_s.value_or(0)), end = index(take.to_s.value_or(result.duration_s + 1));
  if (begin >= end) {
    return tl::unexpected(
        fmt::format("lasts {:.3f} s, but its take begins at {:.3f} s", result.duration_s, take.from_s.value_or(0)));
  }
  result.from_s = static_cast<double>(begin) / rate_hz;
  result.samples.assign(samples.begin() + static_cast<std::ptrdiff_t>(begin),
                        samples.begin() + static_cast<std::ptrdiff_t>(end));
  for (const Segment& part : clipped_parts(*recording)) {
    const auto first = static_cast<std::size_t>(std::floor(static_cast<double>(part.begin) * ratio));
    const auto last = static_cast<std::size_t>(std::ceil(static_cast<double>(part.end) * ratio));
    if (last > begin && first < end) result.clipped.push_back({std::max(first, begin) - begin, std::min(last, end) - begin});
  }
  return result;
}

bool is_clipped(const PreparedTake& take, std::size_t begin, std::size_t end) {
  return std::any_of(take.clipped.begin(), take.clipped.end(),
                     [&](const Segment& part) { return part.begin < end && part.end > begin; });
}

}  // namespace rustle::build
