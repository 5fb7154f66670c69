#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <mutex>
#include <span>
#include <vector>

#include "server/synthesis/limiter.h"

namespace rustle::sinks {

inline constexpr double kCushion_s = 0.03;        ///< of a source's sound that waits before it is heard
inline constexpr double kMostWaiting_s = 0.5;     ///< beyond it the oldest goes
inline constexpr double kSteering_s = 0.01;       ///< how far the waiting sound may stray from where it began ...
inline constexpr double kSplice_s = 0.01;         ///< ... before reading moves back by a cross-fade of this length
inline constexpr double kFillAverage_s = 1.0;     ///< over which the waiting sound is judged
inline constexpr double kPlaybackFade_s = 0.005;  ///< in and out of a source

struct MixFigures {
  std::uint64_t samples_in_gaps = 0;   ///< of silence where a source had nothing
  std::uint64_t samples_left_out = 0;  ///< that came in excess
  std::uint64_t splices = 0;           ///< by which a source was kept in step with the device
};

/// Several sources, each at a rate and with channels of its own, in one stream for a device.
///
///   push ─► what waits (session's rate) ─► splice ─► resample ─► channels ─┐
///                                                               others ─► Σ ─► limiter ─► device
///
/// Sources are paced by another clock than the device. Instead of resampling everything for ever, a source is read straight,
/// bit for bit where the rates are equal, until its waiting sound, averaged over a second, has strayed by 10 ms; then
/// reading moves back to where it began by one cross-fade. A source that runs dry fades out, and in again once it has a
/// cushion.
class PlaybackMix {
 public:
  using SourceId = std::uint64_t;

  /// \pre rate_hz > 0, channels ≥ 1
  PlaybackMix(std::uint32_t rate_hz, int channels);
  ~PlaybackMix();

  /// A device of another rate or other channels takes over; what waits goes on. [player]
  void turn_to(std::uint32_t rate_hz, int channels);
  /// No device plays: what waits goes, and what comes is passed over, until one takes over. [player]
  void rest();

  /// [control]
  SourceId add(std::uint32_t rate_hz, int channels);
  /// Appends interleaved samples. An unknown source is ignored. [control]
  void push(SourceId source, std::span<const float> interleaved);
  /// No more will come; what waits is still heard. [control]
  void end(SourceId source);
  bool empty() const;
  MixFigures figures() const;

  /// The next frames for the device, interleaved, within ±1. [player] \pre out.size() is a multiple of the channels
  void mix(std::span<float> out);

 private:
  struct Source;

  mutable std::mutex mutex_;
  std::uint32_t rate_hz_;
  int channels_;
  bool resting_ = false;
  std::map<SourceId, std::unique_ptr<Source>> sources_;
  SourceId next_id_ = 1;
  MixFigures figures_;
  std::vector<float> read_;
  std::vector<std::vector<float>> sum_;
  synthesis::Limiter limiter_;
};

}  // namespace rustle::sinks
