#include "server/report/charts.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <set>
#include <tuple>

#include <fmt/format.h>

#include "server/report/axis.h"
#include "server/report/timeline.h"

namespace rustle::report {
namespace {

constexpr double kChartLeft = 58, kChartRight = 16, kChartBottom = 44;
constexpr int kBarsPerDecade = 4;

void say(Canvas& canvas, const Rect& plot, std::string_view text) {
  canvas.text({plot.x + plot.width / 2, plot.y + plot.height / 2 + 4}, text,
              {.size = 12, .paint = Ink::kMuted, .align = Align::kCentre});
}

}  // namespace

void draw_amplitude_histogram(Canvas& canvas, const Rect& rect, std::span<const EventMark> events) {
  const Rect plot = {rect.x + kChartLeft, rect.y + 14, rect.width - kChartLeft - kChartRight,
                     rect.height - 14 - kChartBottom};
  canvas.rectangle(plot, Ink::kPanel);
  std::vector<int> bins;
  for (const EventMark& event : events) {
    if (event.kind != EventKind::kCrumpling || !(event.amplitude > 0) || !std::isfinite(event.amplitude)) continue;
    bins.push_back(static_cast<int>(std::floor(kBarsPerDecade * std::log10(event.amplitude))));
  }
  if (bins.empty()) {
    canvas.frame(plot, {Ink::kGrid, 1});
    say(canvas, plot, "no crumpling events");
    return;
  }
  const auto [least, greatest] = std::minmax_element(bins.begin(), bins.end());
  int first = *least - 1, last = *greatest + 2;
  while (last - first < 2 * kBarsPerDecade) {
    --first;
    if (last - first < 2 * kBarsPerDecade) ++last;
  }
  std::vector<int> counts(static_cast<std::size_t>(last - first), 0);
  for (const int bin : bins) ++counts[static_cast<std::size_t>(bin - first)];
  const double most = *std::max_element(counts.begin(), counts.end());

  const auto edge = [](int bin) { return std::pow(10.0, static_cast<double>(bin) / kBarsPerDecade); };
  const Axis amplitude = {edge(first), edge(last), plot.x, plot.right(), true};
  const Axis count = {0.7, std::max(12.0, most * 1.5), plot.bottom(), plot.y, true};
  std::vector<Tick> amplitudes = logarithmic_ticks(amplitude.from, amplitude.to);
  draw_horizontal_axis(canvas, plot, amplitude, amplitudes, "amplitude (m)", Ink::kGrid);
  draw_vertical_axis(canvas, plot, count, logarithmic_ticks(count.from, count.to), "events", Ink::kGrid);
  for (std::size_t i = 0; i < counts.size(); ++i) {
    if (counts[i] == 0) continue;
    const double left = amplitude.pixel(edge(first + static_cast<int>(i)));
    const double right = amplitude.pixel(edge(first + static_cast<int>(i) + 1)), top = count.pixel(counts[i]);
    canvas.rectangle({left + 1, top, right - left - 2, plot.bottom() - top}, {Ink::kCrumpling, 0.8});
    canvas.text({(left + right) / 2, top - 4}, fmt::format("{}", counts[i]),
                {.size = 10, .paint = Ink::kMuted, .align = Align::kCentre});
  }
  canvas.line({plot.x, plot.bottom()}, {plot.right(), plot.bottom()}, {Ink::kFrame, 1});
}

void draw_resonators(Canvas& canvas, const Rect& rect, std::span<const EventMark> events,
                     std::span<const PackGridPoint> grid) {
  constexpr double kStrip = 26, kGap = 6;
  std::vector<LegendEntry> legend = kind_legend(events);
  for (LegendEntry& entry : legend) entry.shape = LegendEntry::Shape::kDot;
  if (!grid.empty()) legend.push_back({"sound pack", Ink::kMuted, LegendEntry::Shape::kCross});
  draw_legend(canvas, {std::max(rect.x + 4, rect.right() - kChartRight - legend_width(legend)), rect.y + 16}, legend);
  const Rect plot = {rect.x + kChartLeft, rect.y + 28, rect.width - kChartLeft - kChartRight,
                     rect.height - 28 - kChartBottom - kStrip - kGap};
  const Rect strip = {plot.x, plot.bottom() + kGap, plot.width, kStrip};
  canvas.rectangle(plot, Ink::kPanel);
  canvas.rectangle(strip, Ink::kPanel);

  double longest_ruling = 0, longest_border = 0;
  const auto stretch = [&](double ruling_m, double border_m) {
    if (std::isfinite(ruling_m)) longest_ruling = std::max(longest_ruling, ruling_m);
    if (std::isfinite(border_m)) longest_border = std::max(longest_border, border_m);
  };
  for (const PackGridPoint& point : grid) stretch(point.ruling_length_m, point.free_border_length_m);
  for (const EventMark& event : events) {
    for (const ResonatorMark& r : event.resonators) stretch(r.ruling_length_m, r.constrained ? 0 : r.free_border_length_m);
  }
  const Axis ruling = {0, (longest_ruling > 0 ? longest_ruling : 0.3) * 106, plot.x, plot.right()};
  const Axis border = {0, (longest_border > 0 ? longest_border : 0.6) * 106, plot.bottom(), plot.y};
  const std::vector<Tick> rulings = linear_ticks(ruling.from, ruling.to, std::max(2, static_cast<int>(plot.width / 48)));
  draw_vertical_axis(canvas, plot, border,
                     linear_ticks(border.from, border.to, std::max(2, static_cast<int>(plot.height / 30))),
                     "free border l_c (cm)", Ink::kGrid);
  std::vector<std::pair<Point, Point>> lines;
  for (const Tick& tick : rulings)
    lines.push_back({{ruling.pixel(tick.value), plot.y}, {ruling.pixel(tick.value), plot.bottom()}});
  canvas.segments(lines, {Ink::kGrid, 1});
  draw_horizontal_axis(canvas, strip, ruling, rulings, "ruling l_r (cm)", Ink::kGrid);
  canvas.frame(plot, {Ink::kFrame, 1});
  canvas.frame(strip, {Ink::kFrame, 1});
  canvas.text({strip.x - 7, strip.y + kStrip / 2 + 1}, "con-", {.size = 10, .paint = Ink::kMuted, .align = Align::kRight});
  canvas.text({strip.x - 7, strip.y + kStrip / 2 + 12}, "strained",
              {.size = 10, .paint = Ink::kMuted, .align = Align::kRight});

  std::vector<std::pair<Point, Point>> crosses;
  for (const PackGridPoint& point : grid) {
    if (point.ruling_length_m <= 0 || point.free_border_length_m <= 0) continue;
    const double x = ruling.pixel(100 * point.ruling_length_m), y = border.pixel(100 * point.free_border_length_m);
    crosses.push_back({{x - 3, y}, {x + 3, y}});
    crosses.push_back({{x, y - 3}, {x, y + 3}});
  }
  canvas.segments(crosses, {{Ink::kMuted, 0.55}, 1});
  std::set<std::tuple<int, int, int>> drawn;
  for (const EventMark& event : events) {
    for (const ResonatorMark& r : event.resonators) {
      if (!std::isfinite(r.ruling_length_m) || !std::isfinite(r.free_border_length_m)) continue;
      const double x = ruling.clamped_pixel(100 * r.ruling_length_m);
      const double lane = 0.28 + 0.22 * static_cast<double>(event.kind);
      const double y = r.constrained ? strip.y + kStrip * lane : border.clamped_pixel(100 * r.free_border_length_m);
      const int kind = static_cast<int>(event.kind);
      if (!drawn.insert({kind, static_cast<int>(std::lround(x)), static_cast<int>(std::lround(y))}).second) continue;
      canvas.disc({x, y}, r.constrained ? 2.6 : 3.4, {ink_of(event.kind), 0.6});
    }
  }
  if (drawn.empty()) say(canvas, plot, "no resonators");
}

}  // namespace rustle::report
