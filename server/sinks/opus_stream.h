#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <vector>

struct OpusEncoder;

namespace rustle::sinks {

/// A stretch of sound as one Opus packet.
struct OpusPacket {
  std::int64_t first_sample = 0;   ///< of the stream; where what is kept of the decoded packet begins
  std::uint32_t skip_samples = 0;  ///< the decoder's run-in: to be dropped from the decoded packet's beginning
  std::uint32_t samples = 0;       ///< to be kept after that, per channel; what is left over is padding
  std::vector<std::uint8_t> bytes;
};

/// Samples into packets of 20 ms that decode to the same samples in the same places: the codec's delay is skipped in the
/// first packet and made up for with silence after the last sample. Constrained to low delay: no speech model, 2.5 ms of
/// lookahead; 64 kbit/s a channel. A decoder that joins later, or missed a packet, is itself again within 60 ms. One thread
/// at a time.
class OpusStream {
 public:
  /// Rates that Opus has: 8, 12, 16, 24 and 48 kHz.
  static bool has_rate(std::uint32_t rate_hz);

  /// `first_sample`: of the stream, where what is added first lies. \pre has_rate(rate_hz), 1 or 2 channels
  OpusStream(std::uint32_t rate_hz, int channels, std::int64_t first_sample);

  /// Takes samples in. \pre interleaved.size() is a multiple of the channels
  void add(std::span<const float> interleaved);
  /// The next packet that is whole; with `all` what is left too. Absent: more samples are needed, or nothing is left.
  std::optional<OpusPacket> next(bool all);

 private:
  struct Destroy {
    void operator()(OpusEncoder* encoder) const;
  };

  std::unique_ptr<OpusEncoder, Destroy> encoder_;
  std::size_t channels_, frame_;  ///< samples of a packet, per channel
  std::vector<float> waiting_;
  std::int64_t next_sample_;  ///< of the stream: first one that no packet has given
  std::uint64_t added_ = 0;   ///< samples per channel
  std::uint64_t given_ = 0;   ///< that packets decode to and that are kept
  std::uint32_t skip_;        ///< left of the run-in
};

}  // namespace rustle::sinks
