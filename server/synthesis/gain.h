#pragma once

#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "server/sheet/mesh_frame.h"
#include "server/synthesis/cue.h"

/// Gains on top of the packs' levels. Pure; any thread.
namespace rustle::synthesis {

inline constexpr double kMostGain_db = 24;      ///< of one gain
inline constexpr double kMostGainsSum_db = 60;  ///< of all that concern a sound

/// A gain and the sounds it concerns: those of this sheet, kind and material.
struct Gain {
  double gain_db = 0;                        ///< up to kMostGain_db; -infinity: silence
  std::optional<sheet::SheetId> sheet_id{};  ///< absent: every sheet
  std::optional<SoundKind> kind{};           ///< absent: every kind
  std::string material{};                    ///< of the sheet; empty: every material

  bool same_sounds(const Gain& other) const {
    return sheet_id == other.sheet_id && kind == other.kind && material == other.material;
  }
  bool operator==(const Gain&) const = default;
};

/// The product, in dB, of all gains that concern such a sound; at most kMostGainsSum_db.
double gain_db_of(std::span<const Gain> gains, sheet::SheetId sheet, SoundKind kind, std::string_view material);

/// The gains in force after `changes`: each takes the place of the one for the same sounds, 0 dB takes it away. The others
/// keep their order.
std::vector<Gain> changed(std::vector<Gain> gains, std::span<const Gain> changes);

}  // namespace rustle::synthesis
