#pragma once

#include <string>
#include <vector>

#include "sound_db/pack/cloth_corpus.h"

/// The "cloth" section of pack.json:
///
///   {"version": 1, "units_per_s": 240, "channels", "gain_db", "wale_spacing_m",
///    "recordings": [{"file"}],
///    "features": {"widths": [3 numbers], "causal": FILE, "symmetric": FILE},         .npy [units][3 channels]
///    "selection": {"look_ahead", "d_max", "cool_off"},
///    "warp": {"lambda", "causal": {"centre": [], "scale", "affine": [], "file"}, "symmetric": {...}},
///    "friction": {"file", "fft_size", "speeds_m_per_s": [], "gain_db", "patch_area_m2", "speed_threshold_m_per_s",
///                 "speed_compression": {"divisor", "exponent"}},
///    "crumpling": {"gain_db", "units": [{"file"}], "events": {"least_m", "most_m", "counts": []}}}
///
/// A warp's file is .npy, float64, [nodes][2 dims]: the node, then its weights; without it the warp is affine, without
/// "affine" the identity. "crumpling", its "events", "warp" or one of its two may be left out.
namespace rustle::pack {

struct ClothManifest {
  ClothCorpus corpus;  ///< without samples, values, nodes and magnitudes
  double friction_gain_db = 0;
  double crumpling_gain_db = 0;
};

/// Every file that the section names, as it names them.
std::vector<std::string> named_files(const ClothManifest& manifest);

}  // namespace rustle::pack
