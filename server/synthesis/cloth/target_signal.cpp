#include "server/synthesis/cloth/target_signal.h"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <numbers>
#include <utility>

#include "sound_db/dsp/random.h"
#include "sound_db/dsp/window.h"

namespace rustle::cloth {

TargetSignal::TargetSignal(std::shared_ptr<const PreparedCorpus> corpus, std::uint64_t seed, std::size_t patches,
                           std::size_t outputs_heard)
    : corpus_(std::move(corpus)),
      seed_(seed),
      size_(static_cast<std::int64_t>(corpus_->corpus().friction.fft_size)),
      hop_(size_ / 2),
      patches_(patches),
      heard_(outputs_heard > 0),
      outputs_(heard_ ? outputs_heard : patches),
      fft_(static_cast<int>(size_)),
      window_(static_cast<std::size_t>(size_)),
      power_(corpus_->friction().bins()),
      noise_(power_.size()) {
  dsp::sine_window(window_);
  for (Patch& patch : patches_) patch.row_weights.resize(corpus_->friction().rows());
}

void TargetSignal::hear_through(std::size_t patch, std::span<const std::vector<float>> filters) {
  assert(heard_ && filters.size() == outputs_.size());
  Patch& heard = patches_[patch];
  heard.filters.assign(filters.begin(), filters.end());
  heard.responses.resize(filters.size());
  for (std::size_t o = 0; o < filters.size(); ++o) {
    assert(filters[o].size() <= static_cast<std::size_t>(size_));
    std::ranges::fill(fft_.time(), 0.0F);
    std::ranges::copy(filters[o], fft_.time().begin());
    fft_.forward();
    heard.responses[o].assign(fft_.spectrum().begin(), fft_.spectrum().end());
  }
}

void TargetSignal::pop(std::int64_t onset, std::size_t patch, std::size_t unit) {
  const auto& sound = corpus_->corpus().crumpling->units[unit].samples;
  const std::int64_t from = std::max(onset, settled());
  if (!heard_) return add(patch, from, sound);
  for (std::size_t o = 0; o < patches_[patch].filters.size(); ++o) {
    const auto& filter = patches_[patch].filters[o];
    std::vector<float> filtered(sound.size() + filter.size() - 1);
    for (std::size_t j = 0; j < filter.size(); ++j) {
      if (filter[j] == 0) continue;
      for (std::size_t n = 0; n < sound.size(); ++n) filtered[n + j] += filter[j] * sound[n];
    }
    add(o, from, filtered);
  }
}

void TargetSignal::advance(const ContactTrack& track, std::int64_t until) {
  for (; next_clip_ < until; next_clip_ += hop_) {
    const double patch_area_m2 = corpus_->corpus().friction.patch_area_m2;
    const bool any = track.at(next_clip_, [&](const ContactSample& sample) {
      Patch& patch = patches_[sample.patch];
      patch.slides = true;
      corpus_->friction().weigh(static_cast<double>(sample.speed_m_per_s),
                                static_cast<double>(sample.area_m2) / patch_area_m2, patch.row_weights);
    });
    for (std::size_t p = 0; any && p < patches_.size(); ++p) {
      if (patches_[p].slides) make_clip(p);
    }
  }
}

void TargetSignal::make_clip(std::size_t index) {
  Patch& patch = patches_[index];
  corpus_->friction().sum(patch.row_weights, power_);
  std::ranges::fill(patch.row_weights, 0.0);
  patch.slides = false;
  dsp::Random random(dsp::hash(seed_, index, static_cast<std::uint64_t>(next_clip_ / hop_)));
  // White noise of unit variance has |X|² = N in every bin.
  const auto scale = static_cast<float>(std::sqrt(static_cast<double>(size_)));
  for (std::size_t k = 0; k < power_.size(); ++k) {
    const float magnitude = scale * std::sqrt(power_[k]);
    const auto phase = static_cast<float>(2 * std::numbers::pi * random.uniform());
    const bool real = k == 0 || k + 1 == power_.size();
    noise_[k] = real ? std::complex<float>(phase < std::numbers::pi_v<float> ? magnitude : -magnitude)
                     : std::polar(magnitude, phase);
  }
  if (!heard_) {
    std::ranges::copy(noise_, fft_.spectrum().begin());
    return add_clip(index);
  }
  for (std::size_t o = 0; o < patch.responses.size(); ++o) {
    for (std::size_t k = 0; k < noise_.size(); ++k) fft_.spectrum()[k] = noise_[k] * patch.responses[o][k];
    add_clip(o);
  }
}

void TargetSignal::add_clip(std::size_t output) {
  fft_.inverse();
  const auto clip = fft_.time();
  for (std::size_t n = 0; n < clip.size(); ++n) clip[n] *= window_[n];
  add(output, next_clip_ - hop_, clip);
}

void TargetSignal::add(std::size_t output, std::int64_t from, std::span<const float> sound) {
  std::vector<float>& samples = outputs_[output];
  const auto skipped =
      static_cast<std::size_t>(std::clamp<std::int64_t>(first_ - from, 0, static_cast<std::int64_t>(sound.size())));
  sound = sound.subspan(skipped);
  if (sound.empty()) return;
  const auto at = static_cast<std::size_t>(std::max(from, first_) - first_);
  if (samples.size() < at + sound.size()) samples.resize(at + sound.size());
  for (std::size_t n = 0; n < sound.size(); ++n) samples[at + n] += sound[n];
}

void TargetSignal::read(std::size_t output, std::int64_t from, std::span<float> out) const noexcept {
  assert(from >= first_);
  const std::vector<float>& samples = outputs_[output];
  const auto at = std::min(static_cast<std::size_t>(from - first_), samples.size());
  const std::size_t count = std::min(out.size(), samples.size() - at);
  std::copy_n(samples.begin() + static_cast<std::ptrdiff_t>(at), count, out.begin());
  std::fill(out.begin() + static_cast<std::ptrdiff_t>(count), out.end(), 0.0F);
}

void TargetSignal::forget(std::int64_t before) {
  if (before - first_ < size_) return;  // not at every unit
  for (auto& samples : outputs_) {
    const auto gone = std::min(static_cast<std::size_t>(before - first_), samples.size());
    samples.erase(samples.begin(), samples.begin() + static_cast<std::ptrdiff_t>(gone));
  }
  first_ = before;
}

}  // namespace rustle::cloth
