#pragma once

#include <filesystem>
#include <memory>

#include "sound_db/pack/cloth_manifest.h"
#include "sound_db/pack/load.h"
#include "sound_db/pack/pack_error.h"

namespace rustle::pack {

/// Reads the files that the section names, at a rate. At the stored rate features are those stored; at another one
/// recordings are resampled and measured anew. Crumpling units are sorted by energy. What is wrong goes to `findings`, with
/// the file and the remedy; the result is whole only where none of them is an error. On as many threads as there are cores;
/// control side.
std::shared_ptr<const ClothCorpus> load_cloth(const std::filesystem::path& folder, ClothManifest manifest,
                                              const LoadOptions& options, Findings& findings);

}  // namespace rustle::pack
