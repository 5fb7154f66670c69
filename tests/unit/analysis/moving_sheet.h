#pragma once

#include <cmath>
#include <cstdlib>
#include <functional>
#include <memory>
#include <vector>

#include "client_sdk/sheets/rectangle.h"
#include "client_sdk/sheets/shape.h"
#include "server/analysis/sheet_analyzer.h"
#include "server/scene/scene_state.h"

/// Procedural sheets as mesh frames.
namespace rustle::test {

inline std::shared_ptr<const sheet::Topology> topology_of(const sheets::SheetMesh& mesh, bool with_material = true) {
  sheet::Topology::Input input;
  input.vertex_count = mesh.material_coordinates.size();
  input.triangles = mesh.triangles;
  if (with_material) {
    for (const auto& uv : mesh.material_coordinates) input.material_coordinates_m.emplace_back(uv[0], uv[1]);
  }
  return sheet::Topology::make(std::move(input)).value();
}

using Map = std::function<sheet::Vec3d(double u_m, double v_m)>;

inline Map map_of(const sheets::Shape& shape) {
  return [&shape](double u, double v) {
    const auto p = shape.at(u, v);
    return sheet::Vec3d(p[0], p[1], p[2]);
  };
}

inline sheet::MeshFrame frame_of(const sheets::SheetMesh& mesh, std::shared_ptr<const sheet::Topology> topology,
                                 const Map& map, double time_s = 0) {
  sheet::MeshFrame frame;
  frame.sheet = 1;
  frame.time_s = time_s;
  frame.topology = std::move(topology);
  for (const auto& uv : mesh.material_coordinates) {
    frame.positions_m.push_back(map(static_cast<double>(uv[0]), static_cast<double>(uv[1])).cast<float>());
  }
  return frame;
}

/// Bent along u, all rulings along v; H = curvature / 2 everywhere.
inline Map arc(double curvature_per_m, double width_m = 0.297) {
  return [=](double u, double v) {
    const double s = u - width_m / 2, a = curvature_per_m * s;
    if (std::abs(a) < 1e-9) return sheet::Vec3d(s, v, 0);
    return sheet::Vec3d(std::sin(a) / curvature_per_m, v, (std::cos(a) - 1) / curvature_per_m);
  };
}

inline Map moved(const Map& map, const Eigen::Quaterniond& turn, const sheet::Vec3d& shift_m) {
  return [=](double u, double v) { return sheet::Vec3d(turn * map(u, v) + shift_m); };
}

/// A table of the plane z = 0.
inline scene::SceneState table_at_zero() {
  scene::SceneState scene;
  scene::SceneUpdate update;
  scene::Obstacle table;
  table.id = 5;
  table.shape = scene::PlaneShape{};
  update.obstacles = {table};
  if (!scene.apply(update)) std::abort();
  return scene;
}

}  // namespace rustle::test
