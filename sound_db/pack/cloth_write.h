#pragma once

#include <filesystem>

#include <tl/expected.hpp>

#include "sound_db/pack/cloth_manifest.h"
#include "sound_db/pack/pack_error.h"

namespace rustle::pack {

/// Writes a corpus' files below a folder, each to the name it has; returns what pack.json says of them. Recordings are
/// stored as they stand (features are of their samples), crumpling units as loud as fits. The same corpus gives the same
/// bytes. Control side.
[[nodiscard]] tl::expected<ClothManifest, PackError> write_cloth(const ClothCorpus& corpus,
                                                                 const std::filesystem::path& folder);

/// Replaces a pack's features, warps, speed compression and calibration by those of a corpus that was loaded from it at its
/// stored rate; all other files stay as they are, and so does everything else that pack.json says. pack.json is written
/// last. Control side.
[[nodiscard]] tl::expected<void, PackError> write_calibration(const ClothCorpus& corpus,
                                                              const std::filesystem::path& folder);

}  // namespace rustle::pack
