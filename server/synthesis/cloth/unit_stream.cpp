#include "server/synthesis/cloth/unit_stream.h"

#include <algorithm>
#include <cassert>
#include <utility>

#include "sound_db/dsp/thin_plate_spline.h"

namespace rustle::cloth {

UnitStream::UnitStream(std::shared_ptr<const PreparedCorpus> corpus, std::shared_ptr<CoolOff> cool_off)
    : corpus_(std::move(corpus)),
      dims_(corpus_->corpus().dims()),
      measure_(corpus_->corpus().unit_samples, corpus_->corpus().rate_hz),
      filter_(static_cast<int>(dims_), corpus_->corpus().selection.filter_widths),
      selector_(corpus_->index(), std::move(cool_off)),
      silence_(dims_),
      features_(dims_),
      warped_(dims_),
      half_(corpus_->memory_units() - 1) {
  const std::vector<float> silent(static_cast<std::size_t>(corpus_->unit_samples()));
  for (std::size_t d = 0; d < dims_; d += dsp::kUnitFeatures)
    measure_(silent, std::span(silence_).subspan(d, dsp::kUnitFeatures));
}

void UnitStream::push(std::span<const std::vector<float>> channels, std::vector<PlacedUnit>& out) {
  assert(channels.size() * dsp::kUnitFeatures == dims_);
  const bool silent = std::ranges::all_of(
      channels, [](const auto& channel) { return std::ranges::all_of(channel, [](float x) { return x == 0; }); });
  if (resting_ && silent) {
    ++pushed_;
    return;
  }
  if (resting_) wake();
  ++pushed_;
  silent_units_ = silent ? silent_units_ + 1 : 0;
  for (std::size_t c = 0; c < channels.size(); ++c)
    measure_(channels[c], std::span(features_).subspan(c * dsp::kUnitFeatures, dsp::kUnitFeatures));
  add_features(features_, out);
  if (silent_units_ >= corpus_->memory_units()) rest(out);
}

void UnitStream::finish(std::vector<PlacedUnit>& out) {
  if (!resting_) rest(out);
}

void UnitStream::wake() {
  resting_ = false;
  silent_units_ = 0;
  next_place_ = pushed_;
  selector_.go_to(pushed_);
  filter_.reset();
  for (std::size_t k = 0; k < corpus_->memory_units(); ++k) filter_.push(silence_, warped_);
  raw_.clear();
  for (std::size_t k = 0; k < half_; ++k) raw_.insert(raw_.end(), silence_.begin(), silence_.end());
  filtered_units_ = half_;
  whole_.clear();
}

void UnitStream::rest(std::vector<PlacedUnit>& out) {
  if (corpus_->search() != Search::kCausal) {
    for (std::size_t k = 0; k < half_; ++k) raw_.insert(raw_.end(), silence_.begin(), silence_.end());
    while ((filtered_units_ + half_) * dims_ < raw_.size()) add_symmetric(filtered_units_++, out);
  }
  if (corpus_->search() == Search::kGlobal) {
    const auto& index = *corpus_->index();
    for (const Choice& choice : select_globally({whole_, dims_}, index.database(), index.rules())) place(choice, out);
  }
  for (const Choice& choice : selector_.finish()) place(choice, out);
  assert(next_place_ == pushed_);
  out.push_back({pushed_, {}});
  resting_ = true;
}

void UnitStream::add_features(std::span<const float> features, std::vector<PlacedUnit>& out) {
  if (corpus_->search() == Search::kCausal) {
    filter_.push(features, warped_);
    return add_filtered(warped_, out);
  }
  raw_.insert(raw_.end(), features.begin(), features.end());
  while ((filtered_units_ + half_) * dims_ < raw_.size()) add_symmetric(filtered_units_++, out);
}

void UnitStream::add_symmetric(std::size_t unit, std::vector<PlacedUnit>& out) {
  const auto& widths = corpus_->corpus().selection.filter_widths;
  for (std::size_t d = 0; d < dims_; ++d) {
    const auto taps = dsp::gaussian_taps(widths[d % widths.size()], false);
    const std::size_t first = unit - taps.size() / 2;
    double sum = 0;
    for (std::size_t k = 0; k < taps.size(); ++k) sum += taps[k] * static_cast<double>(raw_[(first + k) * dims_ + d]);
    warped_[d] = static_cast<float>(sum);
  }
  add_filtered(warped_, out);
}

void UnitStream::add_filtered(std::span<float> features, std::vector<PlacedUnit>& out) {
  const auto& warp = corpus_->features().warp;
  if (!warp.identity()) dsp::warp(warp, features, features);
  if (corpus_->search() == Search::kGlobal) {
    whole_.insert(whole_.end(), features.begin(), features.end());
  } else if (const auto choice = selector_.push(features)) {
    place(*choice, out);
  }
}

}  // namespace rustle::cloth
