#include "server/sinks/opus_stream.h"

#include <opus.h>

#include <algorithm>
#include <new>

namespace rustle::sinks {
namespace {

constexpr int kBitsPerSecond = 64000;  // a channel
constexpr int kComplexity = 5;
constexpr std::size_t kMostPacketBytes = 4000;
constexpr std::uint32_t kPackets_per_s = 50;

}  // namespace

void OpusStream::Destroy::operator()(OpusEncoder* encoder) const {
  opus_encoder_destroy(encoder);
}

bool OpusStream::has_rate(std::uint32_t rate_hz) {
  constexpr std::uint32_t kRates[] = {8000, 12000, 16000, 24000, 48000};
  return std::ranges::find(kRates, rate_hz) != std::end(kRates);
}

OpusStream::OpusStream(std::uint32_t rate_hz, int channels, std::int64_t first_sample)
    : channels_(static_cast<std::size_t>(channels)), frame_(rate_hz / kPackets_per_s), next_sample_(first_sample) {
  int problem = OPUS_OK;
  encoder_.reset(
      opus_encoder_create(static_cast<opus_int32>(rate_hz), channels, OPUS_APPLICATION_RESTRICTED_LOWDELAY, &problem));
  if (!encoder_) throw std::bad_alloc();  // all else is a precondition
  opus_encoder_ctl(encoder_.get(), OPUS_SET_BITRATE(kBitsPerSecond * channels));
  opus_encoder_ctl(encoder_.get(), OPUS_SET_COMPLEXITY(kComplexity));
  opus_int32 lookahead = 0;
  opus_encoder_ctl(encoder_.get(), OPUS_GET_LOOKAHEAD(&lookahead));
  skip_ = static_cast<std::uint32_t>(lookahead);
}

void OpusStream::add(std::span<const float> interleaved) {
  waiting_.insert(waiting_.end(), interleaved.begin(), interleaved.end());
  added_ += interleaved.size() / channels_;
}

std::optional<OpusPacket> OpusStream::next(bool all) {
  const std::size_t whole = frame_ * channels_;
  if (waiting_.size() < whole) {
    if (!all || given_ == added_) return std::nullopt;
    waiting_.resize(whole, 0.0f);
  }
  OpusPacket packet;
  packet.bytes.resize(kMostPacketBytes);
  const auto written = opus_encode_float(encoder_.get(), waiting_.data(), static_cast<int>(frame_), packet.bytes.data(),
                                         static_cast<opus_int32>(packet.bytes.size()));
  packet.bytes.resize(static_cast<std::size_t>(std::max<opus_int32>(written, 0)));
  waiting_.erase(waiting_.begin(), waiting_.begin() + static_cast<std::ptrdiff_t>(whole));
  packet.first_sample = next_sample_;
  packet.skip_samples = std::min(skip_, static_cast<std::uint32_t>(frame_));
  packet.samples = static_cast<std::uint32_t>(std::min<std::uint64_t>(frame_ - packet.skip_samples, added_ - given_));
  skip_ -= packet.skip_samples;
  given_ += packet.samples;
  next_sample_ += packet.samples;
  return packet;
}

}  // namespace rustle::sinks
