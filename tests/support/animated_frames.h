#pragma once

#include <memory>
#include <utility>
#include <vector>

#include "client_sdk/sheets/animated_sheet.h"
#include "server/sheet/mesh_frame.h"

namespace rustle::test_support {

/// A procedural sheet as the mesh frames that `wire` would make of it.
class AnimatedFrames {
 public:
  explicit AnimatedFrames(const sheets::AnimatedSheet& sheet, sheet::SheetId id = 1) : sheet_(sheet), id_(id) {
    const auto& mesh = sheet.mesh();
    sheet::Topology::Input input;
    input.id = 1;
    input.vertex_count = mesh.material_coordinates.size();
    for (const auto& t : mesh.triangles) input.triangles.push_back({t[0], t[1], t[2]});
    for (const auto& m : mesh.material_coordinates) input.material_coordinates_m.emplace_back(m[0], m[1]);
    topology_ = sheet::Topology::make(std::move(input)).value();
  }

  sheet::MeshFrame at(double time_s) const {
    sheet::MeshFrame frame;
    frame.sheet = id_;
    frame.time_s = time_s;
    frame.topology = topology_;
    std::vector<float> xyz(3 * topology_->vertex_count());
    sheet_.positions(time_s, xyz);
    for (std::size_t v = 0; v < topology_->vertex_count(); ++v)
      frame.positions_m.emplace_back(xyz[3 * v], xyz[3 * v + 1], xyz[3 * v + 2]);
    std::vector<std::uint8_t> held(topology_->vertex_count());
    sheet_.anchored(time_s, held);
    frame.anchored.assign(held.begin(), held.end());
    return frame;
  }

 private:
  const sheets::AnimatedSheet& sheet_;
  sheet::SheetId id_;
  std::shared_ptr<const sheet::Topology> topology_;
};

}  // namespace rustle::test_support
