#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>

#include <tl/expected.hpp>

#include "sound_db/pack/pack_error.h"
#include "sound_db/pack/sound_pack.h"

namespace rustle::pack {

struct LoadOptions {
  std::uint32_t rate_hz = 48000;  ///< 8000 to 192000
  std::uint32_t fft_size = 0;     ///< of the friction spectra; 0: as stored
  /// Cloth: features are measured anew instead of read, and warps are left at the identity. For who replaces both.
  bool measure_units = false;
};

/// Reads a pack's folder at a rate: units resampled, spectra interpolated (resampled_spectrum), the manifest's gains
/// applied. Units and spectra are sorted by (l_r, l_c); the result never changes. The same sound below 20 kHz at 44.1, 48
/// and 96 kHz. The first error that keeps the pack from being used. Reads on as many threads as there are cores; control
/// side.
[[nodiscard]] tl::expected<std::shared_ptr<const SoundPack>, PackError> load(const std::filesystem::path& folder,
                                                                             const LoadOptions& options);
[[nodiscard]] tl::expected<std::shared_ptr<const SoundPack>, PackError> load(const std::filesystem::path& folder,
                                                                             std::uint32_t rate_hz);

/// The same, collecting everything wrong instead of stopping at the first. Null when there is an error.
std::shared_ptr<const SoundPack> load_with_findings(const std::filesystem::path& folder, const LoadOptions& options,
                                                    Findings& findings);

}  // namespace rustle::pack
