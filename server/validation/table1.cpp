#include <fmt/format.h>

#include <array>
#include <cmath>
#include <memory>

#include "server/validation/groups.h"
#include "server/validation/measures.h"
#include "server/validation/virtual_sheet.h"

namespace rustle::validation {
namespace {

constexpr double kTable_s = 24;  // six times to and fro
constexpr int kRepetitions = 4;  // of the reference sheet, for the noise floor

enum Sheet : std::size_t { kReference, kR5, kR20, kC5, kC20, kComp20, kComp40, kComp80, kS2, kS3, kSheets };

std::unique_ptr<sheets::AnimatedSheet> make_sheet(std::size_t which) {
  RubbedSheet sheet;
  switch (which) {
    case kR5:
      sheet.straight_edge_m = 0.05;
      break;
    case kR20:
      sheet.straight_edge_m = 0.20;
      break;
    case kC5:
      sheet.bent_edge_m = 0.05;
      break;
    case kC20:
      sheet.bent_edge_m = 0.20;
      break;
    case kComp20:
      sheet.compression = 0.20;
      break;
    case kComp40:
      sheet.compression = 0.40;
      break;
    case kComp80:
      sheet.compression = 0.80;
      break;
    case kS2:
      return make_rubbed(Trapezoid::kCurvedBases, kTable_s);
    case kS3:
      return make_rubbed(Trapezoid::kStraightBases, kTable_s);
    default:
      break;
  }
  return make_rubbed(sheet, kTable_s);
}

struct Row {
  std::string_view name, label;
  Sheet a, b;
  double paper;
};
constexpr std::array<Row, 12> kRows = {{{"d_r/5-10", "l_r 5-10", kR5, kReference, 0.10},
                                        {"d_r/10-20", "10-20", kReference, kR20, 0.07},
                                        {"d_r/5-20", "5-20", kR5, kR20, 0.16},
                                        {"d_c/5-10", "l_c/2 5-10", kC5, kReference, 0.04},
                                        {"d_c/10-20", "10-20", kReference, kC20, 0.12},
                                        {"d_c/5-20", "5-20", kC5, kC20, 0.13},
                                        {"d_comp/20-40", "comp 20-40", kComp20, kComp40, 0.03},
                                        {"d_comp/40-80", "40-80", kComp40, kComp80, 0.05},
                                        {"d_comp/20-80", "20-80", kComp20, kComp80, 0.03},
                                        {"d_s/s1-s2", "s 1-2", kReference, kS2, 0.04},
                                        {"d_s/s1-s3", "1-3", kReference, kS3, 0.01},
                                        {"d_s/s2-s3", "2-3", kS2, kS3, 0.03}}};
constexpr std::size_t kSizeRows = 6;

struct Distances {
  std::array<double, kRows.size()> d{};
  double mean(std::size_t from, std::size_t count) const {
    double sum = 0;
    for (std::size_t k = from; k < from + count; ++k) sum += d[k];
    return sum / static_cast<double>(count);
  }
  double ratio() const { return mean(0, kSizeRows) / mean(kSizeRows, kSizeRows); }
};

Distances distances(const std::vector<std::vector<float>>& spectra) {
  Distances result;
  for (std::size_t k = 0; k < kRows.size(); ++k) result.d[k] = distance(spectra[kRows[k].a], spectra[kRows[k].b]);
  return result;
}

Figure distance_figure(const Distances& ours, const Distances& published, double floor) {
  report::Plot plot;
  plot.x = {"", false, 0.4, static_cast<double>(kRows.size()) + 0.6, {}};
  plot.y = {"distance", false, 0, 0.25, {}};
  report::PlotSeries paper{"paper", {}, report::Ink::kFriction, report::PlotSeries::Style::kRings};
  report::PlotSeries mine{"ours", {}, report::Ink::kCrumpling, report::PlotSeries::Style::kDots};
  report::PlotSeries printed{"formulas as printed", {}, report::Ink::kMuted, report::PlotSeries::Style::kCrosses};
  for (std::size_t k = 0; k < kRows.size(); ++k) {
    const double x = static_cast<double>(k + 1);
    plot.x.ticks.push_back({x, std::string(kRows[k].label)});
    const double low = k < kSizeRows ? kRows[k].paper - 0.05 : 0, high = k < kSizeRows ? kRows[k].paper + 0.05 : 0.09;
    plot.bands.push_back({x - 0.3, x + 0.3, low, high, {report::Ink::kLevel, 0.16}});
    paper.points.push_back({x, kRows[k].paper});
    mine.points.push_back({x, ours.d[k]});
    printed.points.push_back({x, published.d[k]});
  }
  report::PlotSeries noise{
      "same sheet, other seeds", {{0, floor}, {20, floor}}, report::Ink::kLimit, report::PlotSeries::Style::kDashed};
  plot.series = {noise, printed, paper, mine};
  return {
      "Table 1: distances between friction spectra",
      "Quadratic-form distance of L1-normalised mean magnitude spectra, N = 256. Sheets 10 x 10 cm but for what is named "
      "(cm; compression in %), slid at 0.1 m/s, heard 1 m away and 30 degrees up. Shaded: where ours must lie.",
      plot};
}

Figure spectra_figure(std::string title, const std::vector<std::vector<float>>& spectra,
                      const std::vector<std::pair<std::string, std::size_t>>& which) {
  report::Plot plot;
  plot.x = {"frequency (Hz)", true, 100, 20000, {}};
  plot.y = {"level (dB)", false, -40, 3, {}};
  int colour = 0;
  for (const auto& [label, sheet] : which) {
    plot.series.push_back({label, smoothed_db(spectra[sheet]), report::series_colour(colour++)});
  }
  return {std::move(title), "Mean magnitude spectra in bands of a sixth of an octave, 0 dB the loudest band.", plot};
}

}  // namespace

Findings table1(const Setting& setting) {
  // The sheets, repetitions of the first one, and all sheets again with the formulas as printed.
  const std::size_t repeated = kSheets + kRepetitions;
  std::vector<std::vector<float>> spectra(repeated + kSheets);
  run_all(setting, spectra.size(), [&](std::size_t k) {
    const bool printed = k >= repeated;
    const auto sheet = make_sheet(printed ? k - repeated : k < kSheets ? k : std::size_t{kReference});
    Take take;
    take.sheet = sheet.get();
    take.obstacles = {table()};
    take.seed = setting.seed + 100 * k;
    if (printed) take.mode = engine::Mode::kPublished;
    spectra[k] = spectrum_of(play(setting, take).samples);
  });
  const Distances ours = distances(spectra);
  const Distances published = distances({spectra.begin() + static_cast<std::ptrdiff_t>(repeated), spectra.end()});
  double floor = 0;
  int pairs = 0;
  for (std::size_t a = kSheets; a < repeated; ++a) {
    for (std::size_t b = kSheets; b < a; ++b, ++pairs) floor += distance(spectra[a], spectra[b]);
  }
  floor /= pairs;

  Findings found;
  for (std::size_t k = 0; k < kRows.size(); ++k) {
    const Row& row = kRows[k];
    found.checks.push_back({fmt::format("table1/{}", row.name), ours.d[k], row.paper,
                            k < kSizeRows ? around(row.paper, 0.05) : above_to(0, 0.09), "",
                            k < kSizeRows ? "distance by size" : "distance by shape, size unchanged", published.d[k]});
  }
  found.checks.push_back({"table1/mean_d_comp", ours.mean(6, 3), (0.03 + 0.05 + 0.03) / 3, between(0.015, 0.05), "",
                          "mean distance by compression", published.mean(6, 3)});
  found.checks.push_back({"table1/mean_d_s", ours.mean(9, 3), (0.04 + 0.01 + 0.03) / 3, between(0.015, 0.05), "",
                          "mean distance by shape", published.mean(9, 3)});
  Distances paper;
  for (std::size_t k = 0; k < kRows.size(); ++k) paper.d[k] = kRows[k].paper;
  found.checks.push_back({"table1/ratio", ours.ratio(), paper.ratio(), at_least(3), "",
                          "mean distance by size over mean distance by shape: what makes l_r and l_c good parameters",
                          published.ratio()});
  found.checks.push_back({"table1/noise_floor", floor, std::nullopt, at_most(0.01), "",
                          "mean distance between repetitions of one sheet: what the estimator cannot see"});
  found.figures.push_back(distance_figure(ours, published, floor));
  found.figures.push_back(
      spectra_figure("Table 1: ruling length", spectra, {{"l_r 5 cm", kR5}, {"10 cm", kReference}, {"20 cm", kR20}}));
  found.figures.push_back(
      spectra_figure("Table 1: free border", spectra, {{"l_c/2 5 cm", kC5}, {"10 cm", kReference}, {"20 cm", kC20}}));
  found.figures.push_back(spectra_figure(
      "Table 1: compression and shape", spectra,
      {{"20 %", kComp20}, {"40 %", kComp40}, {"80 %", kComp80}, {"S1", kReference}, {"S2", kS2}, {"S3", kS3}}));
  return found;
}

}  // namespace rustle::validation
