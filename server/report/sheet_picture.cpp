#include "server/report/sheet_picture.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <map>
#include <numbers>
#include <numeric>
#include <set>

#include <fmt/format.h>

#include "server/report/axis.h"
#include "server/report/obstacle_wires.h"
#include "server/report/timeline.h"

namespace rustle::report {
namespace {

constexpr Colour kRidge = {0.24, 0.17, 0.15};
constexpr Colour kPlain = {0.86, 0.85, 0.82};
constexpr Colour kInkLine = {0.12, 0.12, 0.14};
constexpr Colour kFreeBorder = {0.98, 0.80, 0.10};
constexpr double kLeastFreeWeight = 0.02;
constexpr double kLeastRing = 5, kGreatestRing = 20;

struct Camera {
  Vec3d right, up, toward;  ///< unit length; toward: from the sheet to the viewer
};

Camera camera_of(const ViewDirection& direction) {
  const double a = direction.azimuth_deg * std::numbers::pi / 180, e = direction.elevation_deg * std::numbers::pi / 180;
  return {{-std::sin(a), std::cos(a), 0},
          {-std::sin(e) * std::cos(a), -std::sin(e) * std::sin(a), std::cos(e)},
          {std::cos(e) * std::cos(a), std::cos(e) * std::sin(a), std::sin(e)}};
}

/// World or material space to a panel: x right, y up.
struct Fit {
  Point centre_px;
  double x = 0, y = 0;  ///< what lies at the centre, in metres
  double px_per_m = 1;
  Point operator()(double u, double v) const { return {centre_px.x + (u - x) * px_per_m, centre_px.y - (v - y) * px_per_m}; }
};

struct Bounds {
  double left = 1e300, right = -1e300, bottom = 1e300, top = -1e300;
  void add(double u, double v) {
    left = std::min(left, u);
    right = std::max(right, u);
    bottom = std::min(bottom, v);
    top = std::max(top, v);
  }
  Fit fit(const Rect& panel) const {
    const Point centre = {panel.x + panel.width / 2, panel.y + panel.height / 2};
    if (left > right) return {centre, 0, 0, panel.width};
    const double width = std::max(right - left, 1e-6), height = std::max(top - bottom, 1e-6);
    return {centre, (left + right) / 2, (bottom + top) / 2, std::min(panel.width / width, panel.height / height)};
  }
};

Rect inset(const Rect& rect, double left, double top, double right, double bottom) {
  return {rect.x + left, rect.y + top, std::max(1.0, rect.width - left - right), std::max(1.0, rect.height - top - bottom)};
}

/// A view whose indices exist and whose points are finite.
struct Drawn {
  const SheetView& view;
  std::vector<bool> usable;            ///< [V]
  std::vector<std::size_t> triangles;  ///< indices of drawable ones
  std::vector<Colour> colours;         ///< [T], before shading
  Vec3d centre_m = Vec3d::Zero();
  double radius_m = 0.1, edge_m = 0.01;  ///< of the bounding box; mean of the edges

  Vec3d at(std::uint32_t vertex) const { return view.positions_m[vertex].cast<double>(); }
  bool is_usable(std::uint32_t vertex) const { return vertex < usable.size() && usable[vertex]; }
  bool has_ruling(std::size_t t) const {
    if (t >= view.ruling_directions.size() || is_ridge(t) || !view.ruling_directions[t].allFinite()) return false;
    const std::uint32_t region = t < view.triangle_regions.size() ? view.triangle_regions[t] : sheet::kNone;
    return region >= view.region_curved.size() || view.region_curved[region];
  }
  bool is_ridge(std::size_t t) const { return t < view.ridge_triangles.size() && view.ridge_triangles[t]; }
};

Drawn drawn_of(const SheetView& view) {
  Drawn drawn{view, {}, {}, {}};
  Eigen::AlignedBox3d box;
  for (const sheet::Vec3f& p : view.positions_m) {
    drawn.usable.push_back(p.allFinite());
    if (p.allFinite()) box.extend(p.cast<double>());
  }
  if (!box.isEmpty()) {
    drawn.centre_m = box.center();
    drawn.radius_m = std::max(1e-3, box.diagonal().norm() / 2);
  }
  const std::vector<int> categories = region_categories(view);
  double length_m = 0;
  for (std::size_t t = 0; t < view.triangles.size(); ++t) {
    const sheet::Triangle& corner = view.triangles[t];
    const std::uint32_t region = t < view.triangle_regions.size() ? view.triangle_regions[t] : sheet::kNone;
    Colour colour = kPlain;
    if (region < categories.size()) {
      colour = category_colour(categories[region]);
      if (region < view.region_curved.size() && !view.region_curved[region]) colour = mix(colour, kPlain, 0.62);
    }
    drawn.colours.push_back(drawn.is_ridge(t) ? kRidge : colour);
    if (!std::all_of(corner.begin(), corner.end(), [&](std::uint32_t v) { return drawn.is_usable(v); })) continue;
    drawn.triangles.push_back(t);
    for (std::size_t k = 0; k < 3; ++k) length_m += (drawn.at(corner[k]) - drawn.at(corner[(k + 1) % 3])).norm();
  }
  if (!drawn.triangles.empty())
    drawn.edge_m = std::max(1e-6, length_m / (3.0 * static_cast<double>(drawn.triangles.size())));
  return drawn;
}

/// Tints are light in every theme, so what lies on them takes the light theme's colours.
const Colour& on_tint(Ink ink) {
  return light_theme()[static_cast<std::size_t>(ink)];
}

double ring_radius(const EventMark& event) {
  return kLeastRing + (kGreatestRing - kLeastRing) * amplitude_height(event.amplitude, reference_amplitude(event.kind));
}

void draw_ring(Canvas& canvas, const Point& at, const EventMark& event) {
  canvas.disc(at, ring_radius(event), {on_tint(ink_of(event.kind)), 0.16});
  canvas.circle(at, ring_radius(event), {Colour{1, 1, 1}, 3.6});
  canvas.circle(at, ring_radius(event), {on_tint(ink_of(event.kind)), 2.2});
}

/// The parts of a scene, each with how near it lies to the viewer: far ones are drawn first.
class DepthSorted {
 public:
  explicit DepthSorted(const Camera& camera) : toward_(camera.toward) {}
  void add(const Vec3d& where, double lift, std::function<void()> draw) {
    parts_.push_back({where.dot(toward_) + lift, std::move(draw)});
  }
  void draw() {
    std::vector<std::size_t> order(parts_.size());
    std::iota(order.begin(), order.end(), std::size_t{0});
    std::stable_sort(order.begin(), order.end(),
                     [&](std::size_t a, std::size_t b) { return parts_[a].first < parts_[b].first; });
    for (const std::size_t i : order) parts_[i].second();
  }

 private:
  Vec3d toward_;
  std::vector<std::pair<double, std::function<void()>>> parts_;
};

void draw_scale_bar(Canvas& canvas, const Rect& panel, double px_per_m) {
  double length_m = std::pow(10.0, std::floor(std::log10(panel.width * 0.25 / px_per_m)));
  for (const double factor : {5.0, 2.0}) {
    if (factor * length_m * px_per_m <= panel.width * 0.25) {
      length_m *= factor;
      break;
    }
  }
  const double width = length_m * px_per_m, x = panel.right() - 16 - width, y = panel.bottom() - 14;
  const std::array<Point, 4> bar = {{{x, y - 5}, {x, y}, {x + width, y}, {x + width, y - 5}}};
  canvas.polyline(bar, {Ink::kMuted, 1.5});
  const std::string label = length_m >= 1      ? fmt::format("{:g} m", length_m)
                            : length_m >= 0.01 ? fmt::format("{:g} cm", std::round(length_m * 1e4) / 100)
                                               : fmt::format("{:g} mm", std::round(length_m * 1e6) / 1000);
  canvas.text({x + width / 2, y - 8}, label, {.size = kLabelSize, .paint = Ink::kMuted, .align = Align::kCentre});
}

void draw_arrow(Canvas& canvas, const Point& from, const Point& to, const Paint& paint, double width) {
  canvas.line(from, to, {paint, width});
  const double dx = to.x - from.x, dy = to.y - from.y, length = std::hypot(dx, dy);
  if (length < 6) return;
  const double ux = dx / length, uy = dy / length, head = 3.5 + width;
  const std::array<Point, 3> tip = {{{to.x + ux * 2, to.y + uy * 2},
                                     {to.x - ux * head - uy * head * 0.55, to.y - uy * head + ux * head * 0.55},
                                     {to.x - ux * head + uy * head * 0.55, to.y - uy * head - ux * head * 0.55}}};
  canvas.polygon(tip, paint);
}

/// The axes as the viewer sees them and where the listener is.
void draw_compass(Canvas& canvas, const Rect& panel, const Camera& camera, const Drawn& drawn) {
  constexpr double kArm = 30;
  const Point origin = {panel.x + 56, panel.bottom() - 52};
  const auto end = [&](const Vec3d& axis, double arm) {
    return Point{origin.x + arm * axis.dot(camera.right), origin.y - arm * axis.dot(camera.up)};
  };
  const std::array<std::pair<Vec3d, std::string_view>, 3> axes = {
      {{Vec3d::UnitX(), "x"}, {Vec3d::UnitY(), "y"}, {Vec3d::UnitZ(), "z"}}};
  for (const auto& [axis, name] : axes) {
    const Point tip = end(axis, kArm), label = end(axis, kArm + 9);
    if (std::hypot(tip.x - origin.x, tip.y - origin.y) < 5) continue;
    draw_arrow(canvas, origin, tip, Ink::kMuted, 1.2);
    canvas.text({label.x, label.y + 4}, name, {.size = kLabelSize, .paint = Ink::kMuted, .align = Align::kCentre});
  }
  if (!drawn.view.listener_m || !drawn.view.listener_m->allFinite()) return;
  const Vec3d way = *drawn.view.listener_m - drawn.centre_m;
  if (way.norm() < 1e-6) return;
  draw_arrow(canvas, origin, end(way.normalized(), kArm + 8), Ink::kLimit, 2.2);
  canvas.disc(origin, 2.5, Ink::kLimit);
}

void draw_wires(DepthSorted& parts, Canvas& canvas, const Fit& fit, const Camera& camera, const Drawn& drawn) {
  for (const scene::Obstacle& obstacle : drawn.view.obstacles) {
    const std::vector<Segment> wires = obstacle_wires(obstacle, drawn.centre_m, drawn.radius_m);
    const auto point = [&](const Vec3d& p) { return fit(p.dot(camera.right), p.dot(camera.up)); };
    const bool plane = std::holds_alternative<scene::PlaneShape>(obstacle.shape);
    if (plane && (obstacle.pose.orientation * Vec3d::UnitZ()).dot(camera.toward) > 0) {
      std::vector<std::pair<Point, Point>> lines;
      for (const auto& [from, to] : wires) lines.push_back({point(from), point(to)});
      parts.add(drawn.centre_m - 1e6 * camera.toward, 0, [&canvas, lines] {
        canvas.segments(lines, {{Ink::kFrame, 0.6}, 1});
      });
      continue;
    }
    for (const auto& [from, to] : wires) {
      const int pieces = std::clamp(static_cast<int>(std::ceil((to - from).norm() / drawn.edge_m)), 1, 64);
      for (int i = 0; i < pieces; ++i) {
        const Vec3d a = from + (to - from) * i / pieces, b = from + (to - from) * (i + 1) / pieces;
        parts.add((a + b) / 2, -drawn.edge_m, [&canvas, from_px = point(a), to_px = point(b)] {
          canvas.line(from_px, to_px, {{Ink::kMuted, 0.45}, 0.9});
        });
      }
    }
  }
}

void draw_view(Canvas& canvas, const Rect& panel, const Drawn& drawn, const ViewDirection& direction, bool with_compass) {
  const SheetView& view = drawn.view;
  const Camera camera = camera_of(direction);
  Bounds bounds;
  for (std::uint32_t v = 0; v < view.positions_m.size(); ++v) {
    if (drawn.is_usable(v)) bounds.add(drawn.at(v).dot(camera.right), drawn.at(v).dot(camera.up));
  }
  const double margin = 0.08 * std::min(panel.width, panel.height);
  const Fit fit = bounds.fit(inset(panel, margin, margin, margin, margin + (with_compass ? 40 : 14)));
  const auto point = [&](const Vec3d& p) { return fit(p.dot(camera.right), p.dot(camera.up)); };
  const Vec3d light = (camera.toward + 0.7 * camera.up - 0.5 * camera.right).normalized();
  const bool mesh_lines = drawn.edge_m * fit.px_per_m > 5;
  const double dot_px = std::clamp(0.22 * drawn.edge_m * fit.px_per_m, 0.9, 2.6);

  DepthSorted parts(camera);
  draw_wires(parts, canvas, fit, camera, drawn);
  for (const std::size_t t : drawn.triangles) {
    const sheet::Triangle& corner = view.triangles[t];
    const Vec3d a = drawn.at(corner[0]), b = drawn.at(corner[1]), c = drawn.at(corner[2]);
    Vec3d normal = (b - a).cross(c - a);
    const double length = normal.norm();
    normal = length > 0 ? Vec3d(normal / length) : camera.toward;
    const bool back = normal.dot(camera.toward) < 0;
    const double bright = 0.60 + 0.44 * std::max(0.0, (back ? Vec3d(-normal) : normal).dot(light));
    const Colour& base = drawn.colours[t];
    const Colour toned = back ? mix(base, {0.66, 0.67, 0.72}, 0.35) : base;
    const Colour shaded = bright < 1 ? mix({0.05, 0.05, 0.10}, toned, bright) : mix(toned, {1, 1, 1}, (bright - 1) * 2);
    const std::array<Point, 4> corners = {point(a), point(b), point(c), point(a)};
    parts.add((a + b + c) / 3, 0, [&canvas, corners, shaded, mesh_lines] {
      canvas.polygon(corners, shaded);
      canvas.polyline(corners, {shaded, 0.8});
      if (mesh_lines) canvas.polyline(corners, {{kInkLine, 0.16}, 0.6});
    });
  }
  const double lift = 0.8 * drawn.edge_m;
  const auto add_line = [&](const Vec3d& from, const Vec3d& to, double more, const Stroke& stroke) {
    if (!from.allFinite() || !to.allFinite()) return;
    const int pieces = std::clamp(static_cast<int>(std::ceil((to - from).norm() / drawn.edge_m)), 1, 256);
    for (int i = 0; i < pieces; ++i) {
      const Vec3d a = from + (to - from) * i / pieces, b = from + (to - from) * (i + 1) / pieces;
      parts.add((a + b) / 2, lift + more,
                [&canvas, from_px = point(a), to_px = point(b), stroke] { canvas.line(from_px, to_px, stroke); });
    }
  };
  for (const auto& [from, to] : view.rulings_m) add_line(from, to, 0, {{kInkLine, 0.5}, 0.9});
  for (const std::size_t t : drawn.triangles) {
    if (!drawn.has_ruling(t)) continue;
    const sheet::Triangle& corner = view.triangles[t];
    const Vec3d centre = (drawn.at(corner[0]) + drawn.at(corner[1]) + drawn.at(corner[2])) / 3;
    const Vec3d half = 0.38 * drawn.edge_m * view.ruling_directions[t].cast<double>();
    parts.add(centre, lift, [&canvas, from_px = point(centre - half), to_px = point(centre + half)] {
      canvas.line(from_px, to_px, {{kInkLine, 0.7}, 1});
    });
  }
  for (const auto& [start, end] : view.ridge_edges) {
    if (drawn.is_usable(start) && drawn.is_usable(end)) add_line(drawn.at(start), drawn.at(end), 0, {kRidge, 2});
  }
  for (const SheetView::Border& border : view.borders) {
    if (!drawn.is_usable(border.start) || !drawn.is_usable(border.end)) continue;
    const double weight = std::clamp(border.free_weight, 0.0, 1.0);
    const bool free = weight > kLeastFreeWeight;
    add_line(drawn.at(border.start), drawn.at(border.end), 0, {{kInkLine, free ? 0.9 : 0.6}, free ? 4.6 : 1.2});
    if (free) add_line(drawn.at(border.start), drawn.at(border.end), lift, {{kFreeBorder, weight}, 2.8});
  }
  for (const std::uint32_t v : view.contacts) {
    if (!drawn.is_usable(v)) continue;
    parts.add(drawn.at(v), lift,
              [&canvas, dot_px, at = point(drawn.at(v))] { canvas.disc(at, dot_px, on_tint(Ink::kFriction)); });
  }
  for (std::uint32_t v = 0; v < view.anchored.size(); ++v) {
    if (!view.anchored[v] || !drawn.is_usable(v)) continue;
    parts.add(drawn.at(v), lift, [&canvas, at = point(drawn.at(v))] {
      canvas.rectangle({at.x - 4, at.y - 4, 8, 8}, Colour{1, 1, 1});
      canvas.rectangle({at.x - 3, at.y - 3, 6, 6}, kInkLine);
    });
  }
  canvas.clip(panel);
  parts.draw();
  for (const EventMark& event : view.events) {
    if (event.position_m.allFinite()) draw_ring(canvas, point(event.position_m), event);
  }
  canvas.unclip();
  if (drawn.triangles.empty()) {
    canvas.text({panel.x + panel.width / 2, panel.y + panel.height / 2}, "no triangles",
                {.size = 13, .paint = Ink::kMuted, .align = Align::kCentre});
    return;
  }
  draw_scale_bar(canvas, panel, fit.px_per_m);
  if (with_compass) draw_compass(canvas, panel, camera, drawn);
}

/// The vertex nearest to a place, by which it is found in material coordinates.
std::optional<std::uint32_t> nearest_vertex(const Drawn& drawn, const Vec3d& place) {
  std::optional<std::uint32_t> nearest;
  double least = 1e300;
  for (std::uint32_t v = 0; v < drawn.usable.size(); ++v) {
    if (!drawn.usable[v]) continue;
    const double distance = (drawn.at(v) - place).squaredNorm();
    if (distance < least) {
      least = distance;
      nearest = v;
    }
  }
  return nearest;
}

bool has_material_coordinates(const SheetView& view) {
  return !view.material_coordinates_m.empty() && view.material_coordinates_m.size() == view.positions_m.size() &&
         std::all_of(view.material_coordinates_m.begin(), view.material_coordinates_m.end(),
                     [](const sheet::Vec2f& c) { return c.allFinite(); });
}

/// The sheet in its material coordinates; `colours` per triangle.
void draw_flat(Canvas& canvas, const Rect& panel, const Drawn& drawn, std::span<const Colour> colours, bool with_marks) {
  const SheetView& view = drawn.view;
  Bounds bounds;
  for (const sheet::Vec2f& c : view.material_coordinates_m) bounds.add(c.x(), c.y());
  const Fit fit = bounds.fit(panel);
  const auto point = [&](std::uint32_t v) {
    return fit(view.material_coordinates_m[v].x(), view.material_coordinates_m[v].y());
  };
  const bool mesh_lines = drawn.edge_m * fit.px_per_m > 5;
  for (const std::size_t t : drawn.triangles) {
    const sheet::Triangle& corner = view.triangles[t];
    const std::array<Point, 4> corners = {point(corner[0]), point(corner[1]), point(corner[2]), point(corner[0])};
    canvas.polygon(corners, colours[t]);
    canvas.polyline(corners, {colours[t], 0.8});
  }
  std::vector<std::pair<Point, Point>> lines, ridges, borders;
  for (const std::size_t t : drawn.triangles) {
    if (!mesh_lines || !with_marks) break;
    const sheet::Triangle& corner = view.triangles[t];
    for (std::size_t k = 0; k < 3; ++k) lines.push_back({point(corner[k]), point(corner[(k + 1) % 3])});
  }
  canvas.segments(lines, {{kInkLine, 0.10}, 0.6});
  for (const auto& [start, end] : view.ridge_edges) {
    if (drawn.is_usable(start) && drawn.is_usable(end)) ridges.push_back({point(start), point(end)});
  }
  canvas.segments(ridges, {kRidge, 1.6});
  for (const SheetView::Border& border : view.borders) {
    if (!drawn.is_usable(border.start) || !drawn.is_usable(border.end)) continue;
    borders.push_back({point(border.start), point(border.end)});
  }
  canvas.segments(borders, {{Ink::kMuted, 0.9}, 1});
  if (!with_marks) return;
  for (const SheetView::Border& border : view.borders) {
    if (!drawn.is_usable(border.start) || !drawn.is_usable(border.end) || border.free_weight <= kLeastFreeWeight) continue;
    canvas.line(point(border.start), point(border.end), {{kInkLine, 0.9}, 4});
    canvas.line(point(border.start), point(border.end), {{kFreeBorder, std::min(1.0, border.free_weight)}, 2.4});
  }
  for (const std::uint32_t v : view.contacts) {
    if (!drawn.is_usable(v)) continue;
    canvas.disc(point(v), std::clamp(0.2 * drawn.edge_m * fit.px_per_m, 0.7, 1.8), on_tint(Ink::kFriction));
  }
  for (std::uint32_t v = 0; v < view.anchored.size(); ++v) {
    if (!view.anchored[v] || !drawn.is_usable(v)) continue;
    canvas.rectangle({point(v).x - 3, point(v).y - 3, 6, 6}, Colour{1, 1, 1});
    canvas.rectangle({point(v).x - 2, point(v).y - 2, 4, 4}, kInkLine);
  }
  for (const EventMark& event : view.events) {
    if (!event.position_m.allFinite()) continue;
    if (const auto vertex = nearest_vertex(drawn, event.position_m)) draw_ring(canvas, point(*vertex), event);
  }
}

/// The magnitude that 95 % of the finite curvatures do not exceed.
double curvature_scale(std::span<const float> curvature_per_m) {
  std::vector<double> sizes;
  for (const float k : curvature_per_m) {
    if (std::isfinite(k)) sizes.push_back(std::abs(k));
  }
  if (sizes.empty()) return 1;
  const std::size_t rank = (sizes.size() - 1) * 95 / 100;
  std::nth_element(sizes.begin(), sizes.begin() + static_cast<std::ptrdiff_t>(rank), sizes.end());
  return std::max(1.0, sizes[rank]);
}

void draw_curvature(Canvas& canvas, const Rect& panel, const Drawn& drawn) {
  const std::vector<float>& curvature = drawn.view.curvature_per_m;
  const double scale = curvature_scale(curvature);
  std::vector<Colour> colours;
  for (const float k : curvature) colours.push_back(diverging_colour(std::isfinite(k) ? k / scale : 0));
  draw_flat(canvas, inset(panel, 16, 34, 76, 16), drawn, colours, false);
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

std::vector<LegendEntry> legend_of(const SheetView& view) {
  using Shape = LegendEntry::Shape;
  std::vector<LegendEntry> entries;
  const bool ridges =
      !view.ridge_edges.empty() || std::count(view.ridge_triangles.begin(), view.ridge_triangles.end(), true) > 0;
  if (ridges) entries.push_back({"ridge", kRidge, Shape::kBox});
  if (!view.rulings_m.empty() || !view.ruling_directions.empty())
    entries.push_back({"ruling", {Ink::kMuted, 0.8}, Shape::kLine});
  if (std::any_of(view.borders.begin(), view.borders.end(),
                  [](const auto& b) { return b.free_weight > kLeastFreeWeight; })) {
    entries.push_back({"free curved border", kFreeBorder, Shape::kBox});
  }
  if (!view.contacts.empty()) entries.push_back({"contact", on_tint(Ink::kFriction), Shape::kDot});
  if (std::count(view.anchored.begin(), view.anchored.end(), true) > 0)
    entries.push_back({"anchored", Ink::kText, Shape::kSquare});
  for (LegendEntry entry : kind_legend(view.events)) {
    entry.shape = Shape::kRing;
    entry.paint = on_tint(entry.paint.ink);
    entries.push_back(entry);
  }
  if (!view.obstacles.empty()) entries.push_back({"obstacle", {Ink::kMuted, 0.6}, Shape::kLine});
  if (view.listener_m) entries.push_back({"toward the listener", Ink::kLimit, Shape::kLine});
  return entries;
}

std::string caption_of(const SheetView& view, const Drawn& drawn) {
  std::vector<std::string> parts = {
      fmt::format("{} vertices, {} triangles", grouped(view.positions_m.size()), grouped(view.triangles.size()))};
  std::set<std::uint32_t> regions;
  for (const std::uint32_t r : view.triangle_regions) {
    if (r != sheet::kNone) regions.insert(r);
  }
  if (!view.triangle_regions.empty()) {
    const auto flat = std::count_if(regions.begin(), regions.end(), [&](std::uint32_t r) {
      return r < view.region_curved.size() && !view.region_curved[r];
    });
    parts.push_back(fmt::format("{} regions ({} flat)", regions.size(), flat));
  }
  if (!view.rulings_m.empty()) parts.push_back(fmt::format("{} rulings", grouped(view.rulings_m.size())));
  double free_m = 0;
  for (const SheetView::Border& border : view.borders) {
    if (!drawn.is_usable(border.start) || !drawn.is_usable(border.end)) continue;
    free_m += std::clamp(border.free_weight, 0.0, 1.0) * (drawn.at(border.start) - drawn.at(border.end)).norm();
  }
  if (!view.borders.empty()) parts.push_back(fmt::format("free curved border {:.1f} cm", 100 * free_m));
  parts.push_back(fmt::format("{} vertices in contact", grouped(view.contacts.size())));
  if (view.listener_m && view.listener_m->allFinite()) {
    parts.push_back(fmt::format("listener at {:.2f} m", (*view.listener_m - drawn.centre_m).norm()));
  }
  constexpr std::size_t kListed = 3;
  const std::vector<std::size_t> order = largest_events(view.events, kListed);
  for (const std::size_t i : order) {
    const EventMark& event = view.events[i];
    std::string text = fmt::format("{} {} {}", kind_name(event.kind), short_number(event.amplitude),
                                   event.kind == EventKind::kCrumpling ? "m" : "m/s");
    for (const ResonatorMark& r : event.resonators) {
      text += r.constrained
                  ? fmt::format(" [l_r {:.1f} cm, constrained]", 100 * r.ruling_length_m)
                  : fmt::format(" [l_r {:.1f} cm, l_c {:.1f} cm]", 100 * r.ruling_length_m, 100 * r.free_border_length_m);
    }
    parts.push_back(text);
  }
  if (view.events.size() > order.size()) parts.push_back(fmt::format("{} more events", view.events.size() - order.size()));
  for (const auto& [label, value] : view.facts) parts.push_back(fmt::format("{} {}", label, value));
  std::string caption;
  for (const std::string& part : parts) caption += (caption.empty() ? "" : "; ") + part;
  return caption;
}

void draw_panel(Canvas& canvas, const Rect& panel, std::string_view title) {
  canvas.rectangle(panel, Ink::kPanel);
  canvas.frame(panel, {Ink::kGrid, 1});
  canvas.text({panel.x + 12, panel.y + 20}, title, {.size = 12, .paint = Ink::kMuted, .bold = true});
}

}  // namespace

ViewDirection best_view(const SheetView& view, const ViewDirection& from) {
  ViewDirection best = from;
  double most = -1;
  for (int k = 0; k < 8; ++k) {
    const ViewDirection candidate = {from.azimuth_deg + 45.0 * k, from.elevation_deg};
    const Vec3d toward = camera_of(candidate).toward;
    double seen = 0;
    for (const sheet::Triangle& t : view.triangles) {
      if (std::any_of(t.begin(), t.end(), [&](std::uint32_t v) { return v >= view.positions_m.size(); })) continue;
      const Vec3d a = view.positions_m[t[0]].cast<double>(), b = view.positions_m[t[1]].cast<double>();
      const Vec3d c = view.positions_m[t[2]].cast<double>();
      const double area = std::abs((b - a).cross(c - a).dot(toward));
      if (std::isfinite(area)) seen += area;
    }
    if (seen > most * (k == 0 ? 1 : 1.08)) {
      most = seen;
      best = candidate;
    }
  }
  return best;
}

std::vector<int> region_categories(const SheetView& view) {
  std::uint32_t regions = 0;
  const std::size_t count = std::min(view.triangles.size(), view.triangle_regions.size());
  for (std::size_t t = 0; t < count; ++t) {
    const std::uint32_t region = view.triangle_regions[t];
    if (region < view.triangles.size()) regions = std::max(regions, region + 1);
  }
  std::map<std::pair<std::uint32_t, std::uint32_t>, std::uint32_t> first_region;
  std::vector<std::set<std::uint32_t>> neighbours(regions);
  for (std::size_t t = 0; t < count; ++t) {
    const std::uint32_t region = view.triangle_regions[t];
    if (region >= regions) continue;
    for (std::size_t k = 0; k < 3; ++k) {
      const auto edge = std::minmax({view.triangles[t][k], view.triangles[t][(k + 1) % 3]});
      const auto [entry, is_new] = first_region.insert({edge, region});
      if (is_new || entry->second == region) continue;
      neighbours[region].insert(entry->second);
      neighbours[entry->second].insert(region);
    }
  }
  std::vector<int> categories(regions, -1);
  for (std::uint32_t region = 0; region < regions; ++region) {
    std::array<bool, kCategories> taken{};
    for (const std::uint32_t other : neighbours[region]) {
      if (categories[other] >= 0) taken[static_cast<std::size_t>(categories[other])] = true;
    }
    int category = static_cast<int>(region % kCategories);
    for (int tried = 0; tried < kCategories && taken[static_cast<std::size_t>(category)]; ++tried) {
      category = (category + 1) % kCategories;
    }
    categories[region] = category;
  }
  return categories;
}

void draw_sheet(Canvas& canvas, const Rect& rect, const SheetView& view, const std::optional<ViewDirection>& direction) {
  const Drawn drawn = drawn_of(view);
  const std::vector<std::string> caption = wrapped(caption_of(view, drawn), rect.width - 32, 12);
  const double lines = 17 * static_cast<double>(std::min<std::size_t>(caption.size(), 4));
  canvas.text({rect.x + 16, rect.y + 28},
              fitted(view.title.empty() ? fmt::format("Sheet at {:.3f} s", view.time_s)
                                        : fmt::format("{}, {:.3f} s", view.title, view.time_s),
                     rect.width - 32, 16, true),
              {.size = 16, .bold = true});
  const Rect body = inset(rect, 16, 42, 16, 34 + lines + 10);
  const double side = std::floor(0.34 * body.width);
  const Rect large = {body.x, body.y, body.width - side - 12, body.height};
  draw_panel(canvas, large, "Oblique view");
  draw_view(canvas, large, drawn, direction ? *direction : best_view(view), true);

  Rect small = {large.right() + 12, body.y, side, body.height};
  const bool flat = has_material_coordinates(view);
  const bool curvature = flat && view.curvature_per_m.size() == view.triangles.size() && !view.triangles.empty();
  if (curvature) {
    small.height = std::floor((body.height - 12) / 2);
    const Rect lower = {small.x, small.bottom() + 12, small.width, small.height};
    draw_panel(canvas, lower, "Curvature (1/m)");
    draw_curvature(canvas, lower, drawn);
  }
  draw_panel(canvas, small, flat ? "Laid flat" : "From above");
  if (flat) {
    draw_flat(canvas, inset(small, 16, 34, 16, 16), drawn, drawn.colours, true);
  } else {
    draw_view(canvas, small, drawn, {-90, 90}, false);
  }
  draw_legend(canvas, {rect.x + 18, body.bottom() + 24}, legend_of(view));
  double y = body.bottom() + 46;
  for (std::size_t i = 0; i < std::min<std::size_t>(caption.size(), 4); ++i) {
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
