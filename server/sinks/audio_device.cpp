#include "server/sinks/audio_device.h"

#include <RtAudio.h>
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cstdlib>
#include <filesystem>
#include <thread>

#include "server/session/spsc_ring.h"

namespace rustle::sinks {
namespace {

struct Api {
  AudioApi api;
  RtAudio::Api rtaudio;
  const char* name;
};
constexpr std::array kApis{Api{AudioApi::kPulse, RtAudio::LINUX_PULSE, "pulse"},
                           Api{AudioApi::kJack, RtAudio::UNIX_JACK, "jack"},
                           Api{AudioApi::kAlsa, RtAudio::LINUX_ALSA, "alsa"}};

/// Asking an API that has nothing behind it makes its library complain on standard error.
bool worth_asking(AudioApi api) {
  return api != AudioApi::kAlsa || std::filesystem::exists("/proc/asound/card0");
}

bool contains(const std::string& text, const std::string& part) {
  const auto same = [](char a, char b) {
    return std::tolower(static_cast<unsigned char>(a)) == std::tolower(static_cast<unsigned char>(b));
  };
  return std::search(text.begin(), text.end(), part.begin(), part.end(), same) != text.end();
}

struct Found {
  unsigned id;
  RtAudio::DeviceInfo info;
};

std::vector<Found> outputs_of(RtAudio& audio) {
  std::vector<Found> found;
  const unsigned count = audio.getDeviceCount();
  for (unsigned id = 0; id < count; ++id) {
    auto info = audio.getDeviceInfo(id);
    if (info.probed && info.outputChannels > 0) found.push_back({id, std::move(info)});
  }
  return found;
}

const Found* choose(const std::vector<Found>& devices, const std::string& name) {
  const Found* chosen = nullptr;
  for (const Found& device : devices) {
    if (name.empty() ? device.info.isDefaultOutput || chosen == nullptr : contains(device.info.name, name)) {
      if (chosen == nullptr || device.info.isDefaultOutput || device.info.name == name) chosen = &device;
    }
  }
  return chosen;
}

std::uint32_t rate_of(const RtAudio::DeviceInfo& device, std::uint32_t wanted_hz) {
  const auto& rates = device.sampleRates;
  if (std::find(rates.begin(), rates.end(), wanted_hz) != rates.end()) return wanted_hz;
  return device.preferredSampleRate != 0 ? device.preferredSampleRate : rates.empty() ? wanted_hz : rates.back();
}

}  // namespace

std::optional<AudioApi> audio_api_of(const std::string& name) {
  if (name == "auto") return AudioApi::kAny;
  for (const Api& api : kApis) {
    if (name == api.name) return api.api;
  }
  return std::nullopt;
}

std::vector<DeviceInfo> output_devices(AudioApi wanted) {
  std::vector<DeviceInfo> out;
  for (const Api& api : kApis) {
    if ((wanted != AudioApi::kAny && wanted != api.api) || !worth_asking(api.api)) continue;
    try {
      RtAudio audio(api.rtaudio);
      audio.showWarnings(false);
      for (const Found& device : outputs_of(audio)) {
        out.push_back({api.name, device.info.name, static_cast<int>(device.info.outputChannels),
                       device.info.preferredSampleRate, device.info.isDefaultOutput});
      }
    } catch (const RtAudioError&) {  // the API has no server or no card
    }
  }
  return out;
}

/// What the callback sees; lives until the API has let go of it, whatever becomes of the device's owner.
struct AudioDevice::Stream {
  Stream(RtAudio::Api api, std::size_t ring_samples, int channel_count)
      : audio(api), ring(ring_samples), channels(static_cast<std::size_t>(channel_count)) {
    audio.showWarnings(false);
  }

  static int play(void* out, void*, unsigned frames, double, RtAudioStreamStatus, void* self) noexcept {
    auto& stream = *static_cast<Stream*>(self);
    const std::span<float> samples(static_cast<float*>(out), frames * stream.channels);
    const std::size_t there = std::min(samples.size(), stream.ring.available());
    stream.ring.pop(samples.first(there));
    std::fill(samples.begin() + static_cast<std::ptrdiff_t>(there), samples.end(), 0.0f);
    if (stream.written.load(std::memory_order_relaxed))
      stream.missed.fetch_add((samples.size() - there) / stream.channels, std::memory_order_relaxed);
    stream.called.fetch_add(frames, std::memory_order_relaxed);
    return 0;
  }

  RtAudio audio;
  session::SampleRing ring;
  std::size_t channels;
  std::atomic<bool> written{false};
  std::atomic<std::uint64_t> called{0};
  std::atomic<std::uint64_t> missed{0};
};

tl::expected<std::unique_ptr<AudioDevice>, std::string> AudioDevice::open(const DeviceRequest& request) {
  // Without it PulseAudio buffers two seconds; what the user has set stands.
  ::setenv("PULSE_LATENCY_MSEC", "40", 0);
  std::string tried;
  for (const Api& api : kApis) {
    if ((request.api != AudioApi::kAny && request.api != api.api) || !worth_asking(api.api)) continue;
    tried += fmt::format("{}{}", tried.empty() ? "" : ", ", api.name);
    try {
      RtAudio probe(api.rtaudio);
      probe.showWarnings(false);
      const auto devices = outputs_of(probe);
      const Found* chosen = choose(devices, request.name);
      if (chosen == nullptr) continue;
      std::unique_ptr<AudioDevice> device(new AudioDevice);
      device->name_ = chosen->info.name;
      device->rate_hz_ = rate_of(chosen->info, request.rate_hz);
      device->channels_ = std::min(request.channels, static_cast<int>(chosen->info.outputChannels));
      device->block_frames_ = request.block_frames;
      const auto ring =
          static_cast<std::size_t>(request.ring_s * device->rate_hz_) * static_cast<std::size_t>(device->channels_);
      device->stream_ = std::make_shared<Stream>(api.rtaudio, ring, device->channels_);
      RtAudio::StreamParameters output;
      output.deviceId = chosen->id;
      output.nChannels = static_cast<unsigned>(device->channels_);
      RtAudio::StreamOptions options;
      options.streamName = "rustled";
      RtAudio& audio = device->stream_->audio;
      audio.openStream(&output, nullptr, RTAUDIO_FLOAT32, device->rate_hz_, &device->block_frames_, &Stream::play,
                       device->stream_.get(), &options);
      device->rate_hz_ = audio.getStreamSampleRate();
      audio.startStream();
      return device;
    } catch (const RtAudioError&) {  // the API has no server, or the device is taken: the next one
    }
  }
  return tl::unexpected(request.name.empty()
                            ? fmt::format("no audio device answers (tried {}); start a sound server, or say --device none",
                                          tried.empty() ? "none: no card is there" : tried)
                            : fmt::format("no audio device is called \"{}\" (tried {}); `rustled --list-devices` lists them",
                                          request.name, tried.empty() ? "none: no card is there" : tried));
}

AudioDevice::~AudioDevice() {
  if (!stream_) return;
  std::thread([stream = std::move(stream_)] {
    try {
      if (stream->audio.isStreamRunning()) stream->audio.abortStream();
    } catch (const RtAudioError&) {  // the server is gone
    }
    try {
      if (stream->audio.isStreamOpen()) stream->audio.closeStream();
    } catch (const RtAudioError&) {
    }
  }).detach();
}

std::size_t AudioDevice::waiting_frames() const {
  return stream_->ring.available() / stream_->channels;
}

void AudioDevice::write(std::span<const float> interleaved) {
  const std::size_t room = stream_->ring.room() / stream_->channels * stream_->channels;
  stream_->ring.push(interleaved.first(std::min(room, interleaved.size())));
  stream_->written.store(true, std::memory_order_relaxed);
}

std::uint64_t AudioDevice::frames_called() const {
  return stream_->called.load(std::memory_order_relaxed);
}

std::uint64_t AudioDevice::frames_missed() const {
  return stream_->missed.load(std::memory_order_relaxed);
}

}  // namespace rustle::sinks
