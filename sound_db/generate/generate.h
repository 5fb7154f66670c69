#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <string_view>
#include <vector>

#include <tl/expected.hpp>

#include "sound_db/generate/paper.h"
#include "sound_db/pack/pack_error.h"
#include "sound_db/pack/sound_pack.h"

/// The default packs: no recordings, computed from a model of bent paper, the same bits in every run.
namespace rustle::generate {

/// l_r x l_c/2 over {2.5, 5, 7.5, 10, 12.5, 15, 20, 25, 30} cm (P6).
std::vector<pack::GridPoint> full_grid();

struct Options {
  std::vector<pack::GridPoint> grid = full_grid();  ///< unconstrained points; (0,0) is always made
  int flaps = 3;                                    ///< variants of a grid point
  int clacs = 8;
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

/// make_pack to a folder. Errors: a material that is not known, a folder that cannot be written.
[[nodiscard]] tl::expected<void, pack::PackError> write_pack(std::string_view material, const std::filesystem::path& folder,
                                                             const Progress& progress = {});

}  // namespace rustle::generate
