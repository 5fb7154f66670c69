#pragma once

#include <filesystem>

#include <tl/expected.hpp>

#include "sound_db/pack/pack_error.h"
#include "sound_db/pack/sound_pack.h"

namespace rustle::pack {

/// Writes a pack as a folder: each unit and spectrum to the file it names, pack.json last. 16-bit units are stored as loud
/// as fits and crumpling.gain_db takes it back. The folder appears whole or not at all: it is written beside and renamed; an
/// existing folder is replaced only if it is empty or a pack. The same pack gives the same bytes. Control side.
/// \pre units are within the pack's rate; pack.rate_hz is the rate of samples and magnitudes
[[nodiscard]] tl::expected<void, PackError> write(const SoundPack& pack, const std::filesystem::path& folder);

}  // namespace rustle::pack
