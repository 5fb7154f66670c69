#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "server/synthesis/cloth/prepared_corpus.h"
#include "server/synthesis/cloth/unit_selector.h"
#include "sound_db/dsp/unit_features.h"

namespace rustle::cloth {

/// What sounds in the place of a target unit.
struct PlacedUnit {
  std::int64_t place = 0;  ///< number of the target unit
  Choice choice;           ///< of no unit: what sounded has ended before this place
};

/// A target into choices, unit by unit: features, temporal filter, warp, selection (An et al. 2012, section 4; C3 - C5).
/// A target that has been silent for as long as features remember rests: nothing is chosen until it sounds again, and then
/// units are found as if it had been silent all the time. Streams of one sheet share what cools off, so that no unit sounds
/// in two of them at once. [analysis worker]
class UnitStream {
 public:
  UnitStream(std::shared_ptr<const PreparedCorpus> corpus, std::shared_ptr<CoolOff> cool_off);

  /// The next target unit's samples, [channels][unit_samples]; appends the choices that they settle.
  void push(std::span<const std::vector<float>> channels, std::vector<PlacedUnit>& out);
  /// The target has ended: the choices still due.
  void finish(std::vector<PlacedUnit>& out);

  bool resting() const noexcept { return resting_; }
  std::int64_t pushed() const noexcept { return pushed_; }
  /// The first place that may still be given a unit.
  std::int64_t first_open() const noexcept { return resting_ ? pushed_ : next_place_; }

 private:
  void wake();
  void rest(std::vector<PlacedUnit>& out);
  void add_features(std::span<const float> features, std::vector<PlacedUnit>& out);
  void add_filtered(std::span<float> features, std::vector<PlacedUnit>& out);
  /// The symmetric filter's output for a unit whose neighbours are in raw_.
  void add_symmetric(std::size_t unit, std::vector<PlacedUnit>& out);
  void place(const Choice& choice, std::vector<PlacedUnit>& out) { out.push_back({next_place_++, choice}); }

  std::shared_ptr<const PreparedCorpus> corpus_;
  std::size_t dims_;
  dsp::UnitFeatures measure_;
  dsp::CausalFeatureFilter filter_;
  UnitSelector selector_;
  std::vector<float> silence_;            ///< [dims] features of a silent unit
  std::vector<float> features_, warped_;  ///< [dims]
  std::vector<float> raw_;                ///< since it woke, [units][dims]: of the symmetric filter
  std::size_t filtered_units_ = 0;        ///< of raw_
  std::vector<float> whole_;              ///< since it woke, warped, [units][dims]: of the global search
  std::size_t half_;                      ///< reach of the symmetric filter, units
  bool resting_ = true;
  std::size_t silent_units_ = 0;
  std::int64_t pushed_ = 0, next_place_ = 0;
};

}  // namespace rustle::cloth
