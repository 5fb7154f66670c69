#pragma once

#include <cstdint>
#include <optional>
#include <string>

namespace rustle::session {

enum class Clock : std::uint8_t {
  kLive,        ///< paced by the audio clock
  kSimulation,  ///< PCM follows simulation time; flow-controlled; nothing is dropped
};

enum class UpAxis : std::uint8_t { kZ, kY };

enum class SynthesisMode : std::uint8_t { kCorrected, kPublished };

enum class ChannelLayout : std::uint8_t { kMono, kStereo, kBinaural };

enum class ClothFeatures : std::uint8_t { kCausal, kSymmetric, kGlobal };

/// What a session is asked to be. `wire` has checked ranges; a 0 is settled by the daemon where it says so.
struct SessionOptions {
  Clock clock = Clock::kLive;
  double time_origin_s = 0;     ///< simulation time of the first sample, within ±1e10
  double metres_per_unit = 1;   ///< of the sender's lengths, 1e-6 to 1e6; what `wire` decodes is metres already
  UpAxis up_axis = UpAxis::kZ;  ///< of the sender; what `wire` decodes has z up already
  std::uint64_t seed = 0;
  SynthesisMode mode = SynthesisMode::kCorrected;
  /// 0 to 10; absent: adaptive on the live clock, where it stays absent, 50 ms behind the newest frame in a simulation.
  std::optional<double> playout_delay_s;
  std::uint32_t rate_hz = 0;     ///< 8,000 to 192,000; 0: the daemon's
  std::uint32_t block_size = 0;  ///< samples, 16 to 8,192; 0: the daemon's
  ChannelLayout channels = ChannelLayout::kStereo;
  ClothFeatures cloth_features = ClothFeatures::kCausal;
  std::string default_material = "printer-paper";  ///< for sheets that name none
  bool record = false;                             ///< the daemon stores the session as a capture
  std::string hrtf;                                ///< of binaural sound, by name; empty: the default
  std::uint32_t friction_fft_size = 0;             ///< a power of two, 128 to 8,192; 0: the default
  std::uint32_t most_voices = 0;                   ///< at a time, 1 to 512; 0: 512

  bool operator==(const SessionOptions&) const = default;
};

constexpr int channel_count(ChannelLayout layout) {
  return layout == ChannelLayout::kMono ? 1 : 2;
}

}  // namespace rustle::session
