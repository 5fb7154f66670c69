#pragma once

#include <cstdint>

#include "sound_db/generate/cloth_material.h"
#include "sound_db/generate/generate.h"
#include "sound_db/pack/sound_pack.h"

/// The default packs of cloth (C8): no recordings, computed, the same bits in every run.
///
/// Each holds two minutes of varied motion without its pauses, spectra of a roller sweep from 2 to 0.03 m/s at 14 speeds,
/// 160 crumpling units whose energies are a power law, and a warp fitted to proposed correspondences between a plain target
/// of another motion and the corpus. The corpus differs from the target as a recording does: irregular grain, bands that
/// move, pops in clusters; the zip of corduroy. Friction and crumpling keep in the target the levels that they have in the
/// corpus.
namespace rustle::generate {

struct ClothOptions {
  double corpus_s = 150;  ///< of motion; two minutes are left without its pauses
  double sweep_s = 36;
  int speeds = 14;
  int pops = 160;  ///< crumpling units
  std::uint32_t rate_hz = 48000;
  std::uint64_t seed = 1;
};

/// Sliding speeds that the sweep is measured at.
inline constexpr double kSlowestCloth_m_per_s = 0.05, kFastestCloth_m_per_s = 1.8;

/// The cloth that slides to give the level of `level` (ClothMaterial): what a garment touches the body with.
inline constexpr double kClothPatch_m2 = 0.05;

pack::SoundPack make_cloth_pack(const ClothMaterial& material, const ClothOptions& options = {},
                                const Progress& progress = {});

}  // namespace rustle::generate
