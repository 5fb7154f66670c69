#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "server/report/axis.h"
#include "server/report/canvas.h"
#include "server/report/sheet_view.h"

/// The parts that pictures of a sheet are made of. Pure drawing.
namespace rustle::report {

struct Camera {
  Vec3d right, up, toward;  ///< unit length; toward: from the sheet to the viewer
};
Camera camera_of(const ViewDirection& direction);

/// Metres to pixels: u to the right, v up.
struct Fit {
  Point centre_px;
  double u_m = 0, v_m = 0;  ///< what lies at the centre
  double px_per_m = 1;
  Point operator()(double u, double v) const {
    return {centre_px.x + (u - u_m) * px_per_m, centre_px.y - (v - v_m) * px_per_m};
  }
};

struct Bounds {
  double left = 1e300, right = -1e300, bottom = 1e300, top = -1e300;
  void add(double u, double v);
  bool empty() const { return left > right; }
  double width() const { return empty() ? 0 : right - left; }
  double height() const { return empty() ? 0 : top - bottom; }
  /// As large as the panel allows, in its middle.
  Fit fit(const Rect& panel) const;
};

Rect inset(const Rect& rect, double left, double top, double right, double bottom);

/// A view whose indices exist and whose points are finite. Refers to it.
struct DrawnSheet {
  explicit DrawnSheet(const SheetView& a_view);

  const SheetView& view;
  std::vector<bool> usable;            ///< [V]
  std::vector<std::size_t> triangles;  ///< indices of drawable ones
  std::vector<Colour> colours;         ///< [T], before shading
  Vec3d centre_m = Vec3d::Zero();      ///< of the bounding box
  double radius_m = 0.1;               ///< half its diagonal
  double edge_m = 0.01;                ///< mean of the edges
  /// The part of the surroundings that is shown: the sheet's box unless set.
  Vec3d surroundings_m = Vec3d::Zero();
  double surroundings_radius_m = 0.1;

  Vec3d at(std::uint32_t vertex) const { return view.positions_m[vertex].cast<double>(); }
  Vec3d centroid(std::size_t triangle) const;
  bool is_usable(std::uint32_t vertex) const { return vertex < usable.size() && usable[vertex]; }
  bool is_ridge(std::size_t t) const { return t < view.ridge_triangles.size() && view.ridge_triangles[t]; }
  bool has_ruling(std::size_t t) const;
  /// A triangle to write on, as far in the middle of the region as one is seen, no ridge if possible.
  std::optional<std::size_t> middle_of(std::uint32_t region, const std::function<bool(std::size_t)>& is_seen) const;
  Bounds bounds(const Camera& camera) const;
};

struct SceneStyle {
  double mark_scale = 1;  ///< of rings, dots, squares and lines
  std::size_t most_rings = 1000;
  std::vector<std::size_t> lettered_regions;  ///< A, B, ...
  std::vector<std::size_t> numbered_events;   ///< 1, 2, ...
};

/// The sheet in space among its obstacles, far parts first, and its marks.
void draw_scene(Canvas& canvas, const Rect& panel, const DrawnSheet& drawn, const Camera& camera, const Fit& fit,
                const SceneStyle& style);

bool can_be_laid_flat(const SheetView& view);

/// The sheet in its material coordinates, filled with `colours` [T]. `style` null: no marks. \pre can_be_laid_flat
void draw_flat(Canvas& canvas, const Rect& panel, const DrawnSheet& drawn, std::span<const Colour> colours,
               const SceneStyle* style);

void draw_scale_bar(Canvas& canvas, const Rect& panel, double px_per_m);
/// The axes as the viewer sees them, from `origin`, and where the listener is.
void draw_compass(Canvas& canvas, const Point& origin, double arm, const Camera& camera, const DrawnSheet& drawn);

/// What a letter of a lettered region looks like.
void draw_letter(Canvas& canvas, const Point& at, char letter);
/// And the number of a numbered event.
void draw_number(Canvas& canvas, const Point& at, EventKind kind, std::size_t number);

/// Of everything that occurs in any of the views.
std::vector<LegendEntry> sheet_legend(std::span<const SheetView> views, const std::string& events);
/// Entries in as many rows as `width` needs, 20 pixels apart, the first around the base line left.y. Returns their number.
std::size_t draw_legend_rows(Canvas& canvas, const Point& left, double width, std::span<const LegendEntry> entries);
std::size_t legend_rows(double width, std::span<const LegendEntry> entries);

}  // namespace rustle::report
