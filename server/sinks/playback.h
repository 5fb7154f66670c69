#pragma once

#include <condition_variable>
#include <cstdint>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <string>
#include <thread>

#include <tl/expected.hpp>

#include "server/sinks/audio_device.h"
#include "server/sinks/playback_mix.h"

namespace rustle::sinks {

struct PlaybackFigures {
  std::string device;  ///< empty: none, what is played goes nowhere
  std::uint32_t rate_hz = 0;
  std::uint64_t frames_played = 0;  ///< handed to devices
  std::uint64_t frames_missed = 0;  ///< of silence, because the player came late
  std::uint64_t devices_lost = 0;
  std::uint64_t devices_opened = 0;
  MixFigures mix;
};

/// Plays sources through a device for as long as there is one. A thread of its own keeps the device's ring filled:
///
///   sources ─► PlaybackMix ─► player thread ─► AudioDevice
///                                    └──────► nothing, while there is no device: what comes is passed over
///
/// A device counts as lost when its callback has not come for 150 ms, or comes at three times its rate, as PulseAudio's
/// does when its server is gone. Another one is then looked for twice a second, by a thread that may wait for servers.
class Playback {
 public:
  struct Options {
    DeviceRequest device;
    double lead_s = 0.03;  ///< of mixed sound that waits for the device: bridges this thread's late wake-ups
  };
  /// What the player tells of devices found and lost: one sentence. From the player's thread.
  using Tell = std::function<void(const std::string&)>;

  Playback(Options options, Tell tell);
  ~Playback();
  Playback(const Playback&) = delete;
  Playback& operator=(const Playback&) = delete;

  /// [control] As in PlaybackMix.
  PlaybackMix::SourceId add(std::uint32_t rate_hz, int channels) { return mix_.add(rate_hz, channels); }
  void push(PlaybackMix::SourceId source, std::span<const float> interleaved) { mix_.push(source, interleaved); }
  void end(PlaybackMix::SourceId source) { mix_.end(source); }
  PlaybackFigures figures() const;

 private:
  using Clock = std::chrono::steady_clock;

  void run_player();
  void run_finder();
  void feed_device();
  void feed_silence();
  std::size_t lead_frames() const;
  bool lost(Clock::time_point now);
  void take_found(Clock::time_point now);

  const Options options_;
  const Tell tell_;
  PlaybackMix mix_;

  // player thread
  std::unique_ptr<AudioDevice> device_;
  std::vector<float> block_;
  std::uint32_t rate_hz_;
  int channels_;
  bool playing_ = false;  // the device has settled
  std::uint64_t called_ = 0;
  Clock::time_point called_at_, window_began_, opened_at_;
  std::uint64_t window_called_ = 0;
  std::uint64_t missed_ = 0;  // by the device while it was well

  mutable std::mutex mutex_;
  std::condition_variable changed_;
  bool stopping_ = false;
  bool wanted_ = true;                  // the finder is to look for a device
  std::unique_ptr<AudioDevice> found_;  // by the finder, for the player
  PlaybackFigures figures_;

  std::thread finder_, player_;
};

}  // namespace rustle::sinks
