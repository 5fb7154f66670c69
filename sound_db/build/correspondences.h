#pragma once

#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include <tl/expected.hpp>

#include "sound_db/pack/calibration.h"

/// Files of correspondences between a target and a corpus: CSV, one a line,
///
///   # target_s, database_s, length_s
///   1.25, 14.10, 0.1
///
/// t_k in the target, d_k in the corpus (its recordings' whole units one after another, in the manifest's order), Δ_k, all
/// in seconds (An et al. 2012, 4.3). Lines beginning with # and a first line of words are left alone; length_s may be left
/// out: 0.1.
namespace rustle::build {

/// Error: what is wrong, with the line.
[[nodiscard]] tl::expected<std::vector<pack::Correspondence>, std::string> read_correspondences(
    const std::filesystem::path& file);

/// The text of such a file.
std::string correspondences_text(std::span<const pack::Correspondence> correspondences);

}  // namespace rustle::build
