#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <string_view>
#include <vector>

struct OpusDecoder;

namespace rustle::client::internal {

/// Of what it decodes to, the first `skip` samples are dropped and the next `samples` kept.
struct OpusPacket {
  std::string_view bytes;
  std::uint32_t skip = 0, samples = 0;
};

/// One stream's Opus packets into samples, in their order. Not for applications. One thread at a time.
class OpusTrack {
 public:
  std::uint32_t rate_hz() const { return rate_hz_; }
  std::uint32_t channels() const { return channels_; }

  /// Of a rate and a number of channels that Opus has not, nothing is decoded.
  OpusTrack(std::uint32_t rate_hz, std::uint32_t channels);

  /// What is to be kept of a packet, interleaved. False where the bytes are no packet, or a shorter one.
  bool decode(const OpusPacket& packet, std::vector<float>& out);

 private:
  struct Destroy {
    void operator()(OpusDecoder* decoder) const;
  };

  std::uint32_t rate_hz_, channels_;
  std::unique_ptr<OpusDecoder, Destroy> decoder_;
};

/// Sounds that go on from message to message, by emitter; of the mix and of a stem there is one, by 0. A packet of which
/// something is dropped begins a sound.
class OpusTracks {
 public:
  bool decode(std::uint64_t emitter, std::uint32_t rate_hz, std::uint32_t channels, const OpusPacket& packet,
              std::vector<float>& out);
  void end(std::uint64_t emitter) { tracks_.erase(emitter); }

 private:
  std::map<std::uint64_t, OpusTrack> tracks_;
};

}  // namespace rustle::client::internal
