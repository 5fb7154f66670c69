#include "server/report/timeline.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include <fmt/format.h>

namespace rustle::report {
namespace {

constexpr double kHeightDecades = 3, kLeastHeight = 0.08;
constexpr double kLaneHeight = 44, kLaneGap = 7, kRowHeader = 24, kRowGap = 12;
constexpr double kTimelineLeft = 84, kTimelineRight = 16, kTimelineTop = 6, kTimelineBottom = 44;
constexpr double kLevelFloorDb = -90;

struct Row {
  std::string title;
  std::vector<EventMark> events;
  std::array<bool, kEventKinds> has{};
  int lanes() const { return std::max(1, static_cast<int>(std::count(has.begin(), has.end(), true))); }
};

std::vector<Row> timeline_rows(const TimelineInput& input) {
  std::vector<TimelineSheet> sheets(input.sheets.begin(), input.sheets.end());
  const auto known = [&](std::uint32_t id) {
    return std::any_of(sheets.begin(), sheets.end(), [id](const TimelineSheet& s) { return s.id == id; });
  };
  for (const EventMark& event : input.events) {
    if (!known(event.sheet)) sheets.push_back({event.sheet, ""});
  }
  std::vector<Row> rows;
  for (std::size_t i = 0; i < sheets.size(); ++i) {
    const bool joined = sheets.size() > kMostTimelineRows && i + 1 >= kMostTimelineRows;
    if (!joined || rows.size() < kMostTimelineRows) rows.emplace_back();
    Row& row = rows.back();
    row.title = joined ? fmt::format("{} more sheets", sheets.size() - (kMostTimelineRows - 1))
                       : fmt::format("sheet {}{}{}", sheets[i].id, sheets[i].name.empty() ? "" : ": ", sheets[i].name);
    for (const EventMark& event : input.events) {
      if (event.sheet != sheets[i].id) continue;
      row.events.push_back(event);
      row.has[static_cast<std::size_t>(event.kind)] = true;
    }
  }
  return rows;
}

double largest_amplitude(std::span<const EventMark> events, EventKind kind) {
  double largest = 0;
  for (const EventMark& event : events) {
    if (event.kind == kind && std::isfinite(event.amplitude)) largest = std::max(largest, event.amplitude);
  }
  return largest;
}

/// The next of 1, 2, 5 times a power of ten that is not below.
double round_up(double value) {
  if (!(value > 0)) return 1;
  const double decade = std::pow(10.0, std::floor(std::log10(value)));
  for (const double factor : {1.0, 2.0, 5.0}) {
    if (factor * decade >= value * (1 - 1e-9)) return factor * decade;
  }
  return 10 * decade;
}

void draw_speed_lane(Canvas& canvas, const Rect& lane, const Axis& time, std::span<const EventMark> events, EventKind kind) {
  const std::vector<double> speeds = speed_columns(time, events, kind, {});
  const double fastest = speeds.empty() ? 0 : *std::max_element(speeds.begin(), speeds.end());
  const double top = round_up(fastest);
  const Ink ink = ink_of(kind);
  const auto y_of = [&](double speed) { return lane.bottom() - 1 - (lane.height - 5) * std::clamp(speed / top, 0.0, 1.0); };
  canvas.line({lane.x, y_of(top)}, {lane.right(), y_of(top)}, {Ink::kGrid, 1, true});
  for (std::size_t from = 0; from < speeds.size();) {
    if (speeds[from] < 0) {
      ++from;
      continue;
    }
    std::size_t to = from;
    std::vector<Point> outline;
    for (; to < speeds.size() && speeds[to] >= 0; ++to) {
      outline.push_back({lane.x + static_cast<double>(to) + 0.5, y_of(speeds[to])});
    }
    const double left = lane.x + static_cast<double>(from), right = lane.x + static_cast<double>(to);
    outline.insert(outline.begin(), {left, outline.front().y});
    outline.push_back({right, outline.back().y});
    std::vector<Point> area = outline;
    area.insert(area.begin(), {left, lane.bottom()});
    area.push_back({right, lane.bottom()});
    canvas.polygon(area, {ink, 0.35});
    canvas.polyline(outline, {ink, 1.3});
    from = to;
  }
  canvas.text({lane.x - 7, y_of(top) + 8}, fmt::format("{:g} m/s", top),
              {.size = 10, .paint = Ink::kMuted, .align = Align::kRight});
}

}  // namespace

Ink ink_of(EventKind kind) {
  constexpr std::array<Ink, kEventKinds> inks = {Ink::kCrumpling, Ink::kFriction, Ink::kTearing};
  return inks[static_cast<std::size_t>(kind)];
}

double amplitude_height(double amplitude, double largest) {
  if (!(amplitude > 0) || !(largest > 0)) return kLeastHeight;
  return std::clamp(1 + (1 - kLeastHeight) * std::log10(amplitude / largest) / kHeightDecades, kLeastHeight, 1.0);
}

std::vector<LegendEntry> kind_legend(std::span<const EventMark> events) {
  std::vector<LegendEntry> entries;
  for (int k = 0; k < kEventKinds; ++k) {
    const EventKind kind = static_cast<EventKind>(k);
    if (std::any_of(events.begin(), events.end(), [kind](const EventMark& event) { return event.kind == kind; })) {
      entries.push_back({std::string(kind_name(kind)), ink_of(kind)});
    }
  }
  return entries;
}

void draw_crumpling_ticks(Canvas& canvas, const Rect& rect, const Axis& time, std::span<const EventMark> events,
                          const EventTicks& which) {
  const double largest = which.largest > 0 ? which.largest : largest_amplitude(events, EventKind::kCrumpling);
  std::vector<double> heights(static_cast<std::size_t>(std::max(0.0, std::ceil(rect.width))), 0.0);
  for (const EventMark& event : events) {
    if (event.kind != EventKind::kCrumpling || (!which.every_sheet && event.sheet != which.sheet)) continue;
    const double column = std::floor(time.pixel(event.time_s) - rect.x);
    if (!(column >= 0) || column >= static_cast<double>(heights.size())) continue;
    double& height = heights[static_cast<std::size_t>(column)];
    height = std::max(height, amplitude_height(event.amplitude, largest));
  }
  std::vector<std::pair<Point, Point>> lines;
  for (std::size_t column = 0; column < heights.size(); ++column) {
    if (heights[column] <= 0) continue;
    const double x = rect.x + static_cast<double>(column) + 0.5;
    lines.push_back({{x, rect.bottom()}, {x, rect.bottom() - heights[column] * rect.height}});
  }
  canvas.segments(lines, {Ink::kCrumpling, 1.4});
}

std::vector<double> speed_columns(const Axis& time, std::span<const EventMark> events, EventKind kind,
                                  const EventTicks& which) {
  std::vector<double> speeds(static_cast<std::size_t>(std::max(0.0, std::ceil(time.pixel_to - time.pixel_from))), -1.0);
  if (speeds.empty()) return speeds;
  const double last = static_cast<double>(speeds.size()) - 1;
  for (const EventMark& event : events) {
    if (event.kind != kind || (!which.every_sheet && event.sheet != which.sheet)) continue;
    const auto raise = [&](double from_s, double to_s, double from_speed, double to_speed) {
      const double from = time.pixel(from_s) - time.pixel_from, to = time.pixel(to_s) - time.pixel_from;
      if (!(to >= 0) || !(from <= last + 1)) return;
      const auto first_column = static_cast<std::size_t>(std::clamp(std::floor(from), 0.0, last));
      const auto last_column = static_cast<std::size_t>(std::clamp(std::floor(to), 0.0, last));
      for (std::size_t c = first_column; c <= last_column; ++c) {
        const double u = to > from ? std::clamp((static_cast<double>(c) + 0.5 - from) / (to - from), 0.0, 1.0) : 0.5;
        const double speed = from_speed + u * (to_speed - from_speed);
        if (std::isfinite(speed)) speeds[c] = std::max(speeds[c], std::max(0.0, speed));
      }
    };
    if (event.speeds.empty()) {
      raise(event.time_s, event.end_s, event.amplitude, event.amplitude);
    } else if (event.speeds.size() == 1) {
      raise(event.time_s, event.end_s, event.speeds[0].speed_m_per_s, event.speeds[0].speed_m_per_s);
    }
    for (std::size_t i = 1; i < event.speeds.size(); ++i) {
      raise(event.speeds[i - 1].time_s, event.speeds[i].time_s, event.speeds[i - 1].speed_m_per_s,
            event.speeds[i].speed_m_per_s);
    }
  }
  return speeds;
}

double timeline_height(const TimelineInput& input) {
  double height = kTimelineTop + kTimelineBottom;
  for (const Row& row : timeline_rows(input)) {
    height += kRowHeader + row.lanes() * kLaneHeight + (row.lanes() - 1) * kLaneGap + kRowGap;
  }
  return std::max(height - kRowGap, 110.0);
}

void draw_timeline(Canvas& canvas, const Rect& rect, const TimelineInput& input) {
  const double start_s = input.start_s, end_s = input.end_s > start_s ? input.end_s : start_s + 1;
  const Rect plot = {rect.x + kTimelineLeft, rect.y + kTimelineTop, rect.width - kTimelineLeft - kTimelineRight,
                     rect.height - kTimelineTop - kTimelineBottom};
  const Axis time = {start_s, end_s, plot.x, plot.right()};
  const std::vector<Tick> ticks = linear_ticks(start_s, end_s, std::max(2, static_cast<int>(plot.width / 75)));
  const std::vector<Row> rows = timeline_rows(input);
  double y = plot.y;
  for (const Row& row : rows) {
    canvas.text({rect.x + 4, y + 15}, fitted(row.title, rect.width - 20, 12.5, true), {.size = 12.5, .bold = true});
    y += kRowHeader;
    bool any = false;
    for (int k = 0; k < kEventKinds; ++k) {
      const EventKind kind = static_cast<EventKind>(k);
      const bool empty_row = std::none_of(row.has.begin(), row.has.end(), [](bool b) { return b; });
      if (!row.has[static_cast<std::size_t>(k)] && !(empty_row && k == 0)) continue;
      if (any) y += kLaneGap;
      any = true;
      const Rect lane = {plot.x, y, plot.width, kLaneHeight};
      canvas.rectangle(lane, Ink::kPanel);
      std::vector<std::pair<Point, Point>> grid;
      for (const Tick& tick : ticks)
        grid.push_back({{time.pixel(tick.value), y}, {time.pixel(tick.value), y + kLaneHeight}});
      canvas.segments(grid, {Ink::kGrid, 1});
      canvas.line({lane.x, lane.bottom()}, {lane.right(), lane.bottom()}, {Ink::kFrame, 1});
      if (empty_row) {
        canvas.text({lane.x + 10, y + kLaneHeight / 2 + 4}, "no events", {.size = kLabelSize, .paint = Ink::kMuted});
      } else {
        canvas.text({plot.x - 7, y + kLaneHeight - 5}, kind_name(kind),
                    {.size = kLabelSize, .paint = ink_of(kind), .align = Align::kRight, .bold = true});
        if (kind == EventKind::kCrumpling) {
          const double largest = largest_amplitude(row.events, kind);
          draw_crumpling_ticks(canvas, {lane.x, lane.y + 4, lane.width, lane.height - 4}, time, row.events,
                               {.largest = largest});
          canvas.text({lane.x - 7, y + 12}, fmt::format("{} m", short_number(largest)),
                      {.size = 10, .paint = Ink::kMuted, .align = Align::kRight});
        } else {
          draw_speed_lane(canvas, lane, time, row.events, kind);
        }
      }
      y += kLaneHeight;
    }
    y += kRowGap;
  }
  if (rows.empty()) {
    canvas.rectangle(plot, Ink::kPanel);
    canvas.text({plot.x + plot.width / 2, plot.y + plot.height / 2}, "no sheets and no events",
                {.size = 12, .paint = Ink::kMuted, .align = Align::kCentre});
    y = plot.bottom();
  } else {
    y -= kRowGap;
  }
  draw_horizontal_axis(canvas, {plot.x, plot.y, plot.width, y - plot.y}, time, ticks, "simulation time (s)",
                       {Ink::kGrid, 0});
}

void draw_levels(Canvas& canvas, const Rect& rect, const LevelTrack& track, double end_s, double limit_db) {
  const double start_s = track.start_s, stop_s = end_s > start_s ? end_s : start_s + 1;
  const Rect plot = {rect.x + 62, rect.y + 30, rect.width - 62 - kTimelineRight, rect.height - 30 - 24};
  canvas.rectangle(plot, Ink::kPanel);
  const Axis time = {start_s, stop_s, plot.x, plot.right()};
  const Axis level = {kLevelFloorDb, 6, plot.bottom(), plot.y};
  const std::vector<Tick> times = linear_ticks(start_s, stop_s, std::max(2, static_cast<int>(plot.width / 75)));
  const std::vector<Tick> levels = linear_ticks(kLevelFloorDb, 6, std::max(2, static_cast<int>(plot.height / 22)));
  draw_horizontal_axis(canvas, plot, time, times, "", Ink::kGrid);
  draw_vertical_axis(canvas, plot, level, levels, "level (dBFS)", Ink::kGrid);

  /// A point per window, or per pixel where windows are narrower.
  const std::size_t windows = track.rms_db.size();
  const auto columns = static_cast<std::size_t>(std::max(1.0, std::floor(plot.width)));
  const std::size_t points = std::min(windows, columns);
  std::vector<Point> rms_line, peak_line, area;
  for (std::size_t i = 0; i < points; ++i) {
    const std::size_t from = i * windows / points, to = std::max(from + 1, (i + 1) * windows / points);
    double rms = kSilenceDb, peak = kSilenceDb;
    for (std::size_t w = from; w < to; ++w) {
      rms = std::max(rms, static_cast<double>(track.rms_db[w]));
      peak = std::max(peak, static_cast<double>(track.peak_db[w]));
    }
    const double x = time.clamped_pixel(start_s + 0.5 * static_cast<double>(from + to) * track.window_s);
    rms_line.push_back({x, level.clamped_pixel(rms)});
    peak_line.push_back({x, level.clamped_pixel(peak)});
  }
  canvas.clip(plot);
  if (!rms_line.empty()) {
    area = rms_line;
    area.insert(area.begin(), {area.front().x, plot.bottom()});
    area.push_back({area.back().x, plot.bottom()});
    canvas.polygon(area, {Ink::kLevel, 0.28});
    canvas.polyline(peak_line, {Ink::kPeak, 1});
    canvas.polyline(rms_line, {Ink::kLevel, 1.5});
  }
  canvas.line({plot.x, level.pixel(0)}, {plot.right(), level.pixel(0)}, {Ink::kLimit, 1});
  const bool limited = limit_db < -0.05 && limit_db > kLevelFloorDb;
  if (limited) canvas.line({plot.x, level.pixel(limit_db)}, {plot.right(), level.pixel(limit_db)}, {Ink::kLimit, 1, true});
  canvas.unclip();
  std::vector<LegendEntry> legend = {{"RMS", Ink::kLevel, LegendEntry::Shape::kLine},
                                     {"peak", Ink::kPeak, LegendEntry::Shape::kLine},
                                     {"0 dBFS", Ink::kLimit, LegendEntry::Shape::kLine}};
  if (limited) legend.push_back({fmt::format("limiter {:g} dB", limit_db), Ink::kLimit, LegendEntry::Shape::kDashedLine});
  const double legend_x = std::max(rect.x + 2, plot.right() - legend_width(legend));
  draw_legend(canvas, {legend_x, rect.y + 18}, legend);
}

void draw_waveform(Canvas& canvas, const Rect& rect, const Sound& sound) {
  const double end_s = sound.end_s() > sound.start_s ? sound.end_s() : sound.start_s + 1;
  const Rect plot = {rect.x + 62, rect.y + 8, rect.width - 62 - kTimelineRight, rect.height - 8 - kTimelineBottom};
  canvas.rectangle(plot, Ink::kPanel);
  const auto columns = static_cast<std::size_t>(std::max(1.0, std::floor(plot.width)));
  const std::size_t channels = static_cast<std::size_t>(std::max(1, sound.channels));
  std::vector<std::pair<double, double>> ranges(columns, {0.0, 0.0});
  double greatest = 0;
  for (std::size_t i = 0; i < sound.frames() * channels; ++i) {
    const double x = sound.samples[i];
    if (!std::isfinite(x)) continue;
    auto& [low, high] = ranges[std::min(columns - 1, i / channels * columns / sound.frames())];
    low = std::min(low, x);
    high = std::max(high, x);
    greatest = std::max(greatest, std::abs(x));
  }
  const double top = greatest > 0 ? round_up(greatest) : 1;
  const Axis time = {sound.start_s, end_s, plot.x, plot.right()};
  const Axis value = {-top, top, plot.bottom(), plot.y};
  const std::vector<Tick> values = {{-top, fmt::format("{:g}", -top)}, {0, "0"}, {top, fmt::format("{:g}", top)}};
  draw_horizontal_axis(canvas, plot, time,
                       linear_ticks(sound.start_s, end_s, std::max(2, static_cast<int>(plot.width / 75))),
                       "simulation time (s)", Ink::kGrid);
  draw_vertical_axis(canvas, plot, value, values, "sample", Ink::kGrid);
  std::vector<std::pair<Point, Point>> lines;
  for (std::size_t c = 0; c < columns && sound.frames() > 0; ++c) {
    const double x = plot.x + static_cast<double>(c) + 0.5;
    lines.push_back({{x, value.pixel(ranges[c].second) - 0.4}, {x, value.pixel(ranges[c].first) + 0.4}});
  }
  canvas.segments(lines, {Ink::kLevel, 1});
}

}  // namespace rustle::report
