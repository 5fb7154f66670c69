#include "server/apps/comparison_page.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "server/report/html_page.h"
#include "server/report/plot.h"
#include "server/report/svg_canvas.h"

namespace rustle::apps {
namespace {

using Style = report::PlotSeries::Style;

std::string drawing(const std::string& id, const std::string& title, const report::Plot& plot) {
  return report::html_drawings(
      id, title, 340, 280, [&](report::Canvas& canvas, const report::Rect& rect) { report::draw_plot(canvas, rect, plot); });
}

report::PlotSeries series(std::string label, int colour, Style style = Style::kLine) {
  return {std::move(label), {}, report::series_colour(colour), style};
}

report::Plot level_plot(const comparison::SoundDifference& d) {
  report::Plot plot;
  plot.x.title = "time in s";
  plot.y.title = "level in dBFS";
  auto reference = series("reference", 0), other = series("other", 1);
  double loudest = -100;
  for (std::size_t k = 0; k < d.reference_track_db.size(); ++k) {
    const double time_s = (static_cast<double>(k) + 0.5) * d.window_s;
    reference.points.push_back({time_s, d.reference_track_db[k]});
    other.points.push_back({time_s, d.other_track_db[k]});
    loudest = std::max({loudest, d.reference_track_db[k], d.other_track_db[k]});
  }
  plot.y.from = loudest - 80, plot.y.to = loudest + 5;
  plot.series = {std::move(reference), std::move(other)};
  return plot;
}

report::Plot spectrum_plot(const comparison::SoundDifference& d) {
  report::Plot plot;
  plot.x = {"third octaves in Hz", true, 0, 0, {}};
  plot.y.title = "level in dBFS";
  auto reference = series("reference", 0), other = series("other", 1);
  double loudest = -100;
  for (const auto& band : d.bands) {
    reference.points.push_back({band.centre_hz, band.reference_db});
    other.points.push_back({band.centre_hz, band.other_db});
    loudest = std::max({loudest, band.reference_db, band.other_db});
  }
  plot.y.from = loudest - 70, plot.y.to = loudest + 5;
  plot.series = {std::move(reference), std::move(other)};
  return plot;
}

/// Pairs by how late the other is; events that nothing matches above and below them.
report::Plot event_plot(const ComparedEvents& events, double tolerance_ms) {
  report::Plot plot;
  plot.x.title = "time in s";
  plot.y.title = "other after reference in ms";
  const double border = 1.3 * std::max(tolerance_ms, 1.0);
  plot.y.from = -border, plot.y.to = border;
  auto pairs = series("matched", 2, Style::kDots), missed = series("missed", 3, Style::kCrosses),
       invented = series("only in the other", 1, Style::kRings);
  std::vector<char> reference_used(events.reference.size()), other_used(events.other.size());
  for (const auto& [a, b] : events.pairs) {
    reference_used[a] = other_used[b] = 1;
    pairs.points.push_back({events.reference[a].time_s, 1000 * (events.other[b].time_s - events.reference[a].time_s)});
  }
  for (std::size_t k = 0; k < reference_used.size(); ++k) {
    if (!reference_used[k]) missed.points.push_back({events.reference[k].time_s, -1.15 * std::max(tolerance_ms, 1.0)});
  }
  for (std::size_t k = 0; k < other_used.size(); ++k) {
    if (!other_used[k]) invented.points.push_back({events.other[k].time_s, 1.15 * std::max(tolerance_ms, 1.0)});
  }
  plot.series = {std::move(pairs), std::move(missed), std::move(invented)};
  return plot;
}

std::string event_tiles(const comparison::EventScore& score) {
  return report::html_tile(fmt::format("{:.3f}", score.precision), "precision", "level") +
         report::html_tile(fmt::format("{:.3f}", score.recall), "recall", "level") +
         report::html_tile(fmt::format("{:.2f} ms", 1000 * score.median_error_s), "median timing error", "level");
}

std::string event_captions(const ComparedEvents& events, double tolerance_ms) {
  std::string out = fmt::format("Events of one sheet and kind at most {:g} ms apart match, one to one. ", tolerance_ms);
  for (const auto& [kind, score] : events.scores) {
    out += fmt::format("{}: {} of {} found, {} in the other. ", report::html_escaped(kind), score.matched, score.reference,
                       score.other);
  }
  return out;
}

}  // namespace

std::string comparison_page(const Comparison& compared) {
  const auto& d = compared.sounds.difference;
  std::string body = "<ul class=\"tiles\" aria-label=\"Headline numbers\">\n";
  body += report::html_tile(fmt::format("{:+.1f} dB", d.other_db - d.reference_db), "level of the other", "level");
  body += report::html_tile(fmt::format("{:.3f}", d.level_correlation), "correlation of the levels' course", "level");
  body += report::html_tile(fmt::format("{:.1f} dB", d.mean_band_difference_db), "between the spectra", "level");
  if (compared.events) body += event_tiles(compared.events->scores.front().second);
  body += "</ul>\n";
  body += report::html_section("Level", drawing("level", "Level over time", level_plot(d)),
                               fmt::format("RMS in {:g} ms. {:.1f} dB apart in the mean, where either sounds.",
                                           1000 * d.window_s, d.mean_level_difference_db));
  body += report::html_section(
      "Spectrum", drawing("spectrum", "Levels in third octaves", spectrum_plot(d)),
      fmt::format("Centroids {:.0f} Hz and, of the other, {:.0f} Hz.", d.reference_centroid_hz, d.other_centroid_hz));
  if (compared.events) {
    body += report::html_section("Events",
                                 drawing("events", "Timing of events", event_plot(*compared.events, compared.tolerance_ms)),
                                 event_captions(*compared.events, compared.tolerance_ms));
  }
  return report::html_page("Two sounds compared", fmt::format("reference {}, other {}", compared.reference, compared.other),
                           body, d.identical ? "The sounds are the same, sample for sample." : "Made by rustle compare.");
}

}  // namespace rustle::apps
