#include <fmt/format.h>

#include <array>
#include <memory>

#include "server/validation/groups.h"
#include "server/validation/measures.h"
#include "server/validation/virtual_sheet.h"

namespace rustle::validation {
namespace {

constexpr double kFriction_s = 24;
constexpr int kReversals = 12;

/// The paper bends the first edge; its A5 is 105 x 297 mm.
struct Format {
  std::string_view name;
  double bent_edge_m, straight_edge_m, compression;
};
enum FormatIndex : std::size_t { kA4, kHalfA4, kA5, kA6, kFlatA4, kFormats };
constexpr std::array<Format, kFormats> kFormatsRubbed = {{{"A4", 0.210, 0.297, 0.30},
                                                          {"half A4", 0.210, 0.148, 0.30},
                                                          {"A5 (105 x 297)", 0.105, 0.297, 0.30},
                                                          {"A6", 0.105, 0.148, 0.30},
                                                          {"flat A4", 0.210, 0.297, 0}}};

struct Step {
  std::string_view name;
  FormatIndex larger, smaller;
};
constexpr std::array<Step, 4> kSteps = {
    {{"A4_to_half_A4", kA4, kHalfA4}, {"A4_to_A5", kA4, kA5}, {"half_A4_to_A6", kHalfA4, kA6}, {"A5_to_A6", kA5, kA6}}};

void add_steps(std::string_view kind, const std::vector<double>& centroids_hz, const std::vector<double>& published_hz,
               Findings& found) {
  for (const Step& step : kSteps) {
    const auto rise = [&](const std::vector<double>& hz) { return 100 * (hz[step.smaller] / hz[step.larger] - 1); };
    found.checks.push_back(
        {fmt::format("sizes/{}/{}", kind, step.name), rise(centroids_hz), std::nullopt, at_least(3, "%"), "%",
         fmt::format("rise of the centroid, {:.0f} to {:.0f} Hz", centroids_hz[step.larger], centroids_hz[step.smaller]),
         published_hz.empty() ? std::nullopt : std::optional(rise(published_hz))});
  }
}

Figure format_figure(std::string title, std::string caption, const std::vector<std::vector<float>>& spectra,
                     std::size_t count) {
  report::Plot plot;
  plot.x = {"frequency (Hz)", true, 100, 20000, {}};
  plot.y = {"level (dB)", false, -40, 3, {}};
  for (std::size_t k = 0; k < count; ++k) {
    plot.series.push_back({fmt::format("{}, {:.0f} Hz", kFormatsRubbed[k].name, centroid_hz(spectra[k])),
                           smoothed_db(spectra[k]), report::series_colour(static_cast<int>(k))});
  }
  return {std::move(title), std::move(caption), plot};
}

}  // namespace

Findings sizes(const Setting& setting) {
  // Friction, friction as printed, flaps.
  std::vector<std::vector<float>> rubbed(kFormats), printed(kFlatA4), flapped(kFlatA4);
  run_all(setting, rubbed.size() + printed.size() + flapped.size(), [&](std::size_t k) {
    Take take;
    take.seed = setting.seed + 100 * k;
    std::unique_ptr<sheets::AnimatedSheet> sheet;
    if (k < kFormats + kFlatA4) {
      const bool as_printed = k >= kFormats;
      const std::size_t which = as_printed ? k - kFormats : k;
      const Format& format = kFormatsRubbed[which];
      sheet = make_rubbed({format.bent_edge_m, format.straight_edge_m, format.compression, 1333}, kFriction_s);
      take.sheet = sheet.get();
      take.obstacles = {table()};
      if (as_printed) take.mode = engine::Mode::kPublished;
      (as_printed ? printed : rubbed)[which] = spectrum_of(play(setting, take).samples);
    } else {
      const std::size_t which = k - kFormats - kFlatA4;
      FlappedSheet flap;
      flap.bent_edge_m = kFormatsRubbed[which].bent_edge_m;
      flap.straight_edge_m = kFormatsRubbed[which].straight_edge_m;
      flap.reversals = kReversals;
      sheet = make_flapped(flap);
      take.sheet = sheet.get();
      take.frame_rate_hz = 120;
      flapped[which] = spectrum_of(play(setting, take).samples, 0);
    }
  });
  const auto centroids = [](const std::vector<std::vector<float>>& spectra) {
    std::vector<double> hz;
    for (const auto& spectrum : spectra) hz.push_back(centroid_hz(spectrum));
    return hz;
  };
  Findings found;
  add_steps("friction", centroids(rubbed), centroids(printed), found);
  found.checks.push_back({"sizes/friction/flat_apart", distance(rubbed[kFlatA4], rubbed[kA4]), std::nullopt, at_least(0.05),
                          "", "distance between an A4 sheet slid flat and slid bent"});
  add_steps("flap", centroids(flapped), {}, found);
  found.figures.push_back(
      format_figure("Figure 12: friction by size",
                    "Sheets bent by 30 % and a flat one, slid over the table at 0.1 m/s. The smaller the "
                    "sheet, the higher the spectrum; in the legend its centroid.",
                    rubbed, kFormats));
  found.figures.push_back(
      format_figure("Figure 13: flaps by size",
                    fmt::format("Mean of {} reversals of the whole bend (10 %) of each sheet, in the air.", kReversals),
                    flapped, kFlatA4));
  return found;
}

}  // namespace rustle::validation
