#include "server/report/plot.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

namespace rustle::report {
namespace {

constexpr double kPlotLeft = 64, kPlotRight = 16, kPlotBottom = 46, kLegendRow = 18;

using Style = PlotSeries::Style;

/// The range of the axis: as given, or that of the points with a little room.
Axis fitted_axis(const PlotAxis& wanted, const std::vector<PlotSeries>& series, double Point::*coordinate) {
  Axis axis;
  axis.logarithmic = wanted.logarithmic;
  if (wanted.from != wanted.to) {
    axis.from = wanted.from;
    axis.to = wanted.to;
    return axis;
  }
  double least = std::numeric_limits<double>::infinity(), greatest = -least;
  for (const PlotSeries& one : series) {
    for (const Point& point : one.points) {
      const double value = point.*coordinate;
      if (!std::isfinite(value) || (axis.logarithmic && value <= 0)) continue;
      least = std::min(least, value);
      greatest = std::max(greatest, value);
    }
  }
  if (!(least <= greatest)) {
    least = axis.logarithmic ? 1 : 0;
    greatest = axis.logarithmic ? 10 : 1;
  }
  if (axis.logarithmic) {
    axis.from = least / 1.25;
    axis.to = greatest * 1.25;
  } else {
    const double room = greatest > least ? 0.06 * (greatest - least) : std::max(1e-6, 0.1 * std::abs(greatest));
    axis.from = least - room;
    axis.to = greatest + room;
  }
  return axis;
}

LegendEntry::Shape symbol(Style style) {
  switch (style) {
    case Style::kLine:
      return LegendEntry::Shape::kLine;
    case Style::kDashed:
      return LegendEntry::Shape::kDashedLine;
    case Style::kDots:
      return LegendEntry::Shape::kDot;
    case Style::kRings:
      return LegendEntry::Shape::kRing;
    case Style::kCrosses:
      return LegendEntry::Shape::kCross;
    case Style::kBars:
      break;
  }
  return LegendEntry::Shape::kBox;
}

/// Rows of legend entries, each as wide as fits.
std::vector<std::vector<LegendEntry>> legend_rows(const Plot& plot, double width) {
  std::vector<std::vector<LegendEntry>> rows;
  for (const PlotSeries& series : plot.series) {
    if (series.label.empty()) continue;
    const LegendEntry entry{series.label, series.paint, symbol(series.style)};
    if (rows.empty()) rows.emplace_back();
    rows.back().push_back(entry);
    if (rows.back().size() > 1 && legend_width(rows.back()) > width) {
      rows.back().pop_back();
      rows.push_back({entry});
    }
  }
  return rows;
}

void draw_line(Canvas& canvas, const std::vector<Point>& pixels, const Stroke& stroke) {
  std::vector<Point> run;
  const auto flush = [&] {
    if (run.size() > 1) canvas.polyline(run, stroke);
    run.clear();
  };
  for (const Point& p : pixels) {
    if (std::isfinite(p.x) && std::isfinite(p.y)) {
      run.push_back(p);
    } else {
      flush();
    }
  }
  flush();
}

void draw_series(Canvas& canvas, const PlotSeries& series, const std::vector<Point>& pixels, const Rect& area) {
  if (series.style == Style::kLine || series.style == Style::kDashed) {
    draw_line(canvas, pixels, {series.paint, series.style == Style::kLine ? 1.8 : 1.4, series.style == Style::kDashed});
    return;
  }
  for (const Point& p : pixels) {
    if (!std::isfinite(p.x) || !std::isfinite(p.y)) continue;
    switch (series.style) {
      case Style::kDots:
        canvas.disc(p, 3.4, series.paint);
        break;
      case Style::kRings:
        canvas.circle(p, 4.6, {series.paint, 1.8});
        break;
      case Style::kBars: {
        const double top = std::clamp(p.y, area.y, area.bottom());
        canvas.rectangle({p.x - 4, top, 8, area.bottom() - top}, series.paint);
        break;
      }
      default: {
        const std::array<std::pair<Point, Point>, 2> cross = {
            {{{p.x - 3.5, p.y}, {p.x + 3.5, p.y}}, {{p.x, p.y - 3.5}, {p.x, p.y + 3.5}}}};
        canvas.segments(cross, {series.paint, 1.2});
      }
    }
  }
}

}  // namespace

void draw_plot(Canvas& canvas, const Rect& rect, const Plot& plot) {
  const double plot_width = rect.width - kPlotLeft - kPlotRight;
  const auto legend = legend_rows(plot, plot_width);
  const double top = rect.y + 8 + kLegendRow * static_cast<double>(legend.size());
  const Rect area = {rect.x + kPlotLeft, top, plot_width, std::max(20.0, rect.bottom() - kPlotBottom - top)};
  for (std::size_t row = 0; row < legend.size(); ++row) {
    draw_legend(canvas, {area.x, rect.y + 14 + kLegendRow * static_cast<double>(row)}, legend[row]);
  }
  canvas.rectangle(area, Ink::kPanel);
  Axis x = fitted_axis(plot.x, plot.series, &Point::x), y = fitted_axis(plot.y, plot.series, &Point::y);
  x.pixel_from = area.x;
  x.pixel_to = area.right();
  y.pixel_from = area.bottom();
  y.pixel_to = area.y;

  canvas.clip(area);
  for (const PlotBand& band : plot.bands) {
    const auto within = [](const Axis& axis, double value) {
      if (axis.logarithmic && value <= 0) return axis.pixel_from;
      return axis.clamped_pixel(std::clamp(value, -1e300, 1e300));
    };
    const double left = within(x, band.x_from), right = within(x, band.x_to);
    const double low = within(y, band.y_from), high = within(y, band.y_to);
    canvas.rectangle({left, high, std::max(1.0, right - left), std::max(1.0, low - high)}, band.paint);
  }
  canvas.unclip();
  const auto ticks = [](const PlotAxis& wanted, const Axis& axis, double pixels, double spacing) {
    if (!wanted.ticks.empty()) return wanted.ticks;
    if (axis.logarithmic) return logarithmic_ticks(axis.from, axis.to);
    return linear_ticks(axis.from, axis.to, std::max(2, static_cast<int>(pixels / spacing)));
  };
  draw_vertical_axis(canvas, area, y, ticks(plot.y, y, area.height, 34), plot.y.title, Ink::kGrid);
  draw_horizontal_axis(canvas, area, x, ticks(plot.x, x, area.width, 64), plot.x.title, Ink::kGrid);
  canvas.frame(area, {Ink::kFrame, 1});

  canvas.clip(area);
  for (const PlotSeries& series : plot.series) {
    std::vector<Point> pixels;
    for (const Point& point : series.points) {
      const bool shown = (!x.logarithmic || point.x > 0) && (!y.logarithmic || point.y > 0);
      const double far = 4 * (rect.width + rect.height);
      Point p = {shown ? x.pixel(point.x) : std::nan(""), shown ? y.pixel(point.y) : std::nan("")};
      if (std::isfinite(p.y)) p.y = std::clamp(p.y, -far, far);
      pixels.push_back(p);
    }
    draw_series(canvas, series, pixels, area);
  }
  canvas.unclip();
}

Colour series_colour(int index) {
  constexpr std::array<double, 8> hues_deg = {250, 45, 150, 330, 90, 200, 15, 290};
  const auto k = static_cast<std::size_t>(index < 0 ? -index : index) % hues_deg.size();
  return from_oklch(0.64, 0.15, hues_deg[k]);
}

}  // namespace rustle::report
