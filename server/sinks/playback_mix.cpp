#include "server/sinks/playback_mix.h"

#include <samplerate.h>

#include <algorithm>
#include <cassert>
#include <cmath>
#include <stdexcept>

namespace rustle::sinks {

/// One source's sound on its way to the device: frames wait, are read straight or spliced, and go through its resampler.
struct PlaybackMix::Source {
  Source(std::uint32_t rate_in_hz, int channel_count) : rate_hz(rate_in_hz), channels(channel_count) {}

  std::size_t frames(double duration_s) const { return static_cast<std::size_t>(duration_s * rate_hz); }
  std::size_t waiting_frames() const { return (waiting.size() - begin) / width(); }
  std::size_t width() const { return static_cast<std::size_t>(channels); }

  /// Reads frames, spliced where due and faded where the source starts or runs dry; silence where there are none.
  void read(std::span<float> out, MixFigures& figures);
  /// The same at another rate.
  void read_at(std::uint32_t device_rate_hz, std::span<float> out, MixFigures& figures);

  void push(std::span<const float> interleaved, MixFigures& figures);
  void forget_waiting();
  bool over() const { return ending && waiting_frames() == 0; }

  std::uint32_t rate_hz;
  int channels;
  bool ending = false;

 private:
  void judge_fill(std::size_t read_frames);
  void splice(MixFigures& figures);
  void drop(std::size_t count) { begin += count * width(); }
  void forget_history();

  std::vector<float> waiting;  // interleaved; the part before `begin` has been heard and is kept for splicing back
  std::size_t begin = 0;
  bool sounding = false;
  std::size_t faded_in = 0;   // frames since it began to sound
  double average_fill = 0;    // frames
  std::vector<float> tail;    // what would have been read without the splice, cross-faded out
  std::size_t tail_read = 0;  // frames

  std::unique_ptr<SRC_STATE, SRC_STATE* (*)(SRC_STATE*)> resampler{nullptr, src_delete};
  std::vector<float> resampler_input;
  std::size_t resampler_left = 0;  // frames of the input that it has not taken yet
};

void PlaybackMix::Source::push(std::span<const float> interleaved, MixFigures& figures) {
  assert(interleaved.size() % width() == 0);
  forget_history();
  waiting.insert(waiting.end(), interleaved.begin(), interleaved.end());
  if (const std::size_t most = frames(kMostWaiting_s); waiting_frames() > most) {
    const std::size_t excess = waiting_frames() - frames(kCushion_s);
    figures.samples_left_out += excess;
    drop(excess);
    average_fill = static_cast<double>(frames(kCushion_s));
    faded_in = 0;
  }
}

void PlaybackMix::Source::forget_history() {
  const std::size_t kept = frames(2 * kSteering_s + kSplice_s) * width();
  if (begin > 4 * kept + waiting.size() / 2) {
    waiting.erase(waiting.begin(), waiting.begin() + static_cast<std::ptrdiff_t>(begin - kept));
    begin = kept;
  }
}

void PlaybackMix::Source::forget_waiting() {
  waiting.clear();
  begin = 0;
  tail.clear();
  tail_read = 0;
  sounding = false;
  resampler.reset();
}

void PlaybackMix::Source::judge_fill(std::size_t read_frames) {
  const double share = std::min(1.0, static_cast<double>(read_frames) / (kFillAverage_s * rate_hz));
  const double fill = static_cast<double>(waiting_frames()) + 0.5 * static_cast<double>(read_frames);
  average_fill += share * (fill - average_fill);
}

void PlaybackMix::Source::splice(MixFigures& figures) {
  const double wanted = static_cast<double>(frames(kCushion_s));
  const double stray = average_fill - wanted;
  if (std::abs(stray) <= static_cast<double>(frames(kSteering_s)) || tail_read * width() < tail.size()) return;
  const std::size_t fade = frames(kSplice_s);
  const auto move = static_cast<std::ptrdiff_t>(stray) * static_cast<std::ptrdiff_t>(width());
  const auto there = static_cast<std::ptrdiff_t>(begin) + move;
  if (there < 0 || there > static_cast<std::ptrdiff_t>(waiting.size()) || waiting_frames() < fade) return;
  const auto from = waiting.begin() + static_cast<std::ptrdiff_t>(begin);
  tail.assign(from, from + static_cast<std::ptrdiff_t>(fade * width()));
  tail_read = 0;
  begin = static_cast<std::size_t>(there);
  average_fill = wanted;
  ++figures.splices;
}

void PlaybackMix::Source::read(std::span<float> out, MixFigures& figures) {
  const std::size_t wanted = out.size() / width();
  std::fill(out.begin(), out.end(), 0.0f);
  if (!sounding) {
    if (waiting_frames() < frames(kCushion_s) && !ending) return;
    sounding = waiting_frames() > 0;
    faded_in = 0;
    average_fill = static_cast<double>(frames(kCushion_s));
  }
  splice(figures);
  const std::size_t taken = std::min(wanted, waiting_frames());
  std::copy_n(waiting.begin() + static_cast<std::ptrdiff_t>(begin), taken * width(), out.begin());
  drop(taken);
  judge_fill(taken);
  const std::size_t splice_frames = tail.size() / width();
  for (std::size_t n = 0; n < taken && tail_read < splice_frames; ++n, ++tail_read) {
    const float in = (static_cast<float>(tail_read) + 0.5f) / static_cast<float>(splice_frames);
    for (std::size_t c = 0; c < width(); ++c) {
      float& value = out[n * width() + c];
      value = in * value + (1 - in) * tail[tail_read * width() + c];
    }
  }
  const std::size_t fade = frames(kPlaybackFade_s);
  for (std::size_t n = 0; n < taken && faded_in < fade; ++n, ++faded_in) {
    for (std::size_t c = 0; c < width(); ++c)
      out[n * width() + c] *= static_cast<float>(faded_in + 1) / static_cast<float>(fade + 1);
  }
  if (taken == wanted || !sounding) return;
  const std::size_t out_fade = std::min(fade, taken);
  for (std::size_t n = 0; n < out_fade; ++n) {
    for (std::size_t c = 0; c < width(); ++c)
      out[(taken - 1 - n) * width() + c] *= static_cast<float>(n + 1) / static_cast<float>(out_fade + 1);
  }
  if (!ending) figures.samples_in_gaps += wanted - taken;
  sounding = false;
}

void PlaybackMix::Source::read_at(std::uint32_t device_rate_hz, std::span<float> out, MixFigures& figures) {
  if (device_rate_hz == rate_hz) {
    resampler.reset();
    read(out, figures);
    return;
  }
  if (!resampler) {
    int error = 0;
    resampler.reset(src_new(SRC_SINC_FASTEST, channels, &error));
    if (!resampler) throw std::runtime_error(src_strerror(error));
    resampler_left = 0;
  }
  const double ratio = static_cast<double>(device_rate_hz) / rate_hz;
  std::size_t made = 0;
  const std::size_t wanted = out.size() / width();
  while (made < wanted) {
    if (resampler_left == 0) {
      resampler_left = static_cast<std::size_t>(std::ceil(static_cast<double>(wanted - made) / ratio)) + 1;
      resampler_input.resize(resampler_left * width());
      read(resampler_input, figures);
    }
    SRC_DATA data{};
    data.data_in = resampler_input.data() + resampler_input.size() - resampler_left * width();
    data.input_frames = static_cast<long>(resampler_left);
    data.data_out = out.data() + made * width();
    data.output_frames = static_cast<long>(wanted - made);
    data.src_ratio = ratio;
    if (const int error = src_process(resampler.get(), &data); error != 0) throw std::runtime_error(src_strerror(error));
    resampler_left -= static_cast<std::size_t>(data.input_frames_used);
    made += static_cast<std::size_t>(data.output_frames_gen);
  }
}

PlaybackMix::PlaybackMix(std::uint32_t rate_hz, int channels)
    : rate_hz_(rate_hz), channels_(channels), sum_(static_cast<std::size_t>(channels)), limiter_(rate_hz) {
  assert(rate_hz > 0 && channels >= 1);
}

PlaybackMix::~PlaybackMix() = default;

void PlaybackMix::turn_to(std::uint32_t rate_hz, int channels) {
  std::lock_guard lock(mutex_);
  rate_hz_ = rate_hz;
  channels_ = channels;
  resting_ = false;
  sum_.assign(static_cast<std::size_t>(channels), {});
  limiter_ = synthesis::Limiter(rate_hz);
}

void PlaybackMix::rest() {
  std::lock_guard lock(mutex_);
  resting_ = true;
  for (auto& [id, source] : sources_) source->forget_waiting();
  std::erase_if(sources_, [](const auto& entry) { return entry.second->over(); });
}

PlaybackMix::SourceId PlaybackMix::add(std::uint32_t rate_hz, int channels) {
  std::lock_guard lock(mutex_);
  sources_.emplace(next_id_, std::make_unique<Source>(rate_hz, channels));
  return next_id_++;
}

void PlaybackMix::push(SourceId source, std::span<const float> interleaved) {
  std::lock_guard lock(mutex_);
  if (resting_) return;
  if (const auto found = sources_.find(source); found != sources_.end()) found->second->push(interleaved, figures_);
}

void PlaybackMix::end(SourceId source) {
  std::lock_guard lock(mutex_);
  const auto found = sources_.find(source);
  if (found == sources_.end()) return;
  found->second->ending = true;
  if (resting_) sources_.erase(found);
}

bool PlaybackMix::empty() const {
  std::lock_guard lock(mutex_);
  return sources_.empty();
}

MixFigures PlaybackMix::figures() const {
  std::lock_guard lock(mutex_);
  return figures_;
}

void PlaybackMix::mix(std::span<float> out) {
  std::lock_guard lock(mutex_);
  const auto width = static_cast<std::size_t>(channels_);
  assert(out.size() % width == 0);
  const std::size_t frames = out.size() / width;
  for (auto& channel : sum_) channel.assign(frames, 0.0f);
  for (auto entry = sources_.begin(); entry != sources_.end();) {
    Source& source = *entry->second;
    const std::size_t heard = source.width();
    read_.resize(frames * heard);
    source.read_at(rate_hz_, read_, figures_);
    // One channel goes to all; more than the device has share its channels, each at its part.
    const float part = heard > width ? static_cast<float>(width) / static_cast<float>(heard) : 1.0f;
    for (std::size_t c = 0; c < std::max(heard, heard == 1 ? width : heard); ++c) {
      float* sum = sum_[c % width].data();
      for (std::size_t n = 0; n < frames; ++n) sum[n] += part * read_[n * heard + c % heard];
    }
    entry = source.over() ? sources_.erase(entry) : std::next(entry);
  }
  std::vector<float*> channels;
  for (auto& channel : sum_) channels.push_back(channel.data());
  limiter_.process(channels, frames);
  for (std::size_t n = 0; n < frames; ++n) {
    for (std::size_t c = 0; c < width; ++c) out[n * width + c] = sum_[c][n];
  }
}

}  // namespace rustle::sinks
