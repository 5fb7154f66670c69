#include "sound_db/pack/corpus_source.h"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include "sound_db/dsp/filter.h"
#include "sound_db/dsp/level.h"

namespace rustle::pack {

namespace {

constexpr double kWindow_s = 0.005;

/// Stretches of sound, each with what is kept of the pauses around it.
std::vector<CorpusStretch> sounding(const std::vector<std::vector<float>>& channels, double rate_hz, const CorpusCut& cut) {
  const std::size_t length = channels.empty() ? 0 : channels.front().size();
  const auto samples = [&](double seconds) { return static_cast<std::size_t>(std::lround(seconds * rate_hz)); };
  const std::size_t window = std::max<std::size_t>(1, samples(kWindow_s)), keep = samples(cut.keep_s);
  std::vector<CorpusStretch> found;
  for (std::size_t at = 0; at < length; at += window) {
    const std::size_t end = std::min(at + window, length);
    const bool silent = std::all_of(channels.begin(), channels.end(), [&](const std::vector<float>& channel) {
      return dsp::rms_dbfs(std::span(channel).subspan(at, end - at)) < cut.pause_db;
    });
    if (silent) continue;
    if (!found.empty() && at < found.back().end + samples(cut.least_pause_s)) {
      found.back().end = end;
    } else {
      found.push_back({at, end});
    }
  }
  std::erase_if(found, [&](const CorpusStretch& s) { return s.end - s.begin < samples(cut.least_s); });
  for (std::size_t i = 0; i < found.size(); ++i) {
    const std::size_t before = i == 0 ? 0 : found[i - 1].end, after = i + 1 == found.size() ? length : found[i + 1].begin;
    found[i].begin = std::max(before, found[i].begin - std::min(found[i].begin, keep));
    found[i].end = std::min(after, found[i].end + keep);
  }
  return found;
}

}  // namespace

std::vector<SourceRecording> source_recordings(std::vector<std::vector<float>> channels, double rate_hz,
                                               const CorpusCut& cut, const std::string& prefix, int first_number,
                                               std::vector<CorpusStretch>* stretches) {
  if (cut.highpass_hz > 0) {
    const dsp::Cascade highpass = dsp::butterworth_highpass(5, cut.highpass_hz, rate_hz);
    for (std::vector<float>& channel : channels) {
      dsp::CascadeState state;
      dsp::filter(highpass, state, channel);
    }
  }
  std::vector<SourceRecording> recordings;
  for (const CorpusStretch& stretch : sounding(channels, rate_hz, cut)) {
    SourceRecording recording;
    recording.file = fmt::format("{}_{:02}.flac", prefix, first_number + static_cast<int>(recordings.size()));
    for (const std::vector<float>& channel : channels) {
      recording.channels.emplace_back(channel.begin() + static_cast<std::ptrdiff_t>(stretch.begin),
                                      channel.begin() + static_cast<std::ptrdiff_t>(stretch.end));
    }
    recordings.push_back(std::move(recording));
    if (stretches) stretches->push_back(stretch);
  }
  return recordings;
}

}  // namespace rustle::pack
