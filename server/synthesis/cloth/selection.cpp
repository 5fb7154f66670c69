#include "server/synthesis/cloth/selection.h"

#include <algorithm>
#include <cassert>
#include <limits>

namespace rustle::cloth {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

bool contains(std::span<const std::uint32_t> units, std::uint32_t unit) noexcept {
  return std::ranges::find(units, unit) != units.end();
}

}  // namespace

double window_distance(const FeatureRows& window, const FeatureRows& database, std::size_t unit) noexcept {
  double sum = 0;
  for (std::size_t k = 0; k < window.count(); ++k)
    sum += feature_distance(window.row(k), database.row(unit + k), window.dimensions);
  return sum;
}

std::vector<std::uint32_t> units_left(const FeatureRows& database) {
  std::vector<std::uint32_t> left(database.count());
  auto end = static_cast<std::uint32_t>(left.size());
  std::size_t recording = database.starts.size();
  for (auto unit = static_cast<std::uint32_t>(left.size()); unit-- > 0;) {
    left[unit] = end - 1 - unit;
    while (recording > 0 && database.starts[recording - 1] > unit) --recording;
    if (recording > 0 && database.starts[recording - 1] == unit) end = unit;
  }
  return left;
}

Choice choose_by_table(const FeatureRows& window, const FeatureRows& database, std::span<const std::uint32_t> left,
                       double d_max, std::span<const std::uint32_t> cooling) {
  const std::size_t look = window.count() - 1;
  std::uint32_t best = kNoUnit, nearest = kNoUnit;
  double least = kInfinity, shortest = kInfinity;
  for (std::uint32_t unit = 0; unit < left.size(); ++unit) {
    if (contains(cooling, unit)) continue;
    const double d1 = feature_distance(window.row(0), database.row(unit), window.dimensions);
    if (d1 < shortest || nearest == kNoUnit) {
      nearest = unit;
      shortest = d1;
    }
    if (!(d1 <= d_max) || left[unit] < look) continue;
    const double d2 = window_distance(window, database, unit);
    if (d2 < least || best == kNoUnit) {
      best = unit;
      least = d2;
    }
  }
  if (best != kNoUnit) return {best, false};
  if (nearest != kNoUnit) return {nearest, true};
  return {cooling.front(), true};
}

std::vector<Choice> select_by_table(const FeatureRows& target, const FeatureRows& database, const SelectionRules& rules) {
  const auto left = units_left(database);
  std::vector<Choice> choices;
  std::vector<std::uint32_t> units;
  const std::size_t count = target.count(), dimensions = target.dimensions;
  for (std::size_t i = 0; i < count; ++i) {
    const std::size_t rows = std::min(rules.look_ahead, count - 1 - i) + 1;
    const FeatureRows window{target.values.subspan(i * dimensions, rows * dimensions), dimensions};
    const std::size_t cooling = std::min(rules.cool_off, units.size());
    choices.push_back(choose_by_table(window, database, left, rules.d_max, std::span(units).last(cooling)));
    units.push_back(choices.back().unit);
  }
  return choices;
}

double selection_cost(const FeatureRows& target, const FeatureRows& database, std::span<const Choice> choices,
                      double d_max) {
  const auto left = units_left(database);
  double cost = 0;
  for (std::size_t i = 0; i < choices.size(); ++i) {
    const std::uint32_t unit = choices[i].unit;
    const double d1 = feature_distance(target.row(i), database.row(unit), target.dimensions);
    cost += d1 + (d1 > d_max ? kFarCost : 0);
    if (i > 0 && !(unit == choices[i - 1].unit + 1 && left[choices[i - 1].unit] > 0)) cost += kJoinCost;
  }
  return cost;
}

namespace {

/// Dynamic programming over (target unit, database unit).
class GlobalSelection {
 public:
  GlobalSelection(const FeatureRows& target, const FeatureRows& database, const SelectionRules& rules)
      : target_(target),
        database_(database),
        rules_(rules),
        units_(database.count()),
        left_(units_left(database)),
        cost_(units_),
        goes_on_(target.count(), std::vector<bool>(units_)),
        best_(target.count()),
        barred_(units_) {}

  std::vector<Choice> run() {
    for (std::size_t i = 0; i < target_.count(); ++i) step(i);
    std::vector<Choice> choices;
    if (target_.count() == 0) return choices;
    const auto path = path_to(target_.count() - 1, target_.count());
    for (std::size_t i = 0; i < path.size(); ++i) {
      const double d1 = feature_distance(target_.row(i), database_.row(path[i]), target_.dimensions);
      choices.push_back({path[i], d1 > rules_.d_max});
    }
    return choices;
  }

 private:
  void step(std::size_t i) {
    std::fill(barred_.begin(), barred_.end(), false);
    if (i > 0) bar_cooling(i);
    const double jump = i == 0 ? 0 : cost_[best_[i - 1]] + kJoinCost;
    double before = kInfinity;  // cost_[unit - 1] of the step before
    std::uint32_t best = kNoUnit;
    for (std::uint32_t unit = 0; unit < units_; ++unit) {
      const double d1 = feature_distance(target_.row(i), database_.row(unit), target_.dimensions);
      const double go_on = i > 0 && unit > 0 && left_[unit - 1] > 0 ? before : kInfinity;
      const double arrive = barred_[unit] ? kInfinity : jump;
      before = cost_[unit];
      goes_on_[i][unit] = go_on <= arrive && go_on < kInfinity;
      cost_[unit] = std::min(go_on, arrive) + d1 + (d1 > rules_.d_max ? kFarCost : 0);
      if (best == kNoUnit || cost_[unit] < cost_[best]) best = unit;
    }
    best_[i] = best;
  }

  /// Units at which a join from the best path may not arrive: that unit, or one that follows it, cools off when it is
  /// reached. Where that leaves none, all may be reached.
  void bar_cooling(std::size_t i) {
    const auto history = path_to(i - 1, rules_.cool_off);
    std::size_t barred = 0;
    for (std::size_t k = 0; k < history.size(); ++k) {
      const std::size_t age = history.size() - k;
      for (std::size_t back = 0; back + age <= rules_.cool_off && back <= history[k]; ++back) {
        const std::size_t unit = history[k] - back;
        if (left_[unit] < back) break;
        barred += barred_[unit] ? 0 : 1;
        barred_[unit] = true;
      }
    }
    if (barred == units_) std::fill(barred_.begin(), barred_.end(), false);
  }

  /// The last units, `most` at most, of the best path that ends at target unit i.
  std::vector<std::uint32_t> path_to(std::size_t i, std::size_t most) const {
    std::vector<std::uint32_t> path;
    std::uint32_t unit = best_[i];
    while (path.size() < most) {
      path.push_back(unit);
      if (i == 0) break;
      unit = goes_on_[i][unit] ? unit - 1 : best_[i - 1];
      --i;
    }
    std::ranges::reverse(path);
    return path;
  }

  const FeatureRows& target_;
  const FeatureRows& database_;
  const SelectionRules& rules_;
  std::size_t units_;
  std::vector<std::uint32_t> left_;
  std::vector<double> cost_;                ///< of the best path that ends at each unit
  std::vector<std::vector<bool>> goes_on_;  ///< [target unit][unit]: it comes from the unit before it
  std::vector<std::uint32_t> best_;         ///< [target unit]: where the cheapest path ends
  std::vector<bool> barred_;
};

}  // namespace

std::vector<Choice> select_globally(const FeatureRows& target, const FeatureRows& database, const SelectionRules& rules) {
  assert(database.count() > 0);
  return GlobalSelection(target, database, rules).run();
}

}  // namespace rustle::cloth
