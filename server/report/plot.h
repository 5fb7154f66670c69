#pragma once

#include <string>
#include <vector>

#include "server/report/axis.h"
#include "server/report/canvas.h"

/// Charts of one quantity over another. Pure drawing.
namespace rustle::report {

struct PlotSeries {
  enum class Style : std::uint8_t { kLine, kDashed, kDots, kRings, kCrosses, kBars };
  std::string label;          ///< empty: not in the legend
  std::vector<Point> points;  ///< in the axes' quantities; those that are not finite are left out, and break a line
  Paint paint = Ink::kLevel;
  Style style = Style::kLine;
};

/// A filled rectangle behind the series, in the axes' quantities; where it is infinite it goes to the border.
struct PlotBand {
  double x_from = 0, x_to = 0, y_from = 0, y_to = 0;
  Paint paint{Ink::kLevel, 0.14};
};

struct PlotAxis {
  std::string title;
  bool logarithmic = false;
  double from = 0, to = 0;  ///< equal: as the points need it
  std::vector<Tick> ticks;  ///< empty: round numbers
};

struct Plot {
  PlotAxis x, y;
  std::vector<PlotSeries> series;
  std::vector<PlotBand> bands;
};

/// Legend above, axes left and below, the series clipped to the plot between them.
void draw_plot(Canvas& canvas, const Rect& rect, const Plot& plot);

/// One of eight colours for series, each readable on light and on dark ground (taken modulo).
Colour series_colour(int index);

}  // namespace rustle::report
