#include "server/synthesis/cloth_stream.h"

#include <algorithm>
#include <limits>
#include <utility>

#include "server/synthesis/source_paths.h"
#include "sound_db/dsp/level.h"
#include "sound_db/dsp/random.h"

namespace rustle::synthesis {

ClothStream::ClothStream(std::shared_ptr<const cloth::PreparedCorpus> corpus, const PlanOptions& options, Bus bus,
                         std::uint64_t seed, SampleTime begin)
    : corpus_(std::move(corpus)),
      bus_(bus),
      seed_(seed),
      begin_(begin),
      gain_(static_cast<float>(dsp::db_to_gain(corpus_->corpus().gain_db))),
      targets_(corpus_, options, seed, begin),
      unit_(corpus_->channels(), std::vector<float>(static_cast<std::size_t>(corpus_->unit_samples()))) {
  const auto cool_off = std::make_shared<cloth::CoolOff>(corpus_->index()->rules().cool_off);
  for (std::size_t v = 0; v < (targets_.heard() ? 1 : kClothPatches); ++v) {
    voices_.push_back({cloth::UnitStream(corpus_, cool_off), {}});
    for (std::size_t c = 0; c < corpus_->channels(); ++c) voices_.back().runs.emplace_back(corpus_->source(c));
  }
}

std::uint64_t ClothStream::patch_id(std::uint64_t seed, std::size_t voice, std::size_t channel) noexcept {
  return dsp::hash(seed, voice, channel);
}

void ClothStream::add(const observation::Observation& observation, std::span<const ClothTouch> touches, bool crumples,
                      const ClothEars& ears, std::vector<Cue>& out) {
  targets_.add(observation, touches, crumples, ears);
  choose(out);
}

void ClothStream::choose(std::vector<Cue>& out) {
  const std::int64_t unit = corpus_->unit_samples();
  // Unit by unit, all patches at a time: what one has chosen cools off for the others whenever frames come.
  for (std::int64_t next = voices_.front().units.pushed(); (next + 1) * unit <= targets_.settled(); ++next) {
    for (std::size_t v = 0; v < voices_.size(); ++v) {
      for (std::size_t c = 0; c < unit_.size(); ++c) targets_.read(targets_.heard() ? c : v, next * unit, unit_[c]);
      placed_.clear();
      voices_[v].units.push(unit_, placed_);
      put(v, placed_, out);
    }
  }
  targets_.forget(std::max<std::int64_t>(0, settled() - begin_ - unit));
}

void ClothStream::put(std::size_t voice, std::span<const cloth::PlacedUnit> units, std::vector<Cue>& out) {
  const std::int64_t unit = corpus_->unit_samples();
  for (const auto& [number, choice] : units) {
    const std::int64_t at = number * unit;
    for (std::size_t c = 0; c < voices_[voice].runs.size(); ++c) {
      cloth::RunBuilder& run = voices_[voice].runs[c];
      const auto pieces = choice.unit == cloth::kNoUnit ? run.finish() : run.next(choice.unit);
      for (const cloth::Piece& piece : pieces.all()) {
        ClothPieceCue cue;
        cue.first = begin_ + at + piece.offset;
        cue.start = cue.first - kPathLag;
        cue.until = begin_ + at + unit;
        cue.patch = patch_id(seed_, voice, c);
        cue.bus = bus_;
        cue.channel = targets_.heard() ? static_cast<std::int8_t>(c) : kEveryChannel;
        cue.samples = piece.samples;
        cue.count = piece.count;
        cue.gain = gain_;
        cue.emitter = targets_.emitter_at(targets_.heard() ? 0 : voice, at + unit);
        out.emplace_back(cue);
      }
    }
  }
}

SampleTime ClothStream::settled() const noexcept {
  std::int64_t open = std::numeric_limits<std::int64_t>::max();
  for (const Voice& voice : voices_) open = std::min(open, voice.units.first_open());
  const std::int64_t unit = corpus_->unit_samples();
  return begin_ + open * unit - unit / 2 - kPathLag;
}

void ClothStream::complete(SampleTime until, std::vector<Cue>& out) {
  if (corpus_->search() == cloth::Search::kGlobal) return;
  while (settled() < until) {
    targets_.go_on();
    choose(out);
  }
}

void ClothStream::end(std::vector<Cue>& out) {
  targets_.end();
  choose(out);
  for (std::size_t v = 0; v < voices_.size(); ++v) {
    placed_.clear();
    voices_[v].units.finish(placed_);
    put(v, placed_, out);
  }
}

}  // namespace rustle::synthesis
