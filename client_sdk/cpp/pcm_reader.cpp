#include "client_sdk/cpp/pcm_reader.h"

#include <algorithm>
#include <bit>
#include <cstring>
#include <utility>

#include "client_sdk/cpp/transport.h"

static_assert(std::endian::native == std::endian::little, "samples are copied as they come: little-endian");

namespace rustle::client {
namespace {

std::string topic_of(const std::string& session_id, const ListenOptions& options) {
  std::string topic = session_id + "/pcm/";
  if (std::holds_alternative<MixContent>(options.content)) {
    topic += "mix";
  } else if (const auto* stem = std::get_if<StemContent>(&options.content)) {
    topic += "stem/" + std::to_string(stem->sheet_id) + "/" + std::string(internal::kind_name(stem->kind));
  } else {
    topic += "emitter";
  }
  return topic + (options.format == SampleFormat::kS16 ? "/s16/" : "/f32/") + std::to_string(options.blocks);
}

Vector3 from_wire(const v1::Vector3& v) {
  return {v.x(), v.y(), v.z()};
}

/// False for a format this version does not know, or data of the wrong size.
bool read_samples(const v1::Pcm& pcm, std::vector<float>& out) {
  const std::size_t count = std::size_t{pcm.samples()} * pcm.channels();
  const std::string& data = pcm.data();
  if (pcm.format() == v1::SAMPLE_FORMAT_F32 && data.size() == count * sizeof(float)) {
    out.resize(count);
    if (count > 0) std::memcpy(out.data(), data.data(), data.size());
    return true;
  }
  if (pcm.format() == v1::SAMPLE_FORMAT_S16 && data.size() == count * sizeof(std::int16_t)) {
    out.resize(count);
    for (std::size_t i = 0; i < count; ++i) {
      std::int16_t sample;
      std::memcpy(&sample, data.data() + i * sizeof(sample), sizeof(sample));
      out[i] = static_cast<float>(sample) / 32767.0f;
    }
    return true;
  }
  return false;
}

}  // namespace

struct PcmReader::Impl {
  internal::Subscription subscription;
  std::optional<std::int64_t> next_sample;
  std::uint64_t missing_samples = 0;
  std::uint64_t unreadable = 0;

  std::optional<PcmBlock> read(const std::string& body) {
    v1::OutMessage message;
    if (!message.ParseFromString(body)) {
      ++unreadable;
      return std::nullopt;
    }
    if (message.has_end()) {
      PcmBlock block;
      block.first_sample = message.end().samples();
      block.end = true;
      if (next_sample && block.first_sample > *next_sample)
        block.missing_samples = static_cast<std::uint64_t>(block.first_sample - *next_sample);
      missing_samples += block.missing_samples;
      return block;
    }
    PcmBlock block;
    const v1::Pcm& pcm = message.pcm();
    if (!message.has_pcm() || !read_samples(pcm, block.interleaved)) {
      ++unreadable;
      return std::nullopt;
    }
    block.first_sample = pcm.first_sample();
    block.rate_hz = pcm.rate_hz();
    block.channels = pcm.channels();
    block.samples = pcm.samples();
    block.missing_samples = pcm.missing_samples();
    block.time_s = pcm.time_s();
    if (pcm.has_emitter()) {
      const v1::Emitter& emitter = pcm.emitter();
      block.emitter = EmitterState{.emitter_id = emitter.emitter_id(),
                                   .sheet_id = emitter.sheet_id(),
                                   .kind = internal::kind_from_name(emitter.kind()),
                                   .position = from_wire(emitter.position()),
                                   .normal = from_wire(emitter.normal()),
                                   .last = emitter.last()};
    } else {
      if (next_sample && block.first_sample > *next_sample)
        block.missing_samples =
            std::max(block.missing_samples, static_cast<std::uint64_t>(block.first_sample - *next_sample));
      next_sample = block.first_sample + block.samples;
    }
    missing_samples += block.missing_samples;
    return block;
  }
};

PcmReader::PcmReader(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
PcmReader::PcmReader(PcmReader&&) noexcept = default;
PcmReader& PcmReader::operator=(PcmReader&&) noexcept = default;
PcmReader::~PcmReader() = default;

tl::expected<PcmReader, Error> PcmReader::listen(const Connection& connection, const std::string& session_id,
                                                 const ListenOptions& options) {
  if (options.blocks < 1 || options.blocks > 4)
    return tl::unexpected(internal::local_error("invalid", "A message holds 1 to 4 blocks.", "Ask for 1 to 4.", "blocks"));
  auto subscription =
      internal::Subscription::open(*connection.link(), topic_of(session_id, options), options.queue_messages.value_or(4096));
  if (!subscription) return tl::unexpected(std::move(subscription.error()));
  return PcmReader(std::make_unique<Impl>(
      Impl{.subscription = std::move(*subscription), .next_sample = {}, .missing_samples = 0, .unreadable = 0}));
}

std::optional<PcmBlock> PcmReader::next(std::chrono::milliseconds timeout) {
  const auto deadline = internal::Clock::now() + timeout;
  while (const auto body = impl_->subscription.next(deadline)) {
    if (auto block = impl_->read(*body)) return block;
  }
  return std::nullopt;
}

std::uint64_t PcmReader::missing_samples() const {
  return impl_->missing_samples;
}
std::uint64_t PcmReader::unreadable_messages() const {
  return impl_->unreadable;
}

}  // namespace rustle::client
