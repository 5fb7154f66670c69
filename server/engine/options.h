#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "server/spatial/hrtf.h"
#include "server/spatial/receivers.h"
#include "server/synthesis/cloth/prepared_corpus.h"
#include "server/synthesis/gain.h"

namespace rustle::engine {

enum class Mode { kCorrected, kPublished };
enum class Layout { kMono, kStereo, kBinaural };

constexpr int channels_of(Layout layout) {
  return layout == Layout::kMono ? 1 : 2;
}

constexpr spatial::Layout spatial_layout(Layout layout) {
  if (layout == Layout::kMono) return spatial::Layout::kMono;
  return layout == Layout::kBinaural ? spatial::Layout::kBinaural : spatial::Layout::kStereo;
}

/// What a session's sound depends on besides its stream.
struct Options {
  std::uint64_t seed = 0;
  Mode mode = Mode::kCorrected;
  Layout layout = Layout::kStereo;
  std::shared_ptr<const spatial::Hrtf> hrtf;  ///< for the binaural layout, at rate_hz
  int rate_hz = 48000;
  int friction_fft_size = 0;  ///< a power of two, 128 to 8192; 0: the default
  int max_voices = 512;       ///< that sound at a time, 1 to 512
  double time_origin_s = 0;   ///< simulation time of sample 0
  /// How far rendering stays behind the newest frame: an event is dated before the frame that confirms it, and what
  /// joins it follows within 50 ms (P2), so a sound can still start at its own sample and at its full level.
  double look_ahead_s = 0.05;
  double gain_db = 0;
  std::vector<synthesis::Gain> gains;  ///< in force always
  std::string default_material = "printer-paper";
  std::string default_surface = "wooden-table";
  std::optional<std::string> every_material;  ///< plays every sheet with this material, whatever it says
  std::optional<bool> fine_events;            ///< below what the mesh shows (P13); absent: of paper, not of cloth
  int max_sheets = 64;
  cloth::Search cloth_search = cloth::Search::kCausal;  ///< how cloth finds its units; others than causal ones offline
  bool stems = false;                                   ///< keep every bus beside the mix
  bool emitters = false;                                ///< and every emitter, in an offline render
};

}  // namespace rustle::engine
