#include "server/validation/validate.h"

#include <atomic>
#include <catch2/catch.hpp>
#include <cmath>
#include <set>
#include <stdexcept>

#include "server/validation/page.h"

namespace validate_test {

using namespace rustle;
using namespace rustle::validation;

TEST_CASE("Names choose groups and checks; an unknown one names those there are") {
  const Setting setting;
  const auto all = chosen_groups(setting, {});
  REQUIRE(all);
  CHECK(all->size() == groups().size() - 1);
  const auto one = chosen_groups(setting, {"table1/d_r"});
  REQUIRE(one);
  REQUIRE(one->size() == 1);
  CHECK(one->front()->name == "table1");
  const auto none = chosen_groups(setting, {"table"});
  REQUIRE_FALSE(none);
  CHECK(none.error().find("table1") != std::string::npos);
  CHECK(chosen_groups(setting, {"recordings"}).error().find("--against") != std::string::npos);
  std::set<std::string_view> names;
  for (const Group& group : groups()) names.insert(group.name);
  CHECK(names.size() == groups().size());
}

TEST_CASE("Jobs run once each whatever the number of workers, and what one throws comes out") {
  for (const int workers : {1, 2, 5}) {
    Setting setting;
    setting.workers = workers;
    double last = 0;
    setting.progress = [&](double part) { last = part; };
    std::vector<int> runs(20, 0);
    run_all(setting, runs.size(), [&](std::size_t k) { ++runs[k]; });
    CHECK(runs == std::vector<int>(20, 1));
    CHECK(last == 1);
    CHECK_THROWS_AS(run_all(setting, 5,
                            [](std::size_t k) {
                              if (k == 3) throw std::runtime_error("three");
                            }),
                    std::runtime_error);
  }
}

TEST_CASE("Laws of the synthesis hold, by themselves and without a pack") {
  Setting setting;
  setting.workers = 2;
  const Findings found = clicks(setting);
  REQUIRE(found.checks.size() == 1);
  INFO(found.checks[0].ours);
  CHECK(found.checks[0].holds());
  CHECK(clicks(setting).checks[0].ours == found.checks[0].ours);
}

TEST_CASE("The page shows every figure and check, escaped, and needs nothing else") {
  static constexpr Group group{"example", "An <example>", "One & two", nullptr};
  Findings findings;
  findings.checks.push_back({"example/good", 0.1, 0.12, around(0.12, 0.05), "", "in <order>"});
  findings.checks.push_back({"example/bad", std::nan(""), std::nullopt, at_most(1, "dB"), "dB"});
  report::Plot plot;
  plot.x = {"x", true, 1, 100, {}};
  plot.y = {"y", false, 0, 0, {}};
  plot.series.push_back({"line", {{1, 2}, {10, std::nan("")}, {100, 3}}, report::Ink::kLevel});
  plot.bands.push_back({0, kUnbounded, -kUnbounded, 2.5});
  findings.figures.push_back({"A plot", "Its caption.", plot});
  Picture picture;
  picture.title = "noise";
  picture.samples.assign(4800, 0.1F);
  findings.figures.push_back({"A sound", "Beside itself.", Pictures{{picture, picture}, 2}});
  const std::vector<GroupFindings> all = {{&group, findings}};
  CHECK(verdict(all).checks == 2);
  CHECK(verdict(all).failed == 1);
  const std::string text = page(all, {{"Seed", "1"}});
  CHECK(text == page(all, {{"Seed", "1"}}));
  CHECK(text.find("<example>") == std::string::npos);
  CHECK(text.find("in &lt;order&gt;") != std::string::npos);
  CHECK(text.find("class=\"failed\"") != std::string::npos);
  CHECK(text.find("<script") == std::string::npos);
  CHECK(text.find(" src=") == std::string::npos);
  CHECK(text.find("nan") == std::string::npos);
  CHECK(text.find("data:image/png;base64,") != std::string::npos);
}

}  // namespace validate_test
