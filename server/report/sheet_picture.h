#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <tl/expected.hpp>

#include "server/report/image_canvas.h"
#include "server/report/sound_event.h"
#include "server/scene/scene.h"
#include "server/sheet/topology.h"

namespace rustle::report {

/// One sheet at one time with what the analysis saw in it. Only positions and triangles are needed; what is empty is not
/// drawn. Indices that do not exist and points that are not finite are left out.
struct SheetView {
  std::string title;
  double time_s = 0;
  std::vector<sheet::Vec3f> positions_m;                             ///< [V]
  std::vector<sheet::Triangle> triangles;                            ///< [T]
  std::vector<std::uint32_t> triangle_regions;                       ///< [T] or empty; sheet::kNone: in none
  std::vector<bool> region_curved;                                   ///< [R] or empty: all curved
  std::vector<bool> ridge_triangles;                                 ///< [T] or empty
  std::vector<std::pair<std::uint32_t, std::uint32_t>> ridge_edges;  ///< vertices
  std::vector<float> curvature_per_m;              ///< [T] or empty: signed principal curvature of a triangle
  std::vector<std::pair<Vec3d, Vec3d>> rulings_m;  ///< whole rulings
  std::vector<sheet::Vec3f> ruling_directions;     ///< [T] or empty: unit length, drawn as a short line in curved regions
  struct Border {
    std::uint32_t start = 0, end = 0;  ///< vertices
    double free_weight = 0;            ///< 1: free and curved (P5), 0: held, straight or in contact
  };
  std::vector<Border> borders;
  std::vector<std::uint32_t> contacts;  ///< vertices
  std::vector<bool> anchored;           ///< [V] or empty
  std::vector<EventMark> events;
  std::vector<sheet::Vec2f> material_coordinates_m;  ///< [V] or empty: then the second panel looks down from above
  std::vector<scene::Obstacle> obstacles;
  std::optional<Vec3d> listener_m;
  std::vector<std::pair<std::string, std::string>> facts;  ///< further ones for the caption: label, value
};

/// Looks at the sheet along a parallel projection.
struct ViewDirection {
  double azimuth_deg = -60;   ///< of the viewer around z, from x toward y
  double elevation_deg = 32;  ///< of the viewer above the horizontal
};

/// Of eight azimuths the one that sees most of the sheet's area, `from.azimuth_deg` before others that see hardly more.
ViewDirection best_view(const SheetView& view, const ViewDirection& from = {});

/// A number below kCategories for each region, different for regions that share an edge (unless a region has kCategories
/// neighbours). Pure, O(T log T).
std::vector<int> region_categories(const SheetView& view);

/// A large oblique view, the far parts first, and beside it the sheet laid flat; below that its curvature when given; a
/// legend, a scale, and a caption with the numbers. `direction` absent: best_view.
void draw_sheet(Canvas& canvas, const Rect& rect, const SheetView& view, const std::optional<ViewDirection>& direction = {});

Image sheet_picture(const SheetView& view, const PictureSize& size = {1400, 860, 1, false},
                    const std::optional<ViewDirection>& direction = {});

/// Error: the path and what to do about it.
[[nodiscard]] tl::expected<void, std::string> write_sheet_png(const std::filesystem::path& path, const SheetView& view,
                                                              const PictureSize& size = {1400, 860, 1, false},
                                                              const std::optional<ViewDirection>& direction = {});

}  // namespace rustle::report
