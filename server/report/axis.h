#pragma once

#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "server/report/canvas.h"

/// Axes: values to pixels, round ticks, labels. Pure.
namespace rustle::report {

/// Maps [from, to] of a quantity to [pixel_from, pixel_to], linearly or by its logarithm (\pre then from, to > 0).
struct Axis {
  double from = 0, to = 1;
  double pixel_from = 0, pixel_to = 1;
  bool logarithmic = false;
  double pixel(double value) const;
  double value(double pixel) const;
  double clamped_pixel(double value) const;  ///< never outside the axis
};

struct Tick {
  double value = 0;
  std::string label;  ///< empty: a mark without text
};

/// At most `most` ticks at multiples of 1, 2 or 5 times a power of ten, labelled with just the decimals they need.
/// \pre from < to, most >= 2
std::vector<Tick> linear_ticks(double from, double to, int most);

/// Decades labelled ("100", "1k", "0.01"), 2 to 9 between them unlabelled; also 2 and 5 labelled where fewer than two
/// decades lie within. \pre 0 < from < to
std::vector<Tick> logarithmic_ticks(double from, double to);

/// Three significant digits: "0.0123", "12.3", "1230", "1.2e-05"; "-" when not finite.
std::string short_number(double value);

/// Digits in groups of three: "12,345".
std::string grouped(std::uint64_t value);

inline constexpr double kLabelSize = 11.5;

/// Ticks and labels below a plot and vertical grid lines across it (grid.alpha 0: none). Labels that would touch are left
/// out.
void draw_horizontal_axis(Canvas& canvas, const Rect& plot, const Axis& axis, std::span<const Tick> ticks,
                          std::string_view title, const Paint& grid);

/// The same at the left of a plot, the title turned upward.
void draw_vertical_axis(Canvas& canvas, const Rect& plot, const Axis& axis, std::span<const Tick> ticks,
                        std::string_view title, const Paint& grid);

struct LegendEntry {
  std::string text;
  Paint paint;
  enum class Shape { kBox, kLine, kDashedLine, kDot, kRing, kSquare, kCross } shape = Shape::kBox;
};

double legend_width(std::span<const LegendEntry> entries, double size = kLabelSize);

/// Entries side by side from `left` on, around the base line `y`. Returns the right end.
double draw_legend(Canvas& canvas, const Point& left, std::span<const LegendEntry> entries, double size = kLabelSize);

}  // namespace rustle::report
