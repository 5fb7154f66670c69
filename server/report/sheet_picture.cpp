#include "server/report/sheet_picture.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <set>
#include <string_view>

#include <fmt/format.h>

#include "server/report/sheet_drawing.h"

namespace rustle::report {
namespace {

constexpr std::size_t kLettered = 5, kNumbered = 4;
constexpr double kRow = 18;
constexpr double kBesideAbove = 0.5;  // share of the sheet's area that the view from above must see to be shown

void draw_panel(Canvas& canvas, const Rect& panel, std::string_view title) {
  canvas.rectangle(panel, Ink::kPanel);
  canvas.frame(panel, {Ink::kGrid, 1});
  canvas.text({panel.x + 12, panel.y + 20}, title, {.size = 12, .paint = Ink::kMuted, .bold = true});
}

void draw_view(Canvas& canvas, const Rect& panel, const DrawnSheet& drawn, const ViewDirection& direction,
               const SceneStyle& style) {
  const Camera camera = camera_of(direction);
  const double margin = 0.08 * std::min(panel.width, panel.height);
  const bool large = style.mark_scale >= 1;
  const Fit fit = drawn.bounds(camera).fit(inset(panel, margin, margin + 12, margin, margin + (large ? 40 : 18)));
  draw_scene(canvas, panel, drawn, camera, fit, style);
  if (drawn.triangles.empty()) return;
  draw_scale_bar(canvas, panel, fit.px_per_m);
  if (large) draw_compass(canvas, {panel.x + 56, panel.bottom() - 52}, 30, camera, drawn);
}

/// The magnitude that 95 % of the finite curvatures do not exceed.
double curvature_scale(std::span<const float> curvature_per_m) {
  std::vector<double> sizes;
  for (const float k : curvature_per_m) {
    if (std::isfinite(k)) sizes.push_back(std::abs(static_cast<double>(k)));
  }
  if (sizes.empty()) return 1;
  const std::size_t rank = (sizes.size() - 1) * 95 / 100;
  std::nth_element(sizes.begin(), sizes.begin() + static_cast<std::ptrdiff_t>(rank), sizes.end());
  return std::max(1.0, sizes[rank]);
}

void draw_curvature(Canvas& canvas, const Rect& panel, const DrawnSheet& drawn) {
  const std::vector<float>& curvature = drawn.view.curvature_per_m;
  const double scale = curvature_scale(curvature);
  std::vector<Colour> colours;
  for (const float k : curvature) colours.push_back(diverging_colour(std::isfinite(k) ? static_cast<double>(k) / scale : 0));
  draw_flat(canvas, inset(panel, 16, 34, 76, 16), drawn, colours, nullptr);
  const Rect bar = {panel.right() - 58, panel.y + 40, 11, panel.height - 62};
  Image gradient{1, 64, {}};
  for (int i = 0; i < 64; ++i) gradient.pixels.push_back(pixel_of(diverging_colour(1 - 2 * (i + 0.5) / 64)));
  canvas.image(bar, gradient);
  canvas.frame(bar, {Ink::kFrame, 1});
  const Axis axis = {-scale, scale, bar.bottom(), bar.y};
  for (const Tick& tick : linear_ticks(-scale, scale, 5)) {
    canvas.text({bar.right() + 6, axis.pixel(tick.value) + 4}, tick.label, {.size = kLabelSize, .paint = Ink::kMuted});
  }
}

/// From above where that shows most of the sheet, else from the other side.
std::pair<ViewDirection, std::string_view> second_view(const SheetView& view, const ViewDirection& first) {
  double seen = 0, whole = 0;
  for (const sheet::Triangle& t : view.triangles) {
    if (std::any_of(t.begin(), t.end(), [&](std::uint32_t v) { return v >= view.positions_m.size(); })) continue;
    const Vec3d a = view.positions_m[t[0]].cast<double>(), b = view.positions_m[t[1]].cast<double>();
    const Vec3d c = view.positions_m[t[2]].cast<double>();
    const Vec3d normal = (b - a).cross(c - a);
    if (!normal.allFinite()) continue;
    seen += std::abs(normal.z());
    whole += normal.norm();
  }
  if (seen >= kBesideAbove * whole) return {{-90, 90}, "From above"};
  return {{first.azimuth_deg + 180, first.elevation_deg}, "From the other side"};
}

std::string span_text(double seconds) {
  return seconds < 0.9995 ? fmt::format("{:.0f} ms", 1e3 * seconds) : fmt::format("{:.2f} s", seconds);
}

std::string centimetres(double metres) {
  return fmt::format("{:.1f} cm", 100 * metres);
}

/// The flat, the bent but held all round, and those that flap.
std::string_view kind_of(const ResonatorMark& resonator) {
  if (!resonator.constrained) return "free";
  return resonator.ruling_length_m > 0 ? "constrained" : "flat";
}

struct Cell {
  double x;
  std::string text;
};

void draw_row(Canvas& canvas, double left, double y, std::span<const Cell> cells, const Paint& paint, double right) {
  for (std::size_t i = 0; i < cells.size(); ++i) {
    const double end = i + 1 < cells.size() ? left + cells[i + 1].x - 4 : right;
    canvas.text({left + cells[i].x, y}, fitted(cells[i].text, end - left - cells[i].x, kLabelSize),
                {.size = kLabelSize, .paint = paint});
  }
}

double tables_height(const SceneStyle& style) {
  double rows = 0;
  if (!style.lettered_regions.empty()) rows += 2.2 + static_cast<double>(style.lettered_regions.size());
  if (!style.numbered_events.empty()) rows += 2.2 + static_cast<double>(style.numbered_events.size());
  return rows > 0 ? 14 + kRow * rows : 0;
}

void draw_tables(Canvas& canvas, const Rect& panel, const SheetView& view, const SceneStyle& style) {
  const double left = panel.x + 12, right = panel.right() - 8;
  double y = panel.y + 22;
  const auto heading = [&](const std::string& text) {
    canvas.text({left, y}, text, {.size = 12, .paint = Ink::kMuted, .bold = true});
    y += kRow;
  };
  if (!style.lettered_regions.empty()) {
    heading("Largest resonators");
    draw_row(canvas, left, y, std::array<Cell, 4>{{{24, "l_r"}, {96, "l_c"}, {168, "area"}, {250, "kind"}}}, Ink::kMuted,
             right);
    y += kRow;
    for (std::size_t i = 0; i < style.lettered_regions.size(); ++i) {
      const ResonatorMark& r = view.resonators[style.lettered_regions[i]];
      draw_letter(canvas, {left + 8, y - 4}, static_cast<char>('A' + i));
      const bool bent = r.ruling_length_m > 0;
      draw_row(canvas, left, y,
               std::array<Cell, 4>{{{24, bent ? centimetres(r.ruling_length_m) : "-"},
                                    {96, r.constrained ? "-" : centimetres(r.free_border_length_m)},
                                    {168, fmt::format("{:.1f} cm²", 1e4 * r.area_m2)},
                                    {250, fmt::format("{}{}", kind_of(r), r.coarse ? ", mesh too coarse" : "")}}},
               Ink::kText, right);
      y += kRow;
    }
    y += 0.2 * kRow;
  }
  if (style.numbered_events.empty()) return;
  heading("Largest events" + (view.events_over_s > 0 ? " of the last " + span_text(view.events_over_s) : ""));
  draw_row(canvas, left, y, std::array<Cell, 4>{{{24, "at"}, {96, "amplitude"}, {168, "area"}, {250, "largest resonator"}}},
           Ink::kMuted, right);
  y += kRow;
  for (std::size_t i = 0; i < style.numbered_events.size(); ++i) {
    const EventMark& event = view.events[style.numbered_events[i]];
    draw_number(canvas, {left + 8, y - 4}, event.kind, i + 1);
    const auto largest = std::max_element(event.resonators.begin(), event.resonators.end(),
                                          [](const auto& a, const auto& b) { return a.area_m2 < b.area_m2; });
    std::string resonator;
    if (largest != event.resonators.end()) {
      resonator = largest->constrained ? std::string(kind_of(*largest))
                                       : fmt::format("l_r {:.1f}, l_c {}", 100 * largest->ruling_length_m,
                                                     centimetres(largest->free_border_length_m));
      if (event.resonators.size() > 1) resonator += fmt::format(" of {}", event.resonators.size());
    }
    draw_row(
        canvas, left, y,
        std::array<Cell, 4>{{{24, fmt::format("{:.3f} s", event.time_s)},
                             {96, short_number(event.amplitude) + (event.kind == EventKind::kCrumpling ? " m" : " m/s")},
                             {168, fmt::format("{:.1f} cm²", 1e4 * event.area_m2)},
                             {250, resonator}}},
        Ink::kText, right);
    y += kRow;
  }
}

std::string caption_of(const SheetView& view, const DrawnSheet& drawn) {
  std::vector<std::string> parts;
  if (view.sheet_triangles == 0 || view.sheet_triangles == view.triangles.size()) {
    parts.push_back(
        fmt::format("{} vertices, {} triangles", grouped(view.positions_m.size()), grouped(view.triangles.size())));
  } else {
    parts.push_back(fmt::format("{} triangles, regions found on a proxy of {}", grouped(view.sheet_triangles),
                                grouped(view.triangles.size())));
  }
  for (const auto& [label, value] : view.facts) parts.push_back(fmt::format("{} {}", label, value));
  std::set<std::uint32_t> regions;
  for (const std::uint32_t r : view.triangle_regions) {
    if (r != sheet::kNone) regions.insert(r);
  }
  if (!view.triangle_regions.empty()) {
    const auto flat = std::count_if(regions.begin(), regions.end(), [&](std::uint32_t r) {
      return r < view.region_curved.size() && !view.region_curved[r];
    });
    const auto coarse = std::count_if(regions.begin(), regions.end(), [&](std::uint32_t r) {
      return r < view.resonators.size() && view.resonators[r].coarse;
    });
    parts.push_back(fmt::format("{} region{}: {} flat, {} on too coarse a mesh (l_r and l_c less exact)", regions.size(),
                                regions.size() == 1 ? "" : "s", flat, coarse));
  }
  const auto ridges = std::count(view.ridge_triangles.begin(), view.ridge_triangles.end(), true);
  if (ridges > 0) parts.push_back(fmt::format("{} ridge triangles", ridges));
  if (!view.rulings_m.empty()) parts.push_back(fmt::format("{} rulings", grouped(view.rulings_m.size())));
  double free_m = 0;
  for (const SheetView::Border& border : view.borders) {
    if (!drawn.is_usable(border.start) || !drawn.is_usable(border.end)) continue;
    free_m += std::clamp(border.free_weight, 0.0, 1.0) * (drawn.at(border.start) - drawn.at(border.end)).norm();
  }
  if (!view.borders.empty()) parts.push_back("free curved border " + centimetres(free_m));
  const auto sliding =
      std::count_if(view.contacts.begin(), view.contacts.end(), [](const auto& contact) { return contact.sliding; });
  parts.push_back(fmt::format("{} vertices in contact, {} sliding", grouped(view.contacts.size()), sliding));
  if (view.listener_m && view.listener_m->allFinite()) {
    parts.push_back(fmt::format("listener at {:.2f} m", (*view.listener_m - drawn.centre_m).norm()));
  }
  if (view.events_over_s > 0) {
    parts.push_back(fmt::format("{} event{} in the last {}", view.events.size(), view.events.size() == 1 ? "" : "s",
                                span_text(view.events_over_s)));
  } else if (!view.events.empty()) {
    parts.push_back(fmt::format("{} events", view.events.size()));
  }
  std::string caption;
  for (const std::string& part : parts) caption += (caption.empty() ? "" : "; ") + part;
  return caption;
}

}  // namespace

void draw_sheet(Canvas& canvas, const Rect& rect, const SheetView& view, const std::optional<ViewDirection>& direction) {
  constexpr std::size_t kMostLines = 4;
  const DrawnSheet drawn(view);
  SceneStyle style;
  style.lettered_regions = largest_regions(view, kLettered);
  style.numbered_events = largest_events(view.events, kNumbered);
  SceneStyle small_style = style;
  small_style.mark_scale = 0.75;

  const std::vector<std::string> caption = wrapped(caption_of(view, drawn), rect.width - 32, 12);
  const std::size_t lines = std::min(caption.size(), kMostLines);
  const std::vector<LegendEntry> legend = sheet_legend(
      std::span(&view, 1), view.events_over_s > 0 ? " in the last " + span_text(view.events_over_s) : std::string());
  const double legend_height = 20 * static_cast<double>(legend_rows(rect.width - 36, legend));
  canvas.text({rect.x + 16, rect.y + 28},
              fitted(view.title.empty() ? fmt::format("Sheet at {:.3f} s", view.time_s)
                                        : fmt::format("{} at {:.3f} s", view.title, view.time_s),
                     rect.width - 32, 16, true),
              {.size = 16, .bold = true});
  const Rect body = inset(rect, 16, 42, 16, 24 + legend_height + 17 * static_cast<double>(lines));
  const double side = std::floor(0.34 * body.width);
  const Rect large = {body.x, body.y, body.width - side - 12, body.height};
  const ViewDirection first = direction ? *direction : best_view(std::span(&view, 1));
  draw_panel(canvas, large, "Oblique view");
  draw_view(canvas, large, drawn, first, style);

  Rect small = {large.right() + 12, body.y, side, body.height};
  const double tables = tables_height(style);
  if (tables > 0 && tables < 0.6 * body.height) {
    small.height -= tables + 12;
    const Rect lower = {small.x, small.bottom() + 12, small.width, tables};
    canvas.rectangle(lower, Ink::kPanel);
    canvas.frame(lower, {Ink::kGrid, 1});
    draw_tables(canvas, lower, view, style);
  }
  const bool flat = can_be_laid_flat(view);
  if (flat && view.curvature_per_m.size() == view.triangles.size() && !view.triangles.empty()) {
    small.height = std::floor((small.height - 12) / 2);
    const Rect lower = {small.x, small.bottom() + 12, small.width, small.height};
    draw_panel(canvas, lower, "Curvature (1/m)");
    draw_curvature(canvas, lower, drawn);
  }
  if (flat) {
    draw_panel(canvas, small, "Laid flat");
    draw_flat(canvas, inset(small, 16, 34, 16, 16), drawn, drawn.colours, &small_style);
  } else {
    const auto [second, name] = second_view(view, first);
    draw_panel(canvas, small, name);
    draw_view(canvas, small, drawn, second, small_style);
  }
  double y = body.bottom() + 24;
  draw_legend_rows(canvas, {rect.x + 18, y}, rect.width - 36, legend);
  y += legend_height + 2;
  for (std::size_t i = 0; i < lines; ++i) {
    canvas.text({rect.x + 18, y}, caption[i], {.size = 12, .paint = Ink::kText});
    y += 17;
  }
}

Image sheet_picture(const SheetView& view, const PictureSize& size, const std::optional<ViewDirection>& direction) {
  ImageCanvas canvas(size.width, size.height, size.dark ? dark_theme() : light_theme(), size.scale);
  draw_sheet(canvas, {0, 0, canvas.width(), canvas.height()}, view, direction);
  return canvas.pixels();
}

tl::expected<void, std::string> write_sheet_png(const std::filesystem::path& path, const SheetView& view,
                                                const PictureSize& size, const std::optional<ViewDirection>& direction) {
  return write_png(path, sheet_picture(view, size, direction));
}

}  // namespace rustle::report
