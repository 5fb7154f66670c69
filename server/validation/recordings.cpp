#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <stdexcept>

#include "server/validation/groups.h"
#include "sound_db/build/compare.h"

namespace rustle::validation {
namespace {

constexpr std::array kAsked = {build::SoundClass::kFlap, build::SoundClass::kClac, build::SoundClass::kCrumple,
                               build::SoundClass::kSlide};

std::string unit_of(std::string_view feature) {
  return feature.ends_with("_hz") ? "Hz" : feature.ends_with("_s") ? "s" : "";
}

std::vector<float> scaled(const std::vector<float>& samples, double gain) {
  std::vector<float> out(samples);
  for (float& x : out) x = static_cast<float>(x * gain);
  return out;
}

/// Each class's range of a feature: real ones as a band, ours as their median with least and most.
Figure range_figure(const build::Comparison& comparison, std::string_view feature, std::string title) {
  report::Plot plot;
  plot.x = {"", false, 0.4, static_cast<double>(comparison.classes.size()) + 0.6, {}};
  plot.y = {unit_of(feature).empty() ? std::string(feature)
                                     : fmt::format("{} ({})", feature.substr(0, feature.rfind('_')), unit_of(feature)),
            true,
            0,
            0,
            {}};
  report::PlotSeries middle{"ours: median", {}, report::Ink::kCrumpling, report::PlotSeries::Style::kDots};
  report::PlotSeries ends{"ours: least and most", {}, report::Ink::kCrumpling, report::PlotSeries::Style::kCrosses};
  report::PlotSeries real{"real: least, median and most", {}, report::Ink::kFriction, report::PlotSeries::Style::kRings};
  double x = 1;
  for (const auto& one : comparison.classes) {
    for (const auto& row : one.features) {
      if (row.feature != feature) continue;
      middle.points.push_back({x + 0.12, row.ours.median});
      for (const double value : {row.ours.least, row.ours.most}) ends.points.push_back({x + 0.12, value});
      for (const double value : {row.real.least, row.real.median, row.real.most}) real.points.push_back({x - 0.12, value});
      plot.bands.push_back({x - 0.32, x + 0.32, row.real.least, row.real.most, {report::Ink::kFriction, 0.14}});
    }
    plot.x.ticks.push_back({x, std::string(build::name(one.sound_class))});
    x += 1;
  }
  plot.series = {real, ends, middle};
  return {std::move(title), "The pack's sounds of each class and recordings of it. Shaded: the recordings' range.", plot};
}

}  // namespace

Findings recordings(const Setting& setting) {
  const auto real = build::read_reference_recordings(setting.recordings, kRate_hz, setting.recordings_manifest);
  if (!real) throw std::runtime_error(real.error().text());
  setting.progress(0.1);
  const auto ours = build::pack_sounds(*setting.pack, setting.seed);
  setting.progress(0.3);
  const auto comparison =
      build::compare(ours, real->sounds, kRate_hz, [&](double share) { setting.progress(0.3 + 0.6 * share); });

  Findings found;
  for (const auto& one : comparison.classes) {
    const bool asked = std::find(kAsked.begin(), kAsked.end(), one.sound_class) != kAsked.end();
    const std::string with = fmt::format("{}{}", one.compared_with == one.sound_class ? "" : "loudest moments of ",
                                         build::name(one.compared_with));
    for (const auto& row : one.features) {
      const bool decides =
          asked && row.real.count >= build::kFewRecordings && (row.feature == "centroid_hz" || row.feature == "kurtosis");
      const std::string unit = unit_of(row.feature);
      const std::string about = fmt::format(
          "median of {} of ours; {} ({}) recorded: {:.3g} to {:.3g}, median {:.3g}; {:.0f} % of ours within", row.ours.count,
          row.real.count, with, row.real.least, row.real.most, row.real.median, 100 * row.share_inside);
      Bound bound = shown();
      if (decides) {
        bound = {fmt::format("{:.3g} to {:.3g}{}{}", row.real.least, row.real.most, unit.empty() ? "" : " ", unit),
                 row.real.least, row.real.most};
      }
      found.checks.push_back({fmt::format("recordings/{}/{}", build::name(one.sound_class), row.feature), row.ours.median,
                              std::nullopt, bound, unit, about});
    }
    found.checks.push_back({fmt::format("recordings/{}/mfcc_distance", build::name(one.sound_class)), one.mfcc_distance,
                            std::nullopt, shown(), "",
                            fmt::format("median MFCC distance to the nearest of {} recorded; between recordings {:.3g}",
                                        with, one.real_mfcc_distance)});
  }
  for (const auto& [feature, title] : {std::pair{"centroid_hz", "Centroid beside recordings"},
                                       {"bandwidth_hz", "Bandwidth beside recordings"},
                                       {"decay_s", "Decay beside recordings"},
                                       {"kurtosis", "Kurtosis beside recordings"}}) {
    found.figures.push_back(range_figure(comparison, feature, title));
  }
  const auto pairs = build::pairs_to_show(comparison, ours, real->sounds, kRate_hz, 2);
  for (const auto& one : comparison.classes) {
    Pictures pictures;
    pictures.rows = 2;
    for (const auto& pair : pairs) {
      if (pair.sound_class != one.sound_class) continue;
      Picture above, below;
      above.title = "real: " + real->sounds[pair.real].name;
      above.samples = scaled(real->sounds[pair.real].samples, pair.real_gain);
      below.title = "ours: " + ours[pair.ours].name;
      below.samples = scaled(ours[pair.ours].samples, pair.our_gain);
      pictures.pictures.push_back(std::move(above));
      pictures.pictures.push_back(std::move(below));
    }
    if (pictures.pictures.empty()) continue;
    found.figures.push_back({fmt::format("Real above ours: {}", build::name(one.sound_class)),
                             "The nearest pair by MFCC and the farthest, at equal level.", std::move(pictures)});
  }
  for (const auto& notices : {real->notices, comparison.notices}) {
    found.notices.insert(found.notices.end(), notices.begin(), notices.end());
  }
  return found;
}

}  // namespace rustle::validation
