#include "server/report/sheet_drawing.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <numbers>
#include <numeric>
#include <set>

#include <fmt/format.h>

#include "server/report/obstacle_wires.h"
#include "server/report/timeline.h"

namespace rustle::report {
namespace {

constexpr Colour kRidge = {0.30, 0.22, 0.19};
constexpr Colour kPlain = {0.86, 0.85, 0.82};
constexpr Colour kInkLine = {0.12, 0.12, 0.14};
constexpr Colour kFreeBorder = {0.98, 0.80, 0.10};
constexpr Colour kWhite = {1, 1, 1};
constexpr Colour kResting = {0.45, 0.56, 0.68};
constexpr double kFlatPale = 0.62;
constexpr double kLeastFreeWeight = 0.02;
constexpr double kLeastRing = 5, kGreatestRing = 20;
constexpr Colour kBackTone = {0.66, 0.67, 0.72};
constexpr double kBackShare = 0.28;
constexpr double kLeastMeshLine_px = 24;  // mean edge from which the mesh is drawn

/// Tints are light in every theme, so what lies on them takes the light theme's colours.
const Colour& on_tint(Ink ink) {
  return light_theme()[static_cast<std::size_t>(ink)];
}

double ring_radius(const EventMark& event) {
  return kLeastRing + (kGreatestRing - kLeastRing) * amplitude_height(event.amplitude, reference_amplitude(event.kind));
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

/// Lets through the first mark in each cell of a grid, so that marks stay apart however fine the mesh.
class Thinning {
 public:
  explicit Thinning(double spacing) : spacing_(std::max(spacing, 1e-9)) {}
  bool admits(const Vec3d& place) {
    const Eigen::Vector3d cell = (place / spacing_).array().floor();
    return cell.cwiseAbs().maxCoeff() < 1e9 &&
           taken_.insert({static_cast<long>(cell.x()), static_cast<long>(cell.y()), static_cast<long>(cell.z())}).second;
  }

 private:
  double spacing_;
  std::set<std::array<long, 3>> taken_;
};

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

void draw_contact(Canvas& canvas, const Point& at, bool sliding, double radius) {
  canvas.disc(at, radius + 1, {kWhite, sliding ? 0.9 : 0.5});
  canvas.disc(at, radius, sliding ? Paint(on_tint(Ink::kFriction)) : Paint(kResting));
}

void draw_anchor(Canvas& canvas, const Point& at, double half) {
  canvas.rectangle({at.x - half - 1, at.y - half - 1, 2 * half + 2, 2 * half + 2}, kWhite);
  canvas.rectangle({at.x - half, at.y - half, 2 * half, 2 * half}, kInkLine);
}

double ruling_spacing_px(double mark_scale) {
  return std::max(13.0, 25 * mark_scale);
}

/// Those contacts that have room beside each other, sliding ones before resting ones; the most important last.
std::vector<const SheetView::Contact*> shown_contacts(const SheetView& view, double px_per_m, double mark_scale) {
  std::vector<const SheetView::Contact*> shown;
  Thinning thinning((20 - 13 * mark_scale) / px_per_m);
  for (const bool sliding : {true, false}) {
    for (const auto& contact : view.contacts) {
      if (contact.sliding != sliding || !contact.position_m.allFinite()) continue;
      if (thinning.admits(contact.position_m)) shown.push_back(&contact);
    }
  }
  std::reverse(shown.begin(), shown.end());
  return shown;
}

/// Whether a triangle lies between the viewer and a place of the sheet.
class Hiding {
 public:
  Hiding(const DrawnSheet& drawn, const Camera& camera) : camera_(camera), least_m_(0.6 * drawn.edge_m) {
    for (const std::size_t t : drawn.triangles) {
      const sheet::Triangle& corner = drawn.view.triangles[t];
      triangles_.push_back({seen(drawn.at(corner[0])), seen(drawn.at(corner[1])), seen(drawn.at(corner[2]))});
    }
  }
  bool hidden(const Vec3d& place) const {
    const Vec3d p = seen(place);
    return std::any_of(triangles_.begin(), triangles_.end(), [&](const std::array<Vec3d, 3>& t) {
      const double whole = turn(t[0], t[1], t[2]);
      if (std::abs(whole) < 1e-18) return false;
      const double a = turn(p, t[1], t[2]) / whole, b = turn(t[0], p, t[2]) / whole, c = 1 - a - b;
      return a >= 0 && b >= 0 && c >= 0 && a * t[0].z() + b * t[1].z() + c * t[2].z() > p.z() + least_m_;
    });
  }

 private:
  Vec3d seen(const Vec3d& p) const { return {p.dot(camera_.right), p.dot(camera_.up), p.dot(camera_.toward)}; }
  static double turn(const Vec3d& a, const Vec3d& b, const Vec3d& c) {
    return (b.x() - a.x()) * (c.y() - a.y()) - (b.y() - a.y()) * (c.x() - a.x());
  }
  const Camera& camera_;
  double least_m_;
  std::vector<std::array<Vec3d, 3>> triangles_;
};

void draw_wires(DepthSorted& parts, Canvas& canvas, const Fit& fit, const Camera& camera, const DrawnSheet& drawn,
                double mark_scale) {
  const double faint = 0.15 + 0.3 * mark_scale;
  for (const scene::Obstacle& obstacle : drawn.view.obstacles) {
    const std::vector<Segment> wires = obstacle_wires(obstacle, drawn.surroundings_m, drawn.surroundings_radius_m);
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
        parts.add((a + b) / 2, -drawn.edge_m, [&canvas, from_px = point(a), to_px = point(b), faint] {
          canvas.line(from_px, to_px, {{Ink::kMuted, faint}, 0.9});
        });
      }
    }
  }
}

/// Draws one sheet's scene part by part into a DepthSorted.
struct ScenePainter {
  Canvas& canvas;
  const DrawnSheet& drawn;
  const Camera& camera;
  const Fit& fit;
  double mark_scale;
  DepthSorted& parts;

  Point point(const Vec3d& p) const { return fit(p.dot(camera.right), p.dot(camera.up)); }
  double lift() const { return 0.8 * drawn.edge_m; }

  void triangles() {
    const Vec3d light = (camera.toward + 0.7 * camera.up - 0.5 * camera.right).normalized();
    const bool mesh_lines = drawn.edge_m * fit.px_per_m > kLeastMeshLine_px && mark_scale > 0.9;
    for (const std::size_t t : drawn.triangles) {
      const sheet::Triangle& corner = drawn.view.triangles[t];
      const Vec3d a = drawn.at(corner[0]), b = drawn.at(corner[1]), c = drawn.at(corner[2]);
      Vec3d normal = (b - a).cross(c - a);
      const double length = normal.norm();
      normal = length > 0 ? Vec3d(normal / length) : camera.toward;
      const bool back = normal.dot(camera.toward) < 0;
      const double bright = 0.66 + 0.40 * std::max(0.0, (back ? Vec3d(-normal) : normal).dot(light));
      const Colour& base = drawn.colours[t];
      const Colour toned = back && !drawn.is_ridge(t) ? mix(base, kBackTone, kBackShare) : base;
      const Colour shaded = bright < 1 ? mix({0.05, 0.05, 0.10}, toned, bright) : mix(toned, kWhite, (bright - 1) * 2);
      const std::array<Point, 4> corners = {point(a), point(b), point(c), point(a)};
      const Paint lines = {drawn.is_ridge(t) ? kWhite : kInkLine, 0.16};
      parts.add((a + b + c) / 3, 0, [&canvas_ = canvas, corners, shaded, mesh_lines, lines] {
        canvas_.polygon(corners, shaded);
        canvas_.polyline(corners, {shaded, 0.8});
        if (mesh_lines) canvas_.polyline(corners, {lines, 0.6});
      });
    }
  }

  void line(const Vec3d& from, const Vec3d& to, double more, const Stroke& stroke) {
    if (!from.allFinite() || !to.allFinite()) return;
    const int pieces = std::clamp(static_cast<int>(std::ceil((to - from).norm() / drawn.edge_m)), 1, 256);
    for (int i = 0; i < pieces; ++i) {
      const Vec3d a = from + (to - from) * i / pieces, b = from + (to - from) * (i + 1) / pieces;
      parts.add((a + b) / 2, lift() + more,
                [&canvas_ = canvas, from_px = point(a), to_px = point(b), stroke] { canvas_.line(from_px, to_px, stroke); });
    }
  }

  void rulings() {
    for (const auto& [from, to] : drawn.view.rulings_m) line(from, to, 0, {{kInkLine, 0.5}, 0.9});
    const double spacing_m = ruling_spacing_px(mark_scale) / fit.px_per_m;
    Thinning thinning(spacing_m);
    for (const std::size_t t : drawn.triangles) {
      if (!drawn.has_ruling(t)) continue;
      const Vec3d centre = drawn.centroid(t);
      if (drawn.edge_m < spacing_m && !thinning.admits(centre)) continue;
      const Vec3d half = 0.33 * std::max(drawn.edge_m, spacing_m) * drawn.view.ruling_directions[t].cast<double>();
      parts.add(centre, lift(), [&canvas_ = canvas, from_px = point(centre - half), to_px = point(centre + half)] {
        canvas_.line(from_px, to_px, {{kInkLine, 0.7}, 1});
      });
    }
  }

  void edges() {
    for (const auto& [start, end] : drawn.view.ridge_edges) {
      if (drawn.is_usable(start) && drawn.is_usable(end)) line(drawn.at(start), drawn.at(end), 0, {kRidge, 2});
    }
    const double thick = 0.4 + 0.6 * mark_scale;
    for (const SheetView::Border& border : drawn.view.borders) {
      if (!drawn.is_usable(border.start) || !drawn.is_usable(border.end)) continue;
      const Vec3d start = drawn.at(border.start), end = drawn.at(border.end);
      const double weight = std::clamp(border.free_weight, 0.0, 1.0);
      const bool free = weight > kLeastFreeWeight;
      line(start, end, 0, {{kInkLine, free ? 0.9 : 0.6}, (free ? 4.6 : 1.2) * thick});
      if (free) line(start, end, lift(), {{kFreeBorder, weight}, 2.8 * thick});
    }
  }

  void held() {
    const double radius = std::max(1.6, mark_scale * std::clamp(0.22 * drawn.edge_m * fit.px_per_m, 1.6, 2.8));
    for (const auto* contact : shown_contacts(drawn.view, fit.px_per_m, mark_scale)) {
      parts.add(contact->position_m, lift() * (contact->sliding ? 1.04 : 1.03),
                [&canvas_ = canvas, at = point(contact->position_m), sliding = contact->sliding, radius] {
                  draw_contact(canvas_, at, sliding, radius);
                });
    }
    for (std::uint32_t v = 0; v < drawn.view.anchored.size(); ++v) {
      if (!drawn.view.anchored[v] || !drawn.is_usable(v)) continue;
      parts.add(drawn.at(v), lift() * 1.02,
                [&canvas_ = canvas, at = point(drawn.at(v)), half = 3 * mark_scale] { draw_anchor(canvas_, at, half); });
    }
  }
};

struct Ring {
  double scale = 1;
  std::size_t number = 0;  ///< 0: none
  bool hidden = false;
};

void draw_ring(Canvas& canvas, const Point& at, const EventMark& event, const Ring& ring) {
  const double radius = ring.scale * ring_radius(event), width = 0.5 + 0.5 * ring.scale;
  const Colour& ink = on_tint(ink_of(event.kind));
  if (!ring.hidden) {
    canvas.disc(at, radius, {ink, 0.16});
    canvas.circle(at, radius, {kWhite, 3.6 * width});
  }
  canvas.circle(at, radius, {ink, (ring.hidden ? 1.6 : 2.2) * width, ring.hidden});
  if (ring.number != 0) draw_number(canvas, {at.x + 0.71 * radius + 5, at.y - 0.71 * radius - 5}, event.kind, ring.number);
}

std::size_t number_of(const SceneStyle& style, std::size_t event) {
  const auto found = std::find(style.numbered_events.begin(), style.numbered_events.end(), event);
  return found == style.numbered_events.end() ? 0 : static_cast<std::size_t>(found - style.numbered_events.begin()) + 1;
}

/// Of the largest events, the largest last.
std::vector<std::size_t> drawn_events(const SheetView& view, const SceneStyle& style) {
  std::vector<std::size_t> order = largest_events(view.events, style.most_rings);
  std::reverse(order.begin(), order.end());
  std::erase_if(order, [&](std::size_t i) { return !view.events[i].position_m.allFinite(); });
  return order;
}

void draw_letters(Canvas& canvas, const DrawnSheet& drawn, const SceneStyle& style,
                  const std::function<bool(std::size_t)>& is_seen, const std::function<Point(std::size_t)>& place_of) {
  for (std::size_t i = 0; i < style.lettered_regions.size() && i < 26; ++i) {
    const auto triangle = drawn.middle_of(static_cast<std::uint32_t>(style.lettered_regions[i]), is_seen);
    if (triangle) draw_letter(canvas, place_of(*triangle), static_cast<char>('A' + i));
  }
}

/// The vertex nearest to a place, by which it is found in material coordinates.
std::optional<std::uint32_t> nearest_vertex(const DrawnSheet& drawn, const Vec3d& place) {
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

}  // namespace

Camera camera_of(const ViewDirection& direction) {
  const double a = direction.azimuth_deg * std::numbers::pi / 180, e = direction.elevation_deg * std::numbers::pi / 180;
  return {{-std::sin(a), std::cos(a), 0},
          {-std::sin(e) * std::cos(a), -std::sin(e) * std::sin(a), std::cos(e)},
          {std::cos(e) * std::cos(a), std::cos(e) * std::sin(a), std::sin(e)}};
}

void Bounds::add(double u, double v) {
  left = std::min(left, u);
  right = std::max(right, u);
  bottom = std::min(bottom, v);
  top = std::max(top, v);
}

Fit Bounds::fit(const Rect& panel) const {
  const Point centre = {panel.x + panel.width / 2, panel.y + panel.height / 2};
  if (empty()) return {centre, 0, 0, panel.width};
  return {centre, (left + right) / 2, (bottom + top) / 2,
          std::min(panel.width / std::max(width(), 1e-6), panel.height / std::max(height(), 1e-6))};
}

Rect inset(const Rect& rect, double left, double top, double right, double bottom) {
  return {rect.x + left, rect.y + top, std::max(1.0, rect.width - left - right), std::max(1.0, rect.height - top - bottom)};
}

DrawnSheet::DrawnSheet(const SheetView& a_view) : view(a_view) {
  Eigen::AlignedBox3d box;
  for (const sheet::Vec3f& p : view.positions_m) {
    usable.push_back(p.allFinite());
    if (p.allFinite()) box.extend(p.cast<double>());
  }
  if (!box.isEmpty()) {
    centre_m = box.center();
    radius_m = std::max(1e-3, box.diagonal().norm() / 2);
  }
  surroundings_m = centre_m;
  surroundings_radius_m = radius_m;
  const std::vector<int> categories = view.region_colours.empty() ? region_categories(view) : view.region_colours;
  double length_m = 0;
  for (std::size_t t = 0; t < view.triangles.size(); ++t) {
    const sheet::Triangle& corner = view.triangles[t];
    const std::uint32_t region = t < view.triangle_regions.size() ? view.triangle_regions[t] : sheet::kNone;
    Colour colour = kPlain;
    if (region < categories.size()) {
      colour = category_colour(categories[region]);
      if (region < view.region_curved.size() && !view.region_curved[region]) colour = mix(colour, kPlain, kFlatPale);
    }
    colours.push_back(is_ridge(t) ? kRidge : colour);
    if (!std::all_of(corner.begin(), corner.end(), [&](std::uint32_t v) { return is_usable(v); })) continue;
    triangles.push_back(t);
    for (std::size_t k = 0; k < 3; ++k) length_m += (at(corner[k]) - at(corner[(k + 1) % 3])).norm();
  }
  if (!triangles.empty()) edge_m = std::max(1e-6, length_m / (3.0 * static_cast<double>(triangles.size())));
}

Vec3d DrawnSheet::centroid(std::size_t triangle) const {
  const sheet::Triangle& corner = view.triangles[triangle];
  return (at(corner[0]) + at(corner[1]) + at(corner[2])) / 3;
}

bool DrawnSheet::has_ruling(std::size_t t) const {
  if (t >= view.ruling_directions.size() || is_ridge(t) || !view.ruling_directions[t].allFinite()) return false;
  const std::uint32_t region = t < view.triangle_regions.size() ? view.triangle_regions[t] : sheet::kNone;
  return region >= view.region_curved.size() || view.region_curved[region];
}

std::optional<std::size_t> DrawnSheet::middle_of(std::uint32_t region,
                                                 const std::function<bool(std::size_t)>& is_seen) const {
  constexpr std::size_t kTried = 60;
  Vec3d middle = Vec3d::Zero();
  std::vector<std::size_t> own;
  for (const std::size_t t : triangles) {
    if (t >= view.triangle_regions.size() || view.triangle_regions[t] != region) continue;
    own.push_back(t);
    middle += centroid(t);
  }
  if (own.empty()) return std::nullopt;
  middle /= static_cast<double>(own.size());
  std::stable_sort(own.begin(), own.end(), [&](std::size_t a, std::size_t b) {
    return std::pair(is_ridge(a), (centroid(a) - middle).squaredNorm()) <
           std::pair(is_ridge(b), (centroid(b) - middle).squaredNorm());
  });
  own.resize(std::min(own.size(), kTried));
  const auto seen = std::find_if(own.begin(), own.end(), is_seen);
  return seen == own.end() ? std::nullopt : std::optional(*seen);
}

Bounds DrawnSheet::bounds(const Camera& camera) const {
  Bounds bounds;
  for (std::uint32_t v = 0; v < usable.size(); ++v) {
    if (usable[v]) bounds.add(at(v).dot(camera.right), at(v).dot(camera.up));
  }
  return bounds;
}

void draw_letter(Canvas& canvas, const Point& at, char letter) {
  canvas.disc(at, 8.5, {kInkLine, 0.85});
  canvas.disc(at, 7.5, kWhite);
  canvas.text({at.x, at.y + 4}, std::string(1, letter),
              {.size = 11, .paint = kInkLine, .align = Align::kCentre, .bold = true});
}

void draw_number(Canvas& canvas, const Point& at, EventKind kind, std::size_t number) {
  canvas.disc(at, 7.5, on_tint(ink_of(kind)));
  canvas.text({at.x, at.y + 4}, fmt::format("{}", number),
              {.size = 10.5, .paint = kWhite, .align = Align::kCentre, .bold = true});
}

void draw_scene(Canvas& canvas, const Rect& panel, const DrawnSheet& drawn, const Camera& camera, const Fit& fit,
                const SceneStyle& style) {
  DepthSorted parts(camera);
  draw_wires(parts, canvas, fit, camera, drawn, style.mark_scale);
  ScenePainter painter{canvas, drawn, camera, fit, style.mark_scale, parts};
  painter.triangles();
  painter.rulings();
  painter.edges();
  painter.held();
  canvas.clip(panel);
  parts.draw();
  const Hiding hiding(drawn, camera);
  for (const std::size_t i : drawn_events(drawn.view, style)) {
    const EventMark& event = drawn.view.events[i];
    draw_ring(canvas, painter.point(event.position_m), event,
              {style.mark_scale, number_of(style, i), hiding.hidden(event.position_m)});
  }
  draw_letters(
      canvas, drawn, style, [&](std::size_t t) { return !hiding.hidden(drawn.centroid(t)); },
      [&](std::size_t t) { return painter.point(drawn.centroid(t)); });
  canvas.unclip();
  if (drawn.triangles.empty()) {
    canvas.text({panel.x + panel.width / 2, panel.y + panel.height / 2}, "no triangles",
                {.size = 13, .paint = Ink::kMuted, .align = Align::kCentre});
  }
}

bool can_be_laid_flat(const SheetView& view) {
  return !view.material_coordinates_m.empty() && view.material_coordinates_m.size() == view.positions_m.size() &&
         std::all_of(view.material_coordinates_m.begin(), view.material_coordinates_m.end(),
                     [](const sheet::Vec2f& c) { return c.allFinite(); });
}

void draw_flat(Canvas& canvas, const Rect& panel, const DrawnSheet& drawn, std::span<const Colour> colours,
               const SceneStyle* style) {
  const SheetView& view = drawn.view;
  Bounds bounds;
  const auto place = [](const sheet::Vec2f& c) { return sheet::Vec2d(c.cast<double>()); };
  for (const sheet::Vec2f& c : view.material_coordinates_m) bounds.add(place(c).x(), place(c).y());
  const Fit fit = bounds.fit(panel);
  const auto at = [&](const sheet::Vec2d& c) { return fit(c.x(), c.y()); };
  const auto point = [&](std::uint32_t v) { return at(place(view.material_coordinates_m[v])); };
  for (const std::size_t t : drawn.triangles) {
    const sheet::Triangle& corner = view.triangles[t];
    const std::array<Point, 4> corners = {point(corner[0]), point(corner[1]), point(corner[2]), point(corner[0])};
    canvas.polygon(corners, colours[t]);
    canvas.polyline(corners, {colours[t], 0.8});
  }
  std::vector<std::pair<Point, Point>> lines, ridges, borders;
  for (const std::size_t t : drawn.triangles) {
    if (drawn.edge_m * fit.px_per_m <= kLeastMeshLine_px || style == nullptr) break;
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
  if (style == nullptr) return;
  for (const SheetView::Border& border : view.borders) {
    if (!drawn.is_usable(border.start) || !drawn.is_usable(border.end) || border.free_weight <= kLeastFreeWeight) continue;
    canvas.line(point(border.start), point(border.end), {{kInkLine, 0.9}, 4});
    canvas.line(point(border.start), point(border.end), {{kFreeBorder, std::min(1.0, border.free_weight)}, 2.4});
  }
  const double radius = std::clamp(0.2 * drawn.edge_m * fit.px_per_m, 1.2, 1.8);
  for (const auto* contact : shown_contacts(view, fit.px_per_m, style->mark_scale)) {
    if (contact->material_m) draw_contact(canvas, at(place(*contact->material_m)), contact->sliding, radius);
  }
  for (std::uint32_t v = 0; v < view.anchored.size(); ++v) {
    if (view.anchored[v] && drawn.is_usable(v)) draw_anchor(canvas, point(v), 2);
  }
  for (const std::size_t i : drawn_events(view, *style)) {
    const EventMark& event = view.events[i];
    if (const auto vertex = nearest_vertex(drawn, event.position_m))
      draw_ring(canvas, point(*vertex), event, {0.7 * style->mark_scale, number_of(*style, i), false});
  }
  draw_letters(
      canvas, drawn, *style, [](std::size_t) { return true; },
      [&](std::size_t t) {
        const sheet::Triangle& corner = view.triangles[t];
        const Point a = point(corner[0]), b = point(corner[1]), c = point(corner[2]);
        return Point{(a.x + b.x + c.x) / 3, (a.y + b.y + c.y) / 3};
      });
}

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

void draw_compass(Canvas& canvas, const Point& origin, double arm, const Camera& camera, const DrawnSheet& drawn) {
  const auto end = [&](const Vec3d& axis, double length) {
    return Point{origin.x + length * axis.dot(camera.right), origin.y - length * axis.dot(camera.up)};
  };
  const std::array<std::pair<Vec3d, std::string_view>, 3> axes = {
      {{Vec3d::UnitX(), "x"}, {Vec3d::UnitY(), "y"}, {Vec3d::UnitZ(), "z"}}};
  for (const auto& [axis, name] : axes) {
    const Point tip = end(axis, arm), label = end(axis, arm + 9);
    if (std::hypot(tip.x - origin.x, tip.y - origin.y) < 5) continue;
    draw_arrow(canvas, origin, tip, Ink::kMuted, 1.2);
    canvas.text({label.x, label.y + 4}, name, {.size = kLabelSize, .paint = Ink::kMuted, .align = Align::kCentre});
  }
  if (!drawn.view.listener_m || !drawn.view.listener_m->allFinite()) return;
  const Vec3d way = *drawn.view.listener_m - drawn.centre_m;
  if (way.norm() < 1e-6) return;
  draw_arrow(canvas, origin, end(way.normalized(), arm + 8), Ink::kLimit, 2.2);
  canvas.disc(origin, 2.5, Ink::kLimit);
}

std::vector<LegendEntry> sheet_legend(std::span<const SheetView> views, const std::string& events) {
  using Shape = LegendEntry::Shape;
  const auto any = [&](auto&& has) { return std::any_of(views.begin(), views.end(), has); };
  const auto any_region = [&](bool curved) {
    return any([&](const SheetView& view) {
      return std::any_of(view.triangle_regions.begin(), view.triangle_regions.end(), [&](std::uint32_t region) {
        return region != sheet::kNone && (region >= view.region_curved.size() || view.region_curved[region]) == curved;
      });
    });
  };
  const auto any_contact = [&](bool sliding) {
    return any([&](const SheetView& view) {
      return std::any_of(view.contacts.begin(), view.contacts.end(), [&](const auto& c) { return c.sliding == sliding; });
    });
  };
  std::vector<LegendEntry> entries;
  if (any_region(true)) entries.push_back({"bent region (a colour each)", category_colour(0), Shape::kBox});
  if (any_region(true)) entries.push_back({"its back", mix(category_colour(0), kBackTone, 2 * kBackShare), Shape::kBox});
  if (any_region(false)) entries.push_back({"flat region (pale)", mix(category_colour(0), kPlain, kFlatPale), Shape::kBox});
  if (any([](const auto& view) {
        return !view.ridge_edges.empty() || std::count(view.ridge_triangles.begin(), view.ridge_triangles.end(), true) > 0;
      }))
    entries.push_back({"ridge", kRidge, Shape::kBox});
  if (any([](const auto& view) { return !view.rulings_m.empty() || !view.ruling_directions.empty(); }))
    entries.push_back({"ruling", {Ink::kMuted, 0.8}, Shape::kLine});
  if (any([](const auto& view) {
        return std::any_of(view.borders.begin(), view.borders.end(),
                           [](const auto& b) { return b.free_weight > kLeastFreeWeight; });
      }))
    entries.push_back({"free curved border", kFreeBorder, Shape::kBox});
  if (any_contact(true)) entries.push_back({"sliding contact", on_tint(Ink::kFriction), Shape::kDot});
  if (any_contact(false)) entries.push_back({"resting contact", kResting, Shape::kDot});
  if (any([](const auto& view) { return std::count(view.anchored.begin(), view.anchored.end(), true) > 0; }))
    entries.push_back({"anchored", Ink::kText, Shape::kSquare});
  std::vector<EventMark> marks;
  for (const auto& view : views) marks.insert(marks.end(), view.events.begin(), view.events.end());
  for (LegendEntry entry : kind_legend(marks)) {
    entry.shape = Shape::kRing;
    entry.paint = on_tint(entry.paint.ink);
    entry.text += events + " (dashed: hidden)";
    entries.push_back(entry);
  }
  if (any([](const auto& view) { return !view.obstacles.empty(); }))
    entries.push_back({"obstacle", {Ink::kMuted, 0.6}, Shape::kLine});
  if (any([](const auto& view) { return view.listener_m.has_value(); }))
    entries.push_back({"toward the listener", Ink::kLimit, Shape::kLine});
  return entries;
}

namespace {

/// Where each row of the legend ends.
std::vector<std::size_t> row_ends(double width, std::span<const LegendEntry> entries) {
  std::vector<std::size_t> ends;
  std::size_t begin = 0;
  for (std::size_t i = 0; i < entries.size(); ++i) {
    if (i > begin && legend_width(entries.subspan(begin, i + 1 - begin)) > width) {
      ends.push_back(i);
      begin = i;
    }
  }
  if (begin < entries.size()) ends.push_back(entries.size());
  return ends;
}

}  // namespace

std::size_t legend_rows(double width, std::span<const LegendEntry> entries) {
  return row_ends(width, entries).size();
}

std::size_t draw_legend_rows(Canvas& canvas, const Point& left, double width, std::span<const LegendEntry> entries) {
  std::size_t begin = 0, row = 0;
  for (const std::size_t end : row_ends(width, entries)) {
    draw_legend(canvas, {left.x, left.y + 20 * static_cast<double>(row++)}, entries.subspan(begin, end - begin));
    begin = end;
  }
  return row;
}

}  // namespace rustle::report
