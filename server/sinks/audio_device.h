#pragma once

#include <atomic>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <tl/expected.hpp>

namespace rustle::sinks {

/// How this machine's devices are spoken to.
enum class AudioApi { kAny, kPulse, kJack, kAlsa };
/// "auto", "pulse", "jack", "alsa".
std::optional<AudioApi> audio_api_of(const std::string& name);

struct DeviceInfo {
  std::string api;
  std::string name;
  int channels = 0;
  std::uint32_t preferred_rate_hz = 0;
  bool is_default = false;
};

/// The output devices of an API, or of all that answer. Talks to sound servers: may take a second. [control]
std::vector<DeviceInfo> output_devices(AudioApi api);

struct DeviceRequest {
  AudioApi api = AudioApi::kAny;
  std::string name;               ///< all of a device's name or a part of it; empty: the default device
  std::uint32_t rate_hz = 48000;  ///< taken where the device can, else the device's own
  int channels = 2;               ///< at most
  std::uint32_t block_frames = 256;
  double ring_s = 0.1;  ///< how much sound may wait for the device
};

/// A sound card or a sound server, open and playing what is written; silence where nothing is.
///
///   write ─► ring ─► the API's callback, which copies and counts and does nothing else
///
/// RtAudio beneath. A device that vanishes says nothing: its callback stops, or spins, and frames_called() tells.
class AudioDevice {
 public:
  /// Error: a sentence with the device and what to do. Talks to sound servers: may take a second. [control]
  [[nodiscard]] static tl::expected<std::unique_ptr<AudioDevice>, std::string> open(const DeviceRequest& request);
  /// Returns at once; the API's own end, which may hang on a server that is gone, is waited for by a thread of its own.
  ~AudioDevice();
  AudioDevice(const AudioDevice&) = delete;
  AudioDevice& operator=(const AudioDevice&) = delete;

  const std::string& name() const { return name_; }
  std::uint32_t rate_hz() const { return rate_hz_; }
  int channels() const { return channels_; }
  std::uint32_t block_frames() const { return block_frames_; }

  /// Frames that wait to be played. [player]
  std::size_t waiting_frames() const;
  /// Appends whole frames, as many as there is room for. [player]
  void write(std::span<const float> interleaved);
  /// Frames that the API has asked for.
  std::uint64_t frames_called() const;
  /// Frames of silence that it got because none waited, since the first write.
  std::uint64_t frames_missed() const;

 private:
  struct Stream;
  AudioDevice() = default;

  std::shared_ptr<Stream> stream_;
  std::string name_;
  std::uint32_t rate_hz_ = 0;
  int channels_ = 0;
  std::uint32_t block_frames_ = 0;
};

}  // namespace rustle::sinks
