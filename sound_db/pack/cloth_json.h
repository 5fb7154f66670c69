#pragma once

#include <cstdint>

#include "sound_db/pack/cloth_manifest.h"
#include "sound_db/pack/json_reader.h"

/// The "cloth" section from and to JSON; cloth_manifest.h lays it out.
namespace rustle::pack {

/// \pre section is the "cloth" object of a version this program reads
ClothManifest read_cloth_manifest(Reader& section, std::uint32_t stored_rate_hz);

Json cloth_json(const ClothManifest& manifest);

}  // namespace rustle::pack
