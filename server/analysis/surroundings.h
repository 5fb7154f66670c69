#pragma once

#include <span>
#include <string_view>

#include "server/scene/scene_state.h"
#include "server/sheet/mesh_frame.h"

/// What a sheet can touch, as the analysis of one of its frames sees it.
namespace rustle::analysis {

/// Another sheet near in time. The frames outlive the call they are passed to.
struct NeighbourSheet {
  sheet::SheetId id = 0;
  const sheet::MeshFrame* frame = nullptr;     ///< newest
  const sheet::MeshFrame* previous = nullptr;  ///< the one before, of the same topology; null: velocity unknown, taken as 0
  std::string_view material;                   ///< the surface that others rub against
};

struct SheetSurroundings {
  const scene::SceneState* scene = nullptr;  ///< null: no obstacles
  std::span<const NeighbourSheet> others;    ///< without the sheet itself
  std::string_view touched_surface;          ///< of the sheet: the surface of an obstacle that names none
  std::string_view material;                 ///< of the sheet: what its parts rub against in self-contact
};

}  // namespace rustle::analysis
