#pragma once

#include <span>
#include <string>

#include "server/report/canvas.h"
#include "sound_db/pack/calibration.h"
#include "sound_db/pack/sound_pack.h"

/// Pictures of a sound pack of cloth.
namespace rustle::apps {

inline constexpr double kClothPictureWidth = 1500;
inline constexpr double kClothPictureHeight = 1290;

/// A sweep through the measured speeds as in An et al. 2012, Fig. 3, the spectra and levels behind it, some seconds of the
/// corpus, where its units lie in feature space, and the energies of crumpling. Pure drawing.
/// \pre pack.cloth
void draw_cloth_pack(report::Canvas& canvas, const pack::SoundPack& pack);

/// The same as one HTML page that needs nothing else, with a table of the pack's recordings and crumpling units.
std::string cloth_pack_page(const pack::SoundPack& pack);

inline constexpr double kWarpPictureWidth = 1500;
inline constexpr double kWarpPictureHeight = 760;

/// Target units (magenta) and the corpus' (green) in feature space before and after the warp, with the mean of each
/// correspondence (An et al. 2012, Fig. 11). Pure drawing.
void draw_warp(report::Canvas& canvas, const pack::SoundPack& pack, const pack::TargetFeatures& target,
               std::span<const pack::Correspondence> correspondences);

}  // namespace rustle::apps
