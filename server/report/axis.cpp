#include "server/report/axis.h"

#include <algorithm>
#include <array>
#include <cassert>
#include <cmath>

#include <fmt/format.h>

namespace rustle::report {
namespace {

constexpr double kTickLength = 4;
constexpr double kSymbol = 14;    ///< width of a legend's symbol
constexpr double kEntryGap = 16;  ///< between legend entries

std::string engineering(double value) {
  if (value >= 1e6) return fmt::format("{:g}M", value / 1e6);
  if (value >= 1e3) return fmt::format("{:g}k", value / 1e3);
  return fmt::format("{:g}", value);
}

void draw_symbol(Canvas& canvas, double x, double y, const LegendEntry& entry) {
  using Shape = LegendEntry::Shape;
  const Point centre = {x + kSymbol / 2, y};
  switch (entry.shape) {
    case Shape::kBox:
      canvas.rectangle({x + 1, y - 5, kSymbol - 4, 10}, entry.paint);
      if (!entry.paint.themed) canvas.frame({x + 1.5, y - 4.5, kSymbol - 5, 9}, {Ink::kFrame, 1});
      break;
    case Shape::kLine:
      canvas.line({x, y}, {x + kSymbol, y}, {entry.paint, 2});
      break;
    case Shape::kDashedLine:
      canvas.line({x, y}, {x + kSymbol, y}, {entry.paint, 1.5, true});
      break;
    case Shape::kDot:
      canvas.disc(centre, 3.5, entry.paint);
      break;
    case Shape::kRing:
      canvas.circle(centre, 4.5, {entry.paint, 1.8});
      break;
    case Shape::kSquare:
      canvas.rectangle({centre.x - 3.5, y - 3.5, 7, 7}, entry.paint);
      break;
    case Shape::kCross: {
      const std::array<std::pair<Point, Point>, 2> cross = {
          {{{centre.x - 3.5, y}, {centre.x + 3.5, y}}, {{centre.x, y - 3.5}, {centre.x, y + 3.5}}}};
      canvas.segments(cross, {entry.paint, 1.2});
      break;
    }
  }
}

}  // namespace

double Axis::pixel(double value) const {
  const double u = logarithmic ? std::log(value / from) / std::log(to / from) : (value - from) / (to - from);
  return pixel_from + u * (pixel_to - pixel_from);
}

double Axis::value(double pixel) const {
  const double u = (pixel - pixel_from) / (pixel_to - pixel_from);
  return logarithmic ? from * std::pow(to / from, u) : from + u * (to - from);
}

double Axis::clamped_pixel(double value) const {
  return pixel(std::clamp(value, std::min(from, to), std::max(from, to)));
}

std::vector<Tick> linear_ticks(double from, double to, int most) {
  assert(from < to && most >= 2);
  const double raw = (to - from) / most;
  const int decade = static_cast<int>(std::floor(std::log10(raw)));
  const auto count = [&](double step) { return std::floor(to / step + 1e-9) - std::ceil(from / step - 1e-9) + 1; };
  double step = std::pow(10.0, decade);
  int decimals = std::max(0, -decade);
  for (const double factor : {1.0, 2.0, 5.0, 10.0, 20.0}) {
    step = factor * std::pow(10.0, decade);
    decimals = std::max(0, factor >= 10 ? -decade - 1 : -decade);
    if (count(step) <= most) break;
  }
  std::vector<Tick> ticks;
  for (double k = std::ceil(from / step - 1e-9); k * step <= to + 1e-9 * step; ++k) {
    const double value = k == 0 ? 0.0 : k * step;
    ticks.push_back({value, fmt::format("{:.{}f}", value, decimals)});
  }
  return ticks;
}

std::vector<Tick> logarithmic_ticks(double from, double to) {
  assert(0 < from && from < to);
  const int first = static_cast<int>(std::floor(std::log10(from))), last = static_cast<int>(std::ceil(std::log10(to)));
  int decades = 0;
  for (int d = first; d <= last; ++d) {
    const double value = std::pow(10.0, d);
    decades += value >= from * (1 - 1e-9) && value <= to * (1 + 1e-9);
  }
  std::vector<Tick> ticks;
  for (int d = first; d <= last; ++d) {
    for (int k = 1; k <= 9; ++k) {
      const double value = k * std::pow(10.0, d);
      if (value < from * (1 - 1e-9) || value > to * (1 + 1e-9)) continue;
      const bool labelled = k == 1 || (decades < 2 && (k == 2 || k == 5));
      ticks.push_back({value, labelled ? engineering(value) : std::string()});
    }
  }
  return ticks;
}

std::string short_number(double value) {
  if (!std::isfinite(value)) return "-";
  if (value == 0) return "0";
  const double size = std::abs(value);
  if (size < 1e-4 || size >= 1e7) return fmt::format("{:.1e}", value);
  const int digits = std::max(0, 2 - static_cast<int>(std::floor(std::log10(size))));
  return fmt::format("{:.{}f}", value, digits);
}

std::string grouped(std::uint64_t value) {
  std::string digits = fmt::format("{}", value);
  for (std::size_t at = digits.size(); at > 3;) digits.insert(at -= 3, 1, ',');
  return digits;
}

void draw_horizontal_axis(Canvas& canvas, const Rect& plot, const Axis& axis, std::span<const Tick> ticks,
                          std::string_view title, const Paint& grid) {
  std::vector<std::pair<Point, Point>> lines, marks;
  double free_from = -1e9;
  for (const Tick& tick : ticks) {
    const double x = axis.pixel(tick.value);
    const bool labelled = !tick.label.empty();
    if (labelled && x > plot.x + 1 && x < plot.right() - 1) lines.push_back({{x, plot.y}, {x, plot.bottom()}});
    marks.push_back({{x, plot.bottom()}, {x, plot.bottom() + (labelled ? kTickLength : kTickLength / 2)}});
    if (!labelled) continue;
    const double half = text_width(tick.label, kLabelSize) / 2;
    if (x - half < free_from) continue;
    canvas.text({x, plot.bottom() + kTickLength + kLabelSize + 1}, tick.label,
                {.size = kLabelSize, .paint = Ink::kMuted, .align = Align::kCentre});
    free_from = x + half + 6;
  }
  if (grid.alpha > 0) canvas.segments(lines, {grid, 1});
  canvas.segments(marks, {Ink::kFrame, 1});
  if (!title.empty()) {
    canvas.text({plot.x + plot.width / 2, plot.bottom() + kTickLength + 2.6 * kLabelSize + 2}, title,
                {.size = kLabelSize, .paint = Ink::kMuted, .align = Align::kCentre});
  }
}

void draw_vertical_axis(Canvas& canvas, const Rect& plot, const Axis& axis, std::span<const Tick> ticks,
                        std::string_view title, const Paint& grid) {
  std::vector<std::pair<Point, Point>> lines, marks;
  double widest = 0, free_above = 1e9;
  for (const Tick& tick : ticks) {
    const double y = axis.pixel(tick.value);
    const bool labelled = !tick.label.empty();
    if (labelled && y > plot.y + 1 && y < plot.bottom() - 1) lines.push_back({{plot.x, y}, {plot.right(), y}});
    marks.push_back({{plot.x - (labelled ? kTickLength : kTickLength / 2), y}, {plot.x, y}});
    if (!labelled || y + kLabelSize / 2 > free_above) continue;
    canvas.text({plot.x - kTickLength - 3, y + 0.36 * kLabelSize}, tick.label,
                {.size = kLabelSize, .paint = Ink::kMuted, .align = Align::kRight});
    widest = std::max(widest, text_width(tick.label, kLabelSize));
    free_above = y - kLabelSize / 2 - 1;
  }
  if (grid.alpha > 0) canvas.segments(lines, {grid, 1});
  canvas.segments(marks, {Ink::kFrame, 1});
  if (!title.empty()) {
    canvas.text({plot.x - kTickLength - 10 - widest, plot.y + plot.height / 2}, title,
                {.size = kLabelSize, .paint = Ink::kMuted, .align = Align::kCentre, .upward = true});
  }
}

double legend_width(std::span<const LegendEntry> entries, double size) {
  double width = 0;
  for (const LegendEntry& entry : entries) width += kSymbol + 5 + text_width(entry.text, size) + kEntryGap;
  return entries.empty() ? 0 : width - kEntryGap;
}

double draw_legend(Canvas& canvas, const Point& left, std::span<const LegendEntry> entries, double size) {
  double x = left.x;
  for (const LegendEntry& entry : entries) {
    draw_symbol(canvas, x, left.y - 0.36 * size, entry);
    canvas.text({x + kSymbol + 5, left.y}, entry.text, {.size = size, .paint = Ink::kMuted});
    x += kSymbol + 5 + text_width(entry.text, size) + kEntryGap;
  }
  return entries.empty() ? x : x - kEntryGap;
}

}  // namespace rustle::report
