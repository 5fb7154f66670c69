#pragma once

#include <cmath>
#include <cstdint>
#include <functional>
#include <memory>
#include <vector>

#include "server/sheet/topology.h"

/// Small meshes for the tests of `sheet`.
namespace rustle::test {

/// A rectangle of nx x ny cells, two triangles each, diagonals alternating.
struct Grid {
  std::vector<sheet::Vec2f> uv_m;
  std::vector<sheet::Triangle> triangles;

  Grid(std::uint32_t nx, std::uint32_t ny, float width_m, float height_m) {
    for (std::uint32_t j = 0; j <= ny; ++j) {
      for (std::uint32_t i = 0; i <= nx; ++i) {
        uv_m.emplace_back(width_m * static_cast<float>(i) / static_cast<float>(nx),
                          height_m * static_cast<float>(j) / static_cast<float>(ny));
      }
    }
    for (std::uint32_t j = 0; j < ny; ++j) {
      for (std::uint32_t i = 0; i < nx; ++i) {
        const std::uint32_t a = j * (nx + 1) + i, b = a + 1, d = a + nx + 1, c = d + 1;
        if ((i + j) % 2 == 0) {
          triangles.push_back({a, b, c}), triangles.push_back({a, c, d});
        } else {
          triangles.push_back({a, b, d}), triangles.push_back({b, c, d});
        }
      }
    }
  }

  std::vector<sheet::Vec3f> mapped(const std::function<sheet::Vec3f(sheet::Vec2f)>& map) const {
    std::vector<sheet::Vec3f> out;
    for (const auto& p : uv_m) out.push_back(map(p));
    return out;
  }
};

inline std::shared_ptr<const sheet::Topology> topology(std::size_t vertex_count, std::vector<sheet::Triangle> triangles,
                                                       std::vector<sheet::Vec2f> material = {}) {
  sheet::Topology::Input input;
  input.vertex_count = vertex_count;
  input.triangles = std::move(triangles);
  input.material_coordinates_m = std::move(material);
  return sheet::Topology::make(std::move(input)).value();
}

/// An arc of radius r about the y axis: a dome seen from above.
inline sheet::Vec3f rolled(sheet::Vec2f p, float radius_m) {
  const float a = p.x() / radius_m;
  return {radius_m * std::sin(a), p.y(), radius_m * std::cos(a)};
}

}  // namespace rustle::test
