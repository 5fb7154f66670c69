#pragma once

#include <optional>
#include <string>
#include <variant>
#include <vector>

#include "server/scene/scene.h"
#include "server/sheet/mesh_frame.h"
#include "server/synthesis/gain.h"

/// What a session's stream says, decoded, and what control says between: the engine's only input. Metres, seconds, z up,
/// whatever the sender's units.
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

/// From here on these gains are in force, on top of Options::gains, and no others.
struct GainChange {
  std::vector<synthesis::Gain> gains;
  bool operator==(const GainChange&) const = default;
};

/// From here on the sheet has another pack.
struct PackChange {
  sheet::SheetId sheet = 0;
  std::string material;         ///< empty: the one it has
  std::string touched_surface;  ///< empty: the one it has
  bool operator==(const PackChange&) const = default;
};

/// Packs were read anew: sheets take what the library now has of their materials.
struct PackReload {
  bool operator==(const PackReload&) const = default;
};

/// The daemon has more to do than it can, or no longer: from here on what economy.h says of the level holds.
struct LoadLevel {
  std::uint32_t level = 0;
  bool operator==(const LoadLevel&) const = default;
};

/// From here on the listener is there, until the stream says otherwise. It goes on looking where the stream said, or else
/// toward the sheets.
struct ListenerMove {
  sheet::Vec3d position_m = sheet::Vec3d::Zero();
  bool operator==(const ListenerMove&) const = default;
};

using StreamItem = std::variant<SheetDescription, sheet::MeshFrame, scene::SceneUpdate, scene::Listener, TearTips, Advance,
                                End, GainChange, PackChange, PackReload, LoadLevel, ListenerMove>;

}  // namespace rustle::engine
