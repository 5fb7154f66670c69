#pragma once

#include <filesystem>

#include "sound_db/pack/pack_error.h"

namespace rustle::pack {

/// Everything that `rustle pack check` says of a folder. Errors: it does not load. Warnings: it loads, but something will
/// not sound as meant: no clac or no flat spectrum, fewer than two variants, clipping, an offset, a click at the start or
/// the end, silence, an unusual length, the same entry twice, files that nothing names, reference levels off by more than 3
/// dB, fields that are not known. Control side.
Findings check(const std::filesystem::path& folder);

}  // namespace rustle::pack
