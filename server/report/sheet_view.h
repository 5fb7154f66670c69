#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "server/report/sound_event.h"
#include "server/scene/scene.h"
#include "server/sheet/topology.h"

namespace rustle::report {

/// One sheet at one time with what the analysis saw in it. Only positions and triangles are needed; what is empty is not
/// drawn. Indices that do not exist and points that are not finite are left out.
struct SheetView {
  std::string title;
  double time_s = 0;
  std::size_t sheet_triangles = 0;              ///< when the mesh here is a proxy of a finer one: of that; else 0
  std::vector<sheet::Vec3f> positions_m;        ///< [V]
  std::vector<sheet::Triangle> triangles;       ///< [T]
  std::vector<std::uint32_t> triangle_regions;  ///< [T] or empty; sheet::kNone: in none
  std::vector<bool> region_curved;              ///< [R] or empty: all curved
  std::vector<ResonatorMark> resonators;        ///< [R] or empty: the regions measured
  std::vector<int> region_colours;              ///< [R] or empty: region_categories
  std::vector<bool> ridge_triangles;            ///< [T] or empty
  std::vector<std::pair<std::uint32_t, std::uint32_t>> ridge_edges;  ///< vertices
  std::vector<float> curvature_per_m;              ///< [T] or empty: signed principal curvature of a triangle
  std::vector<std::pair<Vec3d, Vec3d>> rulings_m;  ///< whole rulings
  std::vector<sheet::Vec3f> ruling_directions;     ///< [T] or empty: unit length, drawn as a short line in curved regions
  struct Border {
    std::uint32_t start = 0, end = 0;  ///< vertices
    double free_weight = 0;            ///< 1: free and curved (P5), 0: held, straight or in contact
  };
  std::vector<Border> borders;
  struct Contact {
    Vec3d position_m = Vec3d::Zero();
    std::optional<sheet::Vec2f> material_m;  ///< where it lies in the sheet laid flat
    bool sliding = false;
  };
  std::vector<Contact> contacts;  ///< one for each vertex that touches, of this mesh or a finer one
  std::vector<bool> anchored;     ///< [V] or empty
  std::vector<EventMark> events;
  double events_over_s = 0;                          ///< the events are those of so long before time_s; 0: not told
  std::vector<sheet::Vec2f> material_coordinates_m;  ///< [V] or empty: then nothing is laid flat
  std::vector<scene::Obstacle> obstacles;
  std::optional<Vec3d> listener_m;
  std::vector<std::pair<std::string, std::string>> facts;  ///< further ones for the caption: label, value
};

/// Looks at the sheet along a parallel projection.
struct ViewDirection {
  double azimuth_deg = -60;   ///< of the viewer around z, from x toward y
  double elevation_deg = 32;  ///< of the viewer above the horizontal
};

/// Of eight azimuths the one that sees most of the sheet's area, summed over the views, `from.azimuth_deg` before others
/// that see hardly more.
ViewDirection best_view(std::span<const SheetView> views, const ViewDirection& from = {});

/// A number below kCategories for each region, different for regions that share an edge (unless a region has kCategories
/// neighbours). Pure, O(T log T).
std::vector<int> region_categories(const SheetView& view);

/// The same for a later view of the same sheet, so that colours stay: a region takes the number of the region of `before`
/// that it has most of its area from, each of those handing its number on once, to the largest heir; the others take numbers
/// that are new beside their neighbours. `before.region_colours` are its numbers. Places correspond by triangle when the
/// triangles are the same, else by material coordinates, else by place around the sheet's middle. Pure, O(T log T) for the
/// same triangles, else O(T²); of two different meshes beyond 7000 triangles nothing is continued.
std::vector<int> continued_categories(const SheetView& before, const SheetView& view);

/// Indices of the `most` measured regions of largest area, largest first, ties by index.
std::vector<std::size_t> largest_regions(const SheetView& view, std::size_t most);

}  // namespace rustle::report
