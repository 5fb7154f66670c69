#pragma once

#include <memory>
#include <optional>
#include <string>

#include "server/apps/command.h"
#include "sound_db/pack/cloth_corpus.h"
#include "sound_db/pack/sound_pack.h"

/// The subcommands of `rustle pack` that have files of their own.
namespace rustle::apps {

void add_pack_build(CLI::App& pack, Action& action);
void add_pack_calibrate(CLI::App& pack, Action& action);
void add_pack_change(CLI::App& pack, Action& action);
void add_pack_play(CLI::App& pack, Action& action);
void add_pack_reload(CLI::App& pack, Action& action);
void add_pack_show(CLI::App& pack, Action& action);

/// Why a pack must not be written to this folder: it holds something else than a pack, a pack with files of someone's among
/// it, or a pack and nobody said --force. Empty: it may.
std::string overwrite_refusal(const std::string& folder, bool force);

/// "(0, 0)" or "l_r 10 cm, l_c 20 cm".
std::string place_text(const pack::GridPoint& point);

/// A pack by its folder, or by its material among the packs that are found; at the rate it is stored at, within 8 to 192
/// kHz. Complains and returns null when there is none.
std::shared_ptr<const pack::SoundPack> load_pack_or_complain(const std::string& folder_or_material,
                                                             std::uint32_t rate_hz = 0);

/// What of a pack of cloth `rustle pack play` renders.
struct ClothTour {
  std::string output;
  std::string kind;                     ///< friction, crumpling or corpus; empty: all
  std::optional<double> speed_m_per_s;  ///< of slides; absent: five over the measured range
  double seconds = 1.5;                 ///< of a slide
  bool json = false;
};

/// Writes friction at several speeds, crumpling units from soft to loud and some of the corpus to a WAV file, and prints
/// what is where. \pre pack.cloth
int play_cloth(const pack::SoundPack& pack, const ClothTour& arguments);

}  // namespace rustle::apps
