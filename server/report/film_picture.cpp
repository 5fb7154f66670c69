#include "server/report/film_picture.h"

#include <algorithm>
#include <array>
#include <cassert>
#include <cmath>
#include <limits>

#include <fmt/format.h>

#include "server/report/sheet_drawing.h"
#include "server/report/timeline.h"

namespace rustle::report {
namespace {

constexpr double kMargin = 16, kGap = 8, kHeader = 22, kTitle = 44;
constexpr double kWidest = 460, kNarrowest = 150, kUsualWidth = 1400, kLeastWidth = 760;
constexpr double kTallestGrid = 12000;
constexpr double kWantedAspect = 1.5;  // width / height of the grid
constexpr double kFollowBeyond = 3;    // times the largest frame's own size
constexpr std::size_t kRings = 8;
constexpr double kTimeline = 74;

double pixel_of_bounds(const Bounds& bounds) {
  return std::max({bounds.width(), bounds.height(), 1e-6});
}

/// What every cell shows: a piece of the camera's plane.
struct Window {
  double width_m = 0, height_m = 0;
  bool follows = false;
  double u_m = 0, v_m = 0;  ///< its middle when it stands still
};

Window window_of(const std::vector<Bounds>& frames) {
  Bounds all;
  double width_m = 0, height_m = 0;
  for (const Bounds& own : frames) {
    if (own.empty()) continue;
    all.add(own.left, own.bottom);
    all.add(own.right, own.top);
    width_m = std::max(width_m, own.width());
    height_m = std::max(height_m, own.height());
  }
  if (all.empty()) return {0.1, 0.1, false, 0, 0};
  const double size = std::max({width_m, height_m, 1e-6});
  if (pixel_of_bounds(all) > kFollowBeyond * size)
    return {std::max(width_m, 0.05 * size), std::max(height_m, 0.05 * size), true, 0, 0};
  return {std::max(all.width(), 1e-6), std::max(all.height(), 1e-6), false, (all.left + all.right) / 2,
          (all.bottom + all.top) / 2};
}

void draw_time_line(Canvas& canvas, const Rect& rect, const Film& film) {
  double from_s = film.from_s, to_s = film.to_s;
  if (!(to_s > from_s)) to_s = from_s + 1e-3;
  const Axis axis = {from_s, to_s, rect.x, rect.right()};
  std::vector<EventMark> events;
  for (const SheetView& frame : film.frames) events.insert(events.end(), frame.events.begin(), frame.events.end());
  const Rect plot = {rect.x, rect.y, rect.width, 30};
  canvas.rectangle(plot, Ink::kPanel);
  draw_crumpling_ticks(canvas, plot, axis, events, {});
  canvas.frame(plot, {Ink::kGrid, 1});
  for (const SheetView& frame : film.frames) {
    const double x = axis.clamped_pixel(frame.time_s);
    const std::array<Point, 3> mark = {{{x, plot.y}, {x - 4, plot.y - 7}, {x + 4, plot.y - 7}}};
    canvas.polygon(mark, Ink::kText);
  }
  const std::vector<Tick> ticks = linear_ticks(from_s, to_s, 12);
  draw_horizontal_axis(canvas, plot, axis, ticks, "simulation time (s)", {Ink::kGrid, 0});
}

std::string counts_of(const SheetView& view) {
  const auto counted = [](std::size_t count, const char* noun) {
    return count == 0 ? std::string() : fmt::format("{} {}{}", grouped(count), noun, count == 1 ? "" : "s");
  };
  const std::string events = counted(view.events.size(), "event"), contacts = counted(view.contacts.size(), "contact");
  return events + (events.empty() || contacts.empty() ? "" : ", ") + contacts;
}

}  // namespace

Rect FilmLayout::cell(std::size_t frame) const {
  const auto column = static_cast<double>(frame % static_cast<std::size_t>(columns));
  const auto row = static_cast<double>(frame / static_cast<std::size_t>(columns));
  return {column * (cell_width + kGap), row * (cell_height + kGap), cell_width, cell_height};
}

FilmLayout film_layout(std::size_t frames, int columns, double aspect) {
  assert(frames >= 1 && frames <= kMostFilmFrames && columns >= 0 && columns <= kMostFilmColumns);
  const double shown = std::clamp(std::isfinite(aspect) ? aspect : 1.0, 0.4, 1.6);
  const auto laid_out = [&](int count) {
    FilmLayout layout;
    layout.columns = std::min(count, static_cast<int>(frames));
    layout.rows = (static_cast<int>(frames) + layout.columns - 1) / layout.columns;
    const double most_height = (kTallestGrid + kGap) / layout.rows - kGap;
    const double room = (kUsualWidth - 2 * kMargin + kGap) / layout.columns - kGap;
    double width = std::clamp(room, kNarrowest, kWidest);
    width = std::max(56.0, std::min(width, (most_height - kHeader) / shown));
    layout.cell_width = std::floor(width);
    layout.cell_height = std::floor(kHeader + shown * width);
    layout.grid_height = layout.rows * (layout.cell_height + kGap) - kGap;
    const double grid_width = layout.columns * (layout.cell_width + kGap) - kGap;
    layout.width = static_cast<int>(std::ceil(std::max(kLeastWidth, grid_width + 2 * kMargin)));
    return layout;
  };
  if (columns > 0) return laid_out(columns);
  FilmLayout best;
  double least = std::numeric_limits<double>::infinity();
  for (int count = 1; count <= std::min(10, static_cast<int>(frames)); ++count) {
    const FilmLayout layout = laid_out(count);
    const double width = layout.columns * (layout.cell_width + kGap);
    const auto empty = static_cast<double>(layout.columns * layout.rows) - static_cast<double>(frames);
    const double off = std::abs(std::log(width / layout.grid_height / kWantedAspect)) + 0.5 * empty / layout.columns;
    if (off < least) {
      least = off;
      best = layout;
    }
  }
  return best;
}

void share_colours(std::vector<SheetView>& frames) {
  for (std::size_t i = 0; i < frames.size(); ++i) {
    frames[i].region_colours = i == 0 ? region_categories(frames[i]) : continued_categories(frames[i - 1], frames[i]);
  }
}

Image film_picture(Film film) {
  assert(!film.frames.empty() && film.frames.size() <= kMostFilmFrames);
  share_colours(film.frames);
  const Camera camera = camera_of(best_view(film.frames));
  std::vector<DrawnSheet> sheets;
  std::vector<Bounds> bounds;
  Eigen::AlignedBox3d box;
  sheets.reserve(film.frames.size());
  for (const SheetView& frame : film.frames) {
    sheets.emplace_back(frame);
    bounds.push_back(sheets.back().bounds(camera));
    if (sheets.back().triangles.empty()) continue;
    const Vec3d reach = Vec3d::Constant(sheets.back().radius_m / std::sqrt(3.0));
    box.extend(Vec3d(sheets.back().centre_m - reach));
    box.extend(Vec3d(sheets.back().centre_m + reach));
  }
  const Window window = window_of(bounds);
  const FilmLayout layout = film_layout(film.frames.size(), film.columns, window.height_m / window.width_m);
  if (!window.follows && !box.isEmpty()) {
    for (DrawnSheet& drawn : sheets) {
      drawn.surroundings_m = box.center();
      drawn.surroundings_radius_m = box.diagonal().norm() / 2;
    }
  }

  const std::vector<LegendEntry> legend = sheet_legend(film.frames, " since the frame before");
  const double wide = layout.width - 2 * kMargin;
  const std::vector<std::string> caption = wrapped(
      fmt::format("One scale and one camera{}, frames row by row. A region keeps its colour from frame to frame while it "
                  "lasts. Rings: at most {} of the largest events, where that part of the sheet is now; the larger, the "
                  "louder. Below the frames every event's time and size; the black marks are the frames' times.",
                  window.follows ? " that follows the sheet" : " that stands still", kRings),
      wide, 12);
  const double legend_top = kTitle + layout.grid_height + 26 + kTimeline;
  const double legend_height = 20 * static_cast<double>(legend_rows(wide, legend));
  const int height = static_cast<int>(std::ceil(legend_top + legend_height + 17 * static_cast<double>(caption.size()) + 14));

  ImageCanvas canvas(layout.width, height, light_theme());
  canvas.text({kMargin, 28}, fitted(film.title, wide, 16, true), {.size = 16, .bold = true});
  for (std::size_t i = 0; i < film.frames.size(); ++i) {
    const SheetView& view = film.frames[i];
    Rect cell = layout.cell(i);
    cell.x += kMargin;
    cell.y += kTitle;
    const Rect panel = {cell.x, cell.y + kHeader, cell.width, cell.height - kHeader};
    canvas.rectangle(panel, Ink::kPanel);
    canvas.frame(panel, {Ink::kGrid, 1});
    const std::string time = fmt::format("{:.3f} s", view.time_s);
    canvas.text({cell.x + 2, cell.y + 15}, time, {.size = 12, .bold = true});
    const double taken = text_width(time, 12, true) + 12;
    canvas.text({cell.x + cell.width - 2, cell.y + 15}, fitted(counts_of(view), cell.width - taken, 11),
                {.size = 11, .paint = Ink::kMuted, .align = Align::kRight});
    const Rect inner = inset(panel, 0.07 * panel.width, 0.07 * panel.height, 0.07 * panel.width, 0.07 * panel.height);
    Bounds own;
    const double u = window.follows && !bounds[i].empty() ? (bounds[i].left + bounds[i].right) / 2 : window.u_m;
    const double v = window.follows && !bounds[i].empty() ? (bounds[i].bottom + bounds[i].top) / 2 : window.v_m;
    own.add(u - window.width_m / 2, v - window.height_m / 2);
    own.add(u + window.width_m / 2, v + window.height_m / 2);
    const Fit fit = own.fit(inner);
    SceneStyle style;
    style.mark_scale = std::clamp(panel.width / 420, 0.45, 0.85);
    style.most_rings = kRings;
    draw_scene(canvas, panel, sheets[i], camera, fit, style);
    if (i != 0) continue;
    draw_scale_bar(canvas, inset(panel, 0, 0, -10, -8), fit.px_per_m);
    draw_compass(canvas, {panel.x + 24, panel.bottom() - 20}, 13, camera, sheets[i]);
  }
  const Rect strip = {kMargin + 8, kTitle + layout.grid_height + 22, wide - 16, kTimeline};
  draw_time_line(canvas, strip, film);
  draw_legend_rows(canvas, {kMargin, legend_top + 16}, wide, legend);
  double y = legend_top + legend_height + 18;
  for (const std::string& line : caption) {
    canvas.text({kMargin, y}, line, {.size = 12, .paint = Ink::kText});
    y += 17;
  }
  return canvas.pixels();
}

tl::expected<void, std::string> write_film_png(const std::filesystem::path& path, Film film) {
  return write_png(path, film_picture(std::move(film)));
}

}  // namespace rustle::report
