#pragma once

#include <cmath>
#include <cstdint>
#include <functional>
#include <memory>
#include <utility>
#include <vector>

#include <catch2/catch.hpp>

#include "client_sdk/sheets/rectangle.h"
#include "server/analysis/contacts.h"
#include "server/sheet/face_geometry.h"

/// Sheets and scenes for the contact tests.
namespace contact_tests {

using namespace rustle;
using analysis::ContactTracker;
using analysis::NeighbourSheet;
using analysis::SheetSurroundings;
using observation::FrictionContact;
using sheet::MeshFrame;
using sheet::Topology;
using sheet::Vec3d;
using sheet::Vec3f;

inline constexpr double kRadius_m = 0.003;
inline constexpr double kWidth_m = 0.297;
inline constexpr double kHeight_m = 0.210;

inline std::shared_ptr<const Topology> topology_of(const sheets::SheetMesh& mesh, bool with_material = true) {
  Topology::Input input;
  input.vertex_count = mesh.material_coordinates.size();
  input.triangles = mesh.triangles;
  if (with_material) {
    for (const auto& uv : mesh.material_coordinates) input.material_coordinates_m.emplace_back(uv[0], uv[1]);
  }
  return Topology::make(std::move(input)).value();
}

using Map = std::function<Vec3d(double u_m, double v_m)>;

inline MeshFrame frame_at(std::shared_ptr<const Topology> topology, const sheets::SheetMesh& mesh, double time_s,
                          const Map& map, sheet::SheetId id = 1) {
  MeshFrame frame;
  frame.sheet = id;
  frame.time_s = time_s;
  frame.topology = std::move(topology);
  for (const auto& uv : mesh.material_coordinates) {
    frame.positions_m.push_back(map(static_cast<double>(uv[0]), static_cast<double>(uv[1])).cast<float>());
  }
  return frame;
}

inline scene::SceneState table_at(double height_m = 0) {
  scene::SceneState scene;
  scene::SceneUpdate update;
  scene::Obstacle table;
  table.id = 5;
  table.pose.position_m.z() = height_m;
  table.surface_material = "wooden-table";
  update.obstacles = {table};
  REQUIRE(scene.apply(update));
  return scene;
}

/// A frame's geometry with positions of its own.
struct OwnGeometry : analysis::ContactGeometry {
  std::vector<sheet::Vec4f> own_m;

  void update(const MeshFrame& mesh_frame) {
    sheet::relative_positions_m(mesh_frame.positions_m, mesh_frame.positions_m.front(), own_m);
    ContactGeometry::update(mesh_frame, mesh_frame.positions_m.front(), own_m);
  }
};

/// A tracker with what it needs between frames.
struct Run {
  ContactTracker tracker;
  std::unique_ptr<MeshFrame> previous;
  std::vector<sheet::Vec4f> relative_m;
  std::uint64_t next_id = 1;

  std::vector<FrictionContact> step(MeshFrame frame, const SheetSurroundings& surroundings) {
    sheet::relative_positions_m(frame.positions_m, Vec3f::Zero(), relative_m);
    auto contacts = tracker.update({frame, previous.get(), surroundings, kRadius_m, Vec3f::Zero(), relative_m}, next_id);
    previous = std::make_unique<MeshFrame>(std::move(frame));
    return contacts;
  }
};

inline SheetSurroundings only(const scene::SceneState& scene) {
  SheetSurroundings surroundings;
  surroundings.scene = &scene;
  surroundings.touched_surface = "cardboard";
  surroundings.material = "printer-paper";
  return surroundings;
}

inline double level_db(double a, double b) {
  return 20 * std::log10(a / b);
}

inline scene::SceneState scene_with(scene::Shape shape) {
  scene::SceneState scene;
  scene::SceneUpdate update;
  scene::Obstacle obstacle;
  obstacle.id = 1;
  obstacle.shape = std::move(shape);
  update.obstacles = {obstacle};
  REQUIRE(scene.apply(update));
  return scene;
}

/// A bent sheet of which about a tenth lies on z = 0.
inline Vec3d curled(double u_m, double v_m) {
  constexpr double kFlat_m = 0.024, kBend_m = 0.03, kTurn = 0.9;
  if (u_m < kFlat_m) return {u_m, v_m, 0};
  const double turn = (u_m - kFlat_m) / kBend_m;
  if (turn < kTurn) return {kFlat_m + kBend_m * std::sin(turn), v_m, kBend_m * (1 - std::cos(turn))};
  const double on_m = u_m - kFlat_m - kTurn * kBend_m;
  return {kFlat_m + kBend_m * std::sin(kTurn) + on_m * std::cos(kTurn), v_m,
          kBend_m * (1 - std::cos(kTurn)) + on_m * std::sin(kTurn)};
}

/// The left half 2 mm above the right one, which is drawn out from under it at 0.1 m/s.
inline Vec3d folded(double u_m, double v_m, double time_s) {
  constexpr double kGap_m = 0.002, kRadius = kGap_m / 2;
  const double fold_m = 0.15 - 0.05 * time_s;
  const double half_m = M_PI * kRadius / 2;
  if (u_m < fold_m - half_m) return {fold_m - half_m - u_m + 0.05 * time_s, v_m, kGap_m};
  if (u_m > fold_m + half_m) return {u_m - fold_m - half_m + 0.05 * time_s, v_m, 0};
  const double turn = (u_m - fold_m) / kRadius;
  return {-kRadius * std::cos(turn) + 0.05 * time_s, v_m, kRadius - kRadius * std::sin(turn)};
}

}  // namespace contact_tests
