#include <algorithm>
#include <cmath>
#include <cstdint>
#include <memory>
#include <numeric>
#include <vector>

#include <catch2/catch.hpp>

#include "server/synthesis/cloth/selection.h"
#include "server/synthesis/cloth/unit_selector.h"
#include "tests/unit/cloth/made_up_features.h"

namespace rustle::cloth::selection_test {
namespace {

using made_up::Features;
using made_up::wander;

std::vector<std::uint32_t> units_of(const std::vector<Choice>& choices) {
  std::vector<std::uint32_t> units;
  for (const Choice& choice : choices) units.push_back(choice.unit);
  return units;
}

std::vector<std::uint32_t> counting(std::uint32_t first, std::size_t count) {
  std::vector<std::uint32_t> units(count);
  std::iota(units.begin(), units.end(), first);
  return units;
}

/// A database and a target with what makes selection hard: ties, silence, recordings, targets far from everything.
struct Trial {
  Features database, target;
  SelectionRules rules;
};

Trial trial(std::uint64_t number) {
  dsp::Random random(number);
  Trial out;
  const std::size_t dimensions = number % 7 == 0 ? 6 : 3;
  // A few have more windows than two levels of the tree hold.
  const std::size_t units = (number % 20 == 19 ? 5000U : 15U) + random.index(1500), rows = 170;
  out.database = wander(units, number + 1000, number % 3 == 0 ? 0.4 : 0.1, dimensions);
  auto& values = out.database.values;
  if (number % 4 == 0) {
    for (float& x : values) x = std::round(2 * x) / 2;
  }
  if (number % 5 == 0) {  // digital silence
    const auto from = out.database.row(units / 2);
    for (std::size_t k = units / 2 * dimensions; k < values.size(); ++k) values[k] = from[k % dimensions];
  }
  if (units > 60) {
    for (int k = 0; k < 3; ++k) out.database.starts.push_back(1 + random.index(static_cast<std::uint32_t>(units - 1)));
    std::ranges::sort(out.database.starts);
    const auto [first, last] = std::ranges::unique(out.database.starts);
    out.database.starts.erase(first, last);
  }
  constexpr std::size_t kCoolOffs[] = {0, 3, 20};
  constexpr double kDMax[] = {0.3, 2.0, 50.0};
  out.rules = {random.index(12), kDMax[random.index(3)], kCoolOffs[random.index(3)]};
  out.target = wander(rows, number + 2000, 0.3, dimensions);
  if (number % 2 == 0) {
    constexpr double kNoise[] = {0, 0.3, 4};
    const double noise = kNoise[random.index(3)];
    for (std::size_t i = 0; i < rows; ++i) {
      const auto row = out.database.row(random.index(static_cast<std::uint32_t>(units)));
      for (std::size_t k = 0; k < dimensions; ++k)
        out.target.values[i * dimensions + k] = row[k] + static_cast<float>(noise * random.normal());
    }
  }
  return out;
}

TEST_CASE("the fast search chooses the units that the whole table chooses") {
  std::size_t targets = 0, far = 0;
  for (std::uint64_t number = 0; number < 60; ++number) {
    const Trial t = trial(number);
    const auto expected = select_by_table(t.target.rows(), t.database.rows(), t.rules);
    const auto found = select(t.target.rows(), std::make_shared<const UnitIndex>(t.database.rows(), t.rules));
    INFO("trial " << number << " L " << t.rules.look_ahead << " d_max " << t.rules.d_max);
    REQUIRE(found == expected);
    targets += expected.size();
    far += static_cast<std::size_t>(std::ranges::count(expected, true, &Choice::far));
  }
  CHECK(targets >= 10000);
  CHECK(far > 100);
  CHECK(far < targets - 1000);
}

TEST_CASE("unit by unit is as all at once, each choice as soon as its look-ahead is there") {
  const Trial t = trial(8);
  const auto index = std::make_shared<const UnitIndex>(t.database.rows(), SelectionRules{7, 2.0, 20});
  const auto whole = select(t.target.rows(), index);
  UnitSelector selector(index);
  std::vector<Choice> streamed;
  for (std::size_t i = 0; i < t.target.rows().count(); ++i) {
    const auto choice = selector.push(t.target.row(i));
    REQUIRE(choice.has_value() == (i >= 7));
    if (choice) streamed.push_back(*choice);
  }
  for (const Choice& choice : selector.finish()) streamed.push_back(choice);
  CHECK(streamed == whole);
  CHECK(selector.finish().empty());
}

TEST_CASE("no unit comes again before it has cooled off") {
  for (std::uint64_t number = 0; number < 20; ++number) {
    Trial t = trial(number);
    t.rules.cool_off = 20;
    if (t.database.rows().count() <= 20) continue;
    const auto index = std::make_shared<const UnitIndex>(t.database.rows(), t.rules);
    for (const auto& choices :
         {select(t.target.rows(), index), select_globally(t.target.rows(), t.database.rows(), t.rules)}) {
      const auto units = units_of(choices);
      for (std::size_t i = 0; i < units.size(); ++i) {
        for (std::size_t k = 1; k <= 20 && k <= i; ++k) REQUIRE(units[i] != units[i - k]);
      }
    }
  }
}

TEST_CASE("streams that share what cools off do not choose alike") {
  const Features database = wander(300, 1), target = wander(60, 2);
  const auto index = std::make_shared<const UnitIndex>(database.rows(), SelectionRules{3, 2.0, 20});
  const auto cool_off = std::make_shared<CoolOff>(20);
  UnitSelector first(index, cool_off), second(index, cool_off);
  std::vector<std::uint32_t> both;
  for (std::size_t i = 0; i < target.rows().count(); ++i) {
    for (UnitSelector* selector : {&first, &second}) {
      if (const auto choice = selector->push(target.row(i))) both.push_back(choice->unit);
    }
  }
  for (std::size_t i = 0; i < both.size(); ++i) {
    for (std::size_t k = 1; k <= 40 && k <= i; ++k) REQUIRE(both[i] != both[i - k]);
  }
}

TEST_CASE("when every unit cools off the one chosen longest ago comes again") {
  const Features database = wander(5, 1), target = wander(12, 2);
  const auto choices = select_by_table(target.rows(), database.rows(), {2, 50, 20});
  for (std::size_t i = 5; i < choices.size(); ++i) CHECK(choices[i] == Choice{choices[0].unit, true});
}

TEST_CASE("an excerpt of the database is returned as itself") {
  const Features database = wander(4000, 3);
  const auto target = database.part(1234, 600);
  const auto expected = counting(1234, 600);
  const SelectionRules rules{5, 2.0, 20};
  CHECK(units_of(select(target.rows(), std::make_shared<const UnitIndex>(database.rows(), rules))) == expected);
  CHECK(units_of(select_globally(target.rows(), database.rows(), rules)) == expected);
}

TEST_CASE("a run stays within its recording") {
  Features database = wander(200, 4);
  database.starts = {0, 100};
  // The target goes on from unit 97 as the database does; from 96 on the look-ahead of 3 would reach into the next
  // recording.
  const auto target = database.part(90, 20);
  const auto units = units_of(select_by_table(target.rows(), database.rows(), {3, 50, 0}));
  for (std::size_t i = 0; i < 16; ++i) {
    CHECK((units[i] <= 96 || units[i] >= 100));
  }
  CHECK(units[0] == 90);
  CHECK(units[12] == 102);
}

TEST_CASE("ties go to the lower index") {
  Features database = wander(300, 5);
  std::copy_n(database.values.begin() + 30, 90, database.values.begin() + 600);  // units 10..39 again from 200 on
  const auto target = database.part(205, 15);
  const SelectionRules rules{4, 2.0, 20};
  const auto units = units_of(select(target.rows(), std::make_shared<const UnitIndex>(database.rows(), rules)));
  CHECK(units == counting(15, 15));
}

TEST_CASE("the global optimum costs no more than the greedy choices") {
  double greedy = 0, global = 0;
  for (std::uint64_t number = 1; number < 30; number += 2) {
    Trial t = trial(number);
    t.rules.cool_off = 0;
    t.rules.d_max = 50;
    const auto first = select_by_table(t.target.rows(), t.database.rows(), t.rules);
    const auto best = select_globally(t.target.rows(), t.database.rows(), t.rules);
    const double a = selection_cost(t.target.rows(), t.database.rows(), first, t.rules.d_max);
    const double b = selection_cost(t.target.rows(), t.database.rows(), best, t.rules.d_max);
    REQUIRE(b <= a + 1e-9);
    greedy += a;
    global += b;
  }
  CHECK(global < 0.9 * greedy);
}

TEST_CASE("the global optimum is the least of all sequences") {
  const Features database = wander(6, 11, 1.0), target = wander(4, 12, 1.0);
  const SelectionRules rules{0, 1.5, 0};
  double least = 1e9;
  for (std::uint32_t code = 0; code < 6 * 6 * 6 * 6; ++code) {
    std::vector<Choice> choices;
    for (std::uint32_t rest = code, k = 0; k < 4; ++k, rest /= 6) choices.push_back({rest % 6, false});
    least = std::min(least, selection_cost(target.rows(), database.rows(), choices, rules.d_max));
  }
  const auto best = select_globally(target.rows(), database.rows(), rules);
  CHECK(std::abs(selection_cost(target.rows(), database.rows(), best, rules.d_max) - least) < 1e-9);
}

}  // namespace
}  // namespace rustle::cloth::selection_test
