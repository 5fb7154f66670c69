#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "server/synthesis/cloth/selection.h"
#include "server/synthesis/cloth/window_tree.h"

namespace rustle::cloth {

/// A database made ready to be searched, for one set of rules. Immutable; any number of selectors share it, any thread.
class UnitIndex {
 public:
  /// Copies the features. Allocates. \pre the database has a unit; dimensions ≤ WindowTree::kMostDimensions; all finite
  UnitIndex(const FeatureRows& database, const SelectionRules& rules);

  const SelectionRules& rules() const noexcept { return rules_; }
  FeatureRows database() const noexcept { return {features_, dimensions_, starts_}; }
  std::span<const std::uint32_t> left() const noexcept { return left_; }

  /// choose_by_table(window, ...), the same unit, in less time.
  /// \param hint  where the best is likely: the unit after the last choice; kNoUnit: none
  /// \pre window has 1 + L rows, all finite
  Choice choose(const FeatureRows& window, std::span<const std::uint32_t> cooling, std::uint32_t hint) const;

 private:
  struct Best;
  void consider(const FeatureRows& window, std::uint32_t window_class, std::span<const std::uint32_t> cooling,
                Best& best) const;
  /// The free unit nearest by D1, of those that have a whole window or of all.
  std::uint32_t nearest(const float* target, std::span<const std::uint32_t> cooling, bool whole_windows,
                        double& distance) const;

  SelectionRules rules_;
  std::size_t dimensions_;
  std::vector<float> features_;
  std::vector<std::uint32_t> starts_, left_;
  WindowTree windows_, units_;
};

/// The units that cool off (L_c), of one stream of choices or of several that shall not sound alike. One thread at a time.
class CoolOff {
 public:
  explicit CoolOff(std::size_t units) : units_(units) {}

  /// What may not be chosen at a place, the longest chosen first.
  std::span<const std::uint32_t> at(std::int64_t place);
  void chosen(std::int64_t place, std::uint32_t unit);

 private:
  std::size_t units_;  ///< L_c
  std::vector<std::int64_t> places_;
  std::vector<std::uint32_t> chosen_;  ///< at those
};

/// Selection unit by unit: the choice for a unit comes when the L-th after it has been pushed.
class UnitSelector {
 public:
  /// \param cool_off  where choices are shared with other streams whose places are the same; null: its own
  explicit UnitSelector(std::shared_ptr<const UnitIndex> index, std::shared_ptr<CoolOff> cool_off = nullptr);

  /// The next target unit's features. Returns the choice for the L-th before it, once there is one.
  std::optional<Choice> push(std::span<const float> features);
  /// The target has ended: the choices still due, with what look-ahead is left.
  std::vector<Choice> finish();
  /// The next unit to be pushed has this place; nothing is pending.
  void go_to(std::int64_t place);

 private:
  Choice choose(std::size_t rows);

  std::shared_ptr<const UnitIndex> index_;
  std::shared_ptr<CoolOff> cool_off_;
  std::vector<float> pending_;  ///< features of the units without a choice, [rows x dimensions]
  std::int64_t place_ = 0;      ///< of the first of them
  std::uint32_t last_ = kNoUnit;
};

/// A whole target at once: select_by_table's choices.
std::vector<Choice> select(const FeatureRows& target, std::shared_ptr<const UnitIndex> index);

}  // namespace rustle::cloth
