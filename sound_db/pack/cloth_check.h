#pragma once

#include <filesystem>

#include "sound_db/pack/cloth_manifest.h"
#include "sound_db/pack/pack_error.h"

namespace rustle::pack {

/// What will not sound as meant of a corpus that was loaded at its stored rate: features that are not the recordings' (they
/// were replaced), rumble, pauses, clipping, friction that grows quieter with speed, few or equally loud crumpling units,
/// no calibration, no warp, entries named twice. Warnings go to `findings`.
void check_cloth(const ClothCorpus& corpus, const ClothManifest& manifest, const std::filesystem::path& folder,
                 Findings& findings);

}  // namespace rustle::pack
