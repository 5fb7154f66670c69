#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

#include "server/synthesis/cloth/friction_powers.h"
#include "server/synthesis/cloth/joins.h"
#include "server/synthesis/cloth/unit_selector.h"
#include "sound_db/pack/cloth_corpus.h"

namespace rustle::cloth {

/// Which features units are found by, and how (C3, C5).
enum class Search : std::uint8_t {
  kCausal,     ///< half-Gaussian features, Algorithm 1 as the target comes in: the default, live and offline
  kSymmetric,  ///< features as published, which look ahead; offline
  kGlobal,     ///< symmetric features, choices of least total cost over all that sounds without a rest; offline
};

/// A corpus made ready to be played at its rate: friction by speed, the search for its units, the units joined. Immutable;
/// any thread.
class PreparedCorpus {
 public:
  /// Allocates; a tenth of a second for two minutes of recordings. \pre the corpus has a unit and a friction speed
  PreparedCorpus(std::shared_ptr<const pack::ClothCorpus> corpus, Search search);

  const pack::ClothCorpus& corpus() const noexcept { return *corpus_; }
  const std::shared_ptr<const pack::ClothCorpus>& shared_corpus() const noexcept { return corpus_; }
  Search search() const noexcept { return search_; }
  std::size_t channels() const noexcept { return sources_.size(); }
  std::int64_t unit_samples() const noexcept { return corpus_->unit_samples; }

  const FrictionPowers& friction() const noexcept { return friction_; }
  const std::shared_ptr<const UnitIndex>& index() const noexcept { return index_; }
  const JoinedSource& source(std::size_t channel) const noexcept { return sources_[channel]; }
  /// The features that the search goes by, and their warp.
  const pack::UnitFeatureSet& features() const noexcept;
  /// Units until features have forgotten what was before: the widest temporal filter.
  std::size_t memory_units() const noexcept;

  /// How much later than its own time a target of 60 frames a second or more can be heard, in samples (C5): L + 1 units,
  /// half a unit of join, a clip's hop, and a frame and a half of the speed track. Causal search only.
  std::int64_t latency_samples() const noexcept;

 private:
  std::shared_ptr<const pack::ClothCorpus> corpus_;
  Search search_;
  FrictionPowers friction_;
  std::shared_ptr<const UnitIndex> index_;
  std::vector<JoinedSource> sources_;  ///< [channel]
};

/// The corpus ready for the causal search, made once for all who ask while somebody holds it. Any thread.
std::shared_ptr<const PreparedCorpus> prepared(const std::shared_ptr<const pack::ClothCorpus>& corpus);

}  // namespace rustle::cloth
