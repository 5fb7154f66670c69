#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <string>
#include <string_view>
#include <vector>

#include <tl/expected.hpp>

#include "sound_db/generate/paper.h"
#include "sound_db/pack/pack_error.h"
#include "sound_db/pack/sound_pack.h"

/// The default packs: no recordings, computed from a model of bent paper, the same bits in every run.
///
/// The centroid of each of printer paper's flaps, clacs, dense crumples and slides, and their median kurtosis, lie within
/// what recordings of real paper measure. What still separates them, ours beside the recordings' range:
///   flaps     fall by 30 dB in 90-520 ms (median 245), recorded page turns in 30-175: a sheet in two hands rings longer
///             than a page in its book. They rustle before the snap for 25 ms at most, a page for half a second: what
///             comes earlier is for events of the mesh's own motion.
///   clacs     are over after 4 ms (95 % of energy); 30 ms cut from a real crumpling hold 10-29 ms of sound, other clacs
///             and layers rubbing, which are left to the events around them.
///   crumples  of clacs and small flaps are flatter in spectrum (flatness 0.70-0.76, real 0.31-0.69); their centroid,
///             5.6-5.8 kHz, is that of wrappers, the sheet of paper's is 4.0: small flaps' tails fill the gaps.
///   slides    pushed from rest to rest have kurtosis 6-11, real ones 8-264: starting, stopping and catching, each with
///             its click, are events of their own and not in the spectrum.
///   materials tracing paper and banknote differ from printer paper by scalings from grammage, thickness, stiffness and
///             estimated damping (paper.h); no recordings of them were compared.
namespace rustle::generate {

/// l_r x l_c/2 over {2.5, 5, 7.5, 10, 12.5, 15, 20, 25, 30} cm (P6).
std::vector<pack::GridPoint> full_grid();

struct Options {
  std::vector<pack::GridPoint> grid = full_grid();  ///< unconstrained points; (0,0) is always made
  int flaps = 3;                                    ///< variants of a grid point
  int clacs = 16;
  std::uint32_t rate_hz = 48000;
  std::uint32_t fft_size = 1024;
  std::uint64_t seed = 1;
  unsigned threads = 0;  ///< 0: as many as there are cores; changes no bit
};

/// Called with the part done in [0, 1], from one thread at a time.
using Progress = std::function<void(double)>;

/// A pack of `paper` on a wooden table. Levels are set by the reference events (pack/levels.h), which are made for it when
/// the grid lacks them; all other sounds keep their level relative to them.
pack::SoundPack make_pack(const Paper& paper, const Options& options = {}, const Progress& progress = {});

/// Materials that write_pack knows: papers, then cloths.
std::vector<std::string> material_names();

/// make_pack or make_cloth_pack to a folder. Errors: a material that is not known, a folder that cannot be written.
[[nodiscard]] tl::expected<void, pack::PackError> write_pack(std::string_view material, const std::filesystem::path& folder,
                                                             const Progress& progress = {});

}  // namespace rustle::generate
