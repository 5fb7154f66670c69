#include "server/synthesis/cloth/prepared_corpus.h"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <map>
#include <mutex>
#include <span>
#include <utility>

namespace rustle::cloth {
namespace {

constexpr double kSpeedTrack_s = 0.025;  ///< a frame and a half at 60 a second

std::shared_ptr<const UnitIndex> index_of(const pack::ClothCorpus& corpus, const pack::UnitFeatureSet& features) {
  const auto starts = std::span(corpus.first_unit).first(corpus.first_unit.size() - 1);
  const auto& parameters = corpus.selection;
  return std::make_shared<const UnitIndex>(
      FeatureRows{features.values, corpus.dims(), starts},
      SelectionRules{static_cast<std::size_t>(parameters.look_ahead), parameters.greatest_distance,
                     static_cast<std::size_t>(parameters.cool_off)});
}

}  // namespace

PreparedCorpus::PreparedCorpus(std::shared_ptr<const pack::ClothCorpus> corpus, Search search)
    : corpus_(std::move(corpus)), search_(search), friction_(corpus_->friction), index_(index_of(*corpus_, features())) {
  assert(corpus_->units() > 0);
  for (std::size_t c = 0; c < static_cast<std::size_t>(corpus_->channels); ++c) {
    std::vector<std::span<const float>> recordings;
    for (const auto& recording : corpus_->recordings) recordings.emplace_back(recording.channels[c]);
    sources_.emplace_back(std::move(recordings), static_cast<std::uint32_t>(corpus_->unit_samples));
  }
}

const pack::UnitFeatureSet& PreparedCorpus::features() const noexcept {
  return search_ == Search::kCausal ? corpus_->causal : corpus_->symmetric;
}

std::size_t PreparedCorpus::memory_units() const noexcept {
  return static_cast<std::size_t>(std::ranges::max(corpus_->selection.filter_widths)) / 2 + 1;
}

std::int64_t PreparedCorpus::latency_samples() const noexcept {
  const std::int64_t unit = unit_samples();
  return (corpus_->selection.look_ahead + 1) * unit + unit / 2 + corpus_->friction.fft_size / 2 +
         std::llround(kSpeedTrack_s * corpus_->rate_hz);
}

std::shared_ptr<const PreparedCorpus> prepared(const std::shared_ptr<const pack::ClothCorpus>& corpus) {
  static std::mutex mutex;
  static std::map<const pack::ClothCorpus*, std::weak_ptr<const PreparedCorpus>> known;
  const std::lock_guard lock(mutex);
  std::erase_if(known, [](const auto& entry) { return entry.second.expired(); });
  if (const auto found = known.find(corpus.get()); found != known.end()) {
    if (auto held = found->second.lock()) return held;
  }
  auto made = std::make_shared<const PreparedCorpus>(corpus, Search::kCausal);
  known[corpus.get()] = made;
  return made;
}

}  // namespace rustle::cloth
