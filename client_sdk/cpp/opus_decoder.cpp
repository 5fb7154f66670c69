#include "client_sdk/cpp/opus_decoder.h"

#include <opus.h>

namespace rustle::client::internal {
namespace {

constexpr double kLongestPacket_s = 0.12;

}  // namespace

void OpusTrack::Destroy::operator()(OpusDecoder* decoder) const {
  opus_decoder_destroy(decoder);
}

OpusTrack::OpusTrack(std::uint32_t rate_hz, std::uint32_t channels) : rate_hz_(rate_hz), channels_(channels) {
  if (channels < 1 || channels > 2) return;
  int problem = OPUS_OK;
  decoder_.reset(opus_decoder_create(static_cast<opus_int32>(rate_hz), static_cast<int>(channels), &problem));
}

bool OpusTrack::decode(const OpusPacket& packet, std::vector<float>& out) {
  if (!decoder_ || packet.bytes.empty()) return false;
  const auto most = static_cast<int>(kLongestPacket_s * rate_hz_);
  out.resize(static_cast<std::size_t>(most) * channels_);
  const auto* bytes = reinterpret_cast<const unsigned char*>(packet.bytes.data());
  const int decoded =
      opus_decode_float(decoder_.get(), bytes, static_cast<opus_int32>(packet.bytes.size()), out.data(), most, 0);
  if (decoded < 0 || std::uint64_t{packet.skip} + packet.samples > static_cast<std::uint64_t>(decoded)) return false;
  out.resize(static_cast<std::size_t>(packet.skip + packet.samples) * channels_);
  out.erase(out.begin(), out.begin() + static_cast<std::ptrdiff_t>(packet.skip) * channels_);
  return true;
}

bool OpusTracks::decode(std::uint64_t emitter, std::uint32_t rate_hz, std::uint32_t channels, const OpusPacket& packet,
                        std::vector<float>& out) {
  auto known = tracks_.find(emitter);
  const auto goes_on = [&](const OpusTrack& track) {
    return packet.skip == 0 && track.rate_hz() == rate_hz && track.channels() == channels;
  };
  if (known != tracks_.end() && !goes_on(known->second)) {
    tracks_.erase(known);
    known = tracks_.end();
  }
  if (known == tracks_.end()) known = tracks_.try_emplace(emitter, rate_hz, channels).first;
  return known->second.decode(packet, out);
}

}  // namespace rustle::client::internal
