#pragma once

#include <optional>

#include "sound_db/build/build.h"

namespace rustle::build {

/// Makes a pack of cloth of the recordings that a manifest with a [cloth] table names below `folder` (C10):
///   cloth    the corpus: every channel a source of its own, or two at once (binaural); cut at its pauses, measured
///            (pack/cloth_corpus.h)
///   slide    the friction sweep: clips of 50 ms at the speeds of the speed track, averaged in power (SweepMeasure)
///   crumple  crumpling units: runs whose energy in a window of 20 ms exceeds the threshold, extended to zero crossings
///            (An et al. 2012, section 3); without a threshold the one of those 6 to 40 dB below the loudest window that
///            yields most
/// and a warp fitted to proposed correspondences with a plain target, for `rustle pack calibrate` to replace. All levels
/// stay relative to each other. Errors go to `findings`: a file that cannot be read, a slide whose speed track cannot, no
/// cloth or no slide that can be used. The same files give the same bits. Control side; reads one file at a time.
/// \pre manifest.cloth
std::optional<BuiltPack> build_cloth_pack(const BuildManifest& manifest, const std::filesystem::path& folder,
                                          pack::Findings& findings, const Progress& progress = {});

}  // namespace rustle::build
