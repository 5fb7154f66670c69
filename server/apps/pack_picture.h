#pragma once

#include <string>

#include "server/report/canvas.h"
#include "sound_db/pack/sound_pack.h"

/// Pictures of a sound pack: the waveforms of its units and its friction spectra over the grid, centroids and levels as
/// maps.
namespace rustle::apps {

inline constexpr double kPackPictureWidth = 1500;
inline constexpr double kPackPictureHeight = 1290;

/// All of it, on a canvas of kPackPictureWidth x kPackPictureHeight. Pure drawing.
void draw_pack(report::Canvas& canvas, const pack::SoundPack& pack);

/// One HTML page that needs nothing else: the picture as inline SVG, and a table of the pack's sounds. Light or dark as the
/// reader's machine prefers. Same pack, same bytes. Pure.
std::string pack_page(const pack::SoundPack& pack);

}  // namespace rustle::apps
