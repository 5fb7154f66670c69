#include "server/synthesis/cloth/unit_selector.h"

#include <algorithm>
#include <cassert>
#include <limits>

namespace rustle::cloth {
namespace {

constexpr std::int64_t kMostApart = 64;  ///< places, of streams that share what cools off

bool cools(std::span<const std::uint32_t> cooling, std::uint32_t unit) noexcept {
  return std::ranges::find(cooling, unit) != cooling.end();
}

/// The lowest of a class's units that is free and serves; kNoUnit: none.
template <class Serves>
std::uint32_t lowest(std::span<const std::uint32_t> members, std::span<const std::uint32_t> cooling, Serves&& serves) {
  for (const std::uint32_t unit : members) {
    if (!cools(cooling, unit) && serves(unit)) return unit;
  }
  return kNoUnit;
}

}  // namespace

/// Least by distance, then by index.
struct UnitIndex::Best {
  double distance = std::numeric_limits<double>::infinity();
  std::uint32_t unit = kNoUnit;

  void take(double other, std::uint32_t other_unit) {
    if (other < distance || (other == distance && other_unit < unit)) {
      distance = other;
      unit = other_unit;
    }
  }
};

UnitIndex::UnitIndex(const FeatureRows& database, const SelectionRules& rules)
    : rules_(rules),
      dimensions_(database.dimensions),
      features_(database.values.begin(), database.values.end()),
      starts_(database.starts.begin(), database.starts.end()),
      left_(units_left(database)),
      windows_(this->database(), left_, rules.look_ahead + 1),
      units_(this->database(), left_, 1) {
  assert(!left_.empty());
}

void UnitIndex::consider(const FeatureRows& window, std::uint32_t window_class, std::span<const std::uint32_t> cooling,
                         Best& best) const {
  const auto members = windows_.members(window_class);
  const float* row = features_.data() + members.front() * dimensions_;
  double sum = feature_distance(window.row(0), row, dimensions_);
  if (!(sum <= rules_.d_max)) return;
  for (std::size_t k = 1; k < window.count(); ++k) {
    sum += feature_distance(window.row(k), row + k * dimensions_, dimensions_);
    if (sum > best.distance) return;
  }
  const std::uint32_t unit = lowest(members, cooling, [](std::uint32_t) { return true; });
  if (unit != kNoUnit) best.take(sum, unit);
}

std::uint32_t UnitIndex::nearest(const float* target, std::span<const std::uint32_t> cooling, bool whole_windows,
                                 double& distance) const {
  Best best;
  const FeatureRows one{std::span(target, dimensions_), dimensions_};
  units_.search(units_.key_of(one), best.distance, [&](std::uint32_t unit_class) {
    const auto members = units_.members(unit_class);
    const double d1 = feature_distance(target, features_.data() + members.front() * dimensions_, dimensions_);
    if (d1 > best.distance) return best.distance;
    const std::uint32_t unit =
        lowest(members, cooling, [&](std::uint32_t u) { return !whole_windows || left_[u] >= rules_.look_ahead; });
    if (unit != kNoUnit) best.take(d1, unit);
    return best.distance;
  });
  distance = best.distance;
  return best.unit;
}

Choice UnitIndex::choose(const FeatureRows& window, std::span<const std::uint32_t> cooling, std::uint32_t hint) const {
  assert(window.count() == rules_.look_ahead + 1);
  Best best;
  if (hint < left_.size() && windows_.class_of(hint) != WindowTree::kNoClass)
    consider(window, windows_.class_of(hint), cooling, best);
  double distance = 0;
  if (best.unit == kNoUnit) {
    const std::uint32_t near = nearest(window.row(0), cooling, true, distance);
    if (near != kNoUnit && distance <= rules_.d_max) consider(window, windows_.class_of(near), cooling, best);
  }
  if (best.unit != kNoUnit) {
    windows_.search(windows_.key_of(window), best.distance, [&](std::uint32_t window_class) {
      consider(window, window_class, cooling, best);
      return best.distance;
    });
    return {best.unit, false};
  }
  const std::uint32_t near = nearest(window.row(0), cooling, false, distance);
  return {near != kNoUnit ? near : cooling.front(), true};
}

std::span<const std::uint32_t> CoolOff::at(std::int64_t place) {
  const auto since = [&](std::int64_t first) {
    return static_cast<std::ptrdiff_t>(std::ranges::lower_bound(places_, first) - places_.begin());
  };
  const auto coldest = place - static_cast<std::int64_t>(units_);
  const std::ptrdiff_t forgotten = since(coldest - kMostApart);
  places_.erase(places_.begin(), places_.begin() + forgotten);
  chosen_.erase(chosen_.begin(), chosen_.begin() + forgotten);
  return std::span(chosen_).subspan(static_cast<std::size_t>(since(coldest)));
}

void CoolOff::chosen(std::int64_t place, std::uint32_t unit) {
  if (units_ == 0) return;
  const auto at = std::ranges::upper_bound(places_, place);
  chosen_.insert(chosen_.begin() + (at - places_.begin()), unit);
  places_.insert(at, place);
}

UnitSelector::UnitSelector(std::shared_ptr<const UnitIndex> index, std::shared_ptr<CoolOff> cool_off)
    : index_(std::move(index)),
      cool_off_(cool_off ? std::move(cool_off) : std::make_shared<CoolOff>(index_->rules().cool_off)) {}

void UnitSelector::go_to(std::int64_t place) {
  assert(pending_.empty());
  place_ = place;
  last_ = kNoUnit;
}

std::optional<Choice> UnitSelector::push(std::span<const float> features) {
  assert(features.size() == index_->database().dimensions);
  pending_.insert(pending_.end(), features.begin(), features.end());
  const std::size_t rows = pending_.size() / features.size();
  if (rows <= index_->rules().look_ahead) return std::nullopt;
  return choose(rows);
}

std::vector<Choice> UnitSelector::finish() {
  std::vector<Choice> choices;
  const std::size_t dimensions = index_->database().dimensions;
  while (!pending_.empty()) choices.push_back(choose(pending_.size() / dimensions));
  return choices;
}

Choice UnitSelector::choose(std::size_t rows) {
  const FeatureRows database = index_->database();
  const SelectionRules& rules = index_->rules();
  const FeatureRows window{std::span(pending_).first(rows * database.dimensions), database.dimensions};
  const std::uint32_t hint = last_ == kNoUnit ? kNoUnit : last_ + 1;
  const auto cooling = cool_off_->at(place_);
  const Choice choice = rows == rules.look_ahead + 1
                            ? index_->choose(window, cooling, hint)
                            : choose_by_table(window, database, index_->left(), rules.d_max, cooling);
  pending_.erase(pending_.begin(), pending_.begin() + static_cast<std::ptrdiff_t>(database.dimensions));
  cool_off_->chosen(place_++, choice.unit);
  last_ = choice.unit;
  return choice;
}

std::vector<Choice> select(const FeatureRows& target, std::shared_ptr<const UnitIndex> index) {
  UnitSelector selector(std::move(index));
  std::vector<Choice> choices;
  for (std::size_t i = 0; i < target.count(); ++i) {
    if (const auto choice = selector.push({target.row(i), target.dimensions})) choices.push_back(*choice);
  }
  for (const Choice& choice : selector.finish()) choices.push_back(choice);
  return choices;
}

}  // namespace rustle::cloth
