#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "client_sdk/sheets/demos.h"
#include "server/validation/groups.h"
#include "server/validation/virtual_sheet.h"

namespace rustle::validation {
namespace {

struct Example {
  std::string_view name, what;
  std::string_view demo;  ///< empty: a sheet being crumpled
  std::size_t triangles;
  double paper_ms;
  bool of_crumpling;
};
/// The paper does not say how many triangles its Figs. 1 and 17 had; ours have the most of its Table 2.
constexpr std::array<Example, 5> kExamples = {{{"figure_1", "Fig. 1", "bend_slide_snap_shake", 1333, 5, false},
                                               {"figure_17", "Fig. 17", "shake", 1333, 6, false},
                                               {"figure_18_183", "crumpled, 183 triangles", "", 183, 6, true},
                                               {"figure_18_446", "crumpled, 446 triangles", "", 446, 17, true},
                                               {"figure_18_1333", "crumpled, 1333 triangles", "", 1333, 75, true}}};

}  // namespace

Findings timing(const Setting& setting) {
  Findings found;
  report::PlotSeries mine{"ours", {}, report::Ink::kCrumpling, report::PlotSeries::Style::kDots};
  report::PlotSeries paper{"paper", {}, report::Ink::kFriction, report::PlotSeries::Style::kRings};
  for (std::size_t k = 0; k < kExamples.size(); ++k) {
    const Example& example = kExamples[k];
    const auto sheet =
        example.demo.empty() ? make_crumpled(example.triangles, 4) : sheets::make_demo(example.demo, example.triangles);
    Take take;
    take.sheet = sheet.get();
    take.obstacles = {table()};
    take.seed = setting.seed;
    const auto summary = play(setting, take).summary;
    const double ms = 1000 * summary.analysis_s / static_cast<double>(std::max<std::uint64_t>(1, summary.frames));
    Check check{fmt::format("timing/{}", example.name),
                ms,
                example.paper_ms,
                at_most(example.paper_ms, "ms"),
                "ms",
                fmt::format("mean time of the analysis and the plan per frame: {}", example.what)};
    check.wall_time = true;
    found.checks.push_back(std::move(check));
    if (example.of_crumpling) {
      mine.points.push_back({static_cast<double>(example.triangles), ms});
      paper.points.push_back({static_cast<double>(example.triangles), example.paper_ms});
    }
    setting.progress(static_cast<double>(k + 1) / static_cast<double>(kExamples.size()));
  }
  report::Plot plot;
  plot.x = {"triangles", true, 150, 1700, {{183, "183"}, {446, "446"}, {1333, "1333"}}};
  plot.y = {"ms per frame", true, 0.005, 150, {}};
  plot.series = {paper, mine};
  found.figures.push_back({"Table 2: time per frame of a sheet being crumpled",
                           "The paper's machine of 2016 and this one; what both do: find events, regions and resonators.",
                           plot});
  return found;
}

}  // namespace rustle::validation
