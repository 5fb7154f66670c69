#pragma once

#include <optional>
#include <string>
#include <variant>
#include <vector>

#include "server/scene/scene.h"
#include "server/sheet/mesh_frame.h"

/// What a session's stream says, decoded: the engine's only input. Metres, seconds, z up, whatever the sender's units.
namespace rustle::engine {

enum class SheetKind { kPaper, kCloth };

struct SheetDescription {
  sheet::SheetId id = 0;
  std::string name;
  SheetKind kind = SheetKind::kPaper;
  std::string material;         ///< empty: the session's default
  std::string touched_surface;  ///< empty: "wooden-table"
  std::optional<double> grammage_kg_per_m2;
  std::optional<double> thickness_m;
};

/// Sound up to this time may be rendered, whatever frames are still to come.
struct Advance {
  double time_s = 0;
};

/// The last item: what is left is rendered, with its tails.
struct End {
  std::optional<double> time_s;  ///< absent: the newest time seen
};

/// Tear tips between frames.
struct TearTips {
  sheet::SheetId sheet = 0;
  double time_s = 0;
  std::vector<sheet::SentTearTip> tips;
};

using StreamItem =
    std::variant<SheetDescription, sheet::MeshFrame, scene::SceneUpdate, scene::Listener, TearTips, Advance, End>;

}  // namespace rustle::engine
