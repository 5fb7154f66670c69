#include "client_sdk/cpp/pcm_reader.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <map>
#include <utility>

#include "client_sdk/cpp/from_wire.h"
#include "client_sdk/cpp/opus_decoder.h"
#include "client_sdk/cpp/subscription.h"

static_assert(std::endian::native == std::endian::little, "samples are copied as they come: little-endian");

namespace rustle::client {
namespace {

constexpr int kLiveQueueMessages = 4096;
constexpr std::int64_t kForgotten_s = 10;  ///< an emitter that was not heard of for so long has ended unheard

std::string topic_of(const std::string& session_id, const ListenOptions& options) {
  std::string topic = session_id + "/pcm/";
  if (std::holds_alternative<MixContent>(options.content)) {
    topic += "mix";
  } else if (const auto* stem = std::get_if<StemContent>(&options.content)) {
    topic += "stem/" + std::to_string(stem->sheet_id) + "/" + std::string(internal::kind_name(stem->kind));
  } else {
    topic += "emitter";
  }
  // Packets are all of one length: whoever listens shares one stream of them.
  if (options.format == SampleFormat::kOpus) return topic + "/opus/4";
  return topic + (options.format == SampleFormat::kS16 ? "/s16/" : "/f32/") + std::to_string(options.blocks);
}

/// False for a format this version does not know, or data of the wrong size.
bool read_samples(const v1::Pcm& pcm, internal::OpusTracks& tracks, std::vector<float>& out) {
  if (pcm.format() == v1::SAMPLE_FORMAT_OPUS) {
    if (pcm.samples() == 0) return true;
    return tracks.decode(pcm.emitter().emitter_id(), pcm.rate_hz(), pcm.channels(),
                         {pcm.data(), pcm.skip_samples(), pcm.samples()}, out);
  }
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
  std::shared_ptr<internal::Subscription> subscription;
  bool simulation = false;
  std::optional<std::int64_t> next_sample{};
  double next_time_s = 0;
  std::uint64_t sequence = 0;                        ///< of the newest message
  std::map<std::uint64_t, std::int64_t> emitters{};  ///< by id: the sample that follows
  internal::Clock::time_point arrived{};             ///< that message
  bool ended = false;
  internal::OpusTracks tracks{};
  bool many = false;  ///< sounds of emitters, not one
  std::uint64_t missing_samples = 0;
  std::uint64_t missing_messages = 0;
  std::uint64_t unreadable = 0;

  /// What messages were lost before this one. True: another daemon sent it.
  bool follow(const v1::OutMessage& message) {
    const std::uint64_t number = message.sequence();
    const bool back = number > 0 && number <= sequence;
    if (sequence > 0 && number > sequence + 1) missing_messages += number - sequence - 1;
    sequence = number;
    return back;
  }

  /// Of the sounds of emitters each goes on by itself.
  void place_emitter(bool back, PcmBlock& block) {
    if (back) emitters.clear();
    block.restarted = back;
    std::erase_if(emitters, [&](const auto& entry) {
      const bool forgotten = entry.second + kForgotten_s * static_cast<std::int64_t>(block.rate_hz) < block.first_sample;
      if (forgotten && entry.first != block.emitter->emitter_id) tracks.end(entry.first);
      return forgotten;
    });
    const auto [known, fresh] = emitters.try_emplace(block.emitter->emitter_id, block.first_sample);
    if (block.first_sample > known->second)
      block.missing_samples =
          std::max(block.missing_samples, static_cast<std::uint64_t>(block.first_sample - known->second));
    known->second = block.first_sample + block.samples;
    if (!block.emitter->last) return;
    tracks.end(known->first);
    emitters.erase(known);
  }

  PcmBlock read_end(std::int64_t length) {
    ended = true;
    PcmBlock block;
    block.first_sample = length;
    block.end = true;
    block.time_s = next_time_s;
    if (next_sample && length > *next_sample) block.missing_samples = static_cast<std::uint64_t>(length - *next_sample);
    missing_samples += block.missing_samples;
    return block;
  }

  /// Samples between two daemons: by simulation time where sound follows it, else by the time that passed.
  std::uint64_t away(const v1::Pcm& pcm, internal::Clock::time_point now) const {
    const double gap_s = simulation ? pcm.time_s() - next_time_s : std::chrono::duration<double>(now - arrived).count();
    const double samples = std::round(gap_s * pcm.rate_hz()) - (simulation ? 0.0 : pcm.samples());
    return samples > 0 ? static_cast<std::uint64_t>(samples) : 0;
  }

  /// Where the block stands in the stream: what is missing before it, and whether another daemon sent it.
  void place(const v1::Pcm& pcm, bool back, PcmBlock& block) {
    const auto now = internal::Clock::now();
    if (next_sample) {
      block.restarted = block.first_sample < *next_sample || back;
      const std::uint64_t skipped =
          block.restarted ? away(pcm, now) : static_cast<std::uint64_t>(block.first_sample - *next_sample);
      block.missing_samples = std::max(block.missing_samples, skipped);
    }
    next_sample = block.first_sample + block.samples;
    next_time_s = block.time_s + static_cast<double>(block.samples) / std::max<std::uint32_t>(1, block.rate_hz);
    arrived = now;
  }

  std::optional<PcmBlock> read(const std::string& body) {
    v1::OutMessage message;
    if (!message.ParseFromString(body)) {
      ++unreadable;
      return std::nullopt;
    }
    const bool back = follow(message);
    if (message.has_end()) return read_end(message.end().samples());
    PcmBlock block;
    const v1::Pcm& pcm = message.pcm();
    if (!message.has_pcm() || !read_samples(pcm, tracks, block.interleaved)) {
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
                                   .position = internal::from_wire(emitter.position()),
                                   .normal = internal::from_wire(emitter.normal()),
                                   .last = emitter.last()};
      place_emitter(back, block);
    } else {
      place(pcm, back, block);
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
                                                 const ListenOptions& options, bool reconnect) {
  return open(connection, session_id, options, reconnect, false);
}

tl::expected<PcmReader, Error> PcmReader::open(const Connection& connection, const std::string& session_id,
                                               const ListenOptions& options, bool reconnect, bool simulation) {
  if (options.blocks < 1 || options.blocks > 4)
    return tl::unexpected(internal::local_error("invalid", "A message holds 1 to 4 blocks.", "Ask for 1 to 4.", "blocks"));
  const int queue = options.queue_messages.value_or(simulation ? 0 : kLiveQueueMessages);
  auto subscription = internal::Subscription::open(connection.link(), topic_of(session_id, options),
                                                   {.queue = queue, .reconnect = reconnect});
  if (!subscription) return tl::unexpected(std::move(subscription.error()));
  const bool many = std::holds_alternative<EmitterContent>(options.content);
  return PcmReader(
      std::make_unique<Impl>(Impl{.subscription = std::move(*subscription), .simulation = simulation, .many = many}));
}

std::optional<PcmBlock> PcmReader::next(std::chrono::milliseconds timeout) {
  const auto deadline = internal::Clock::now() + timeout;
  while (const auto body = impl_->subscription->next(deadline)) {
    if (auto block = impl_->read(*body)) return block;
  }
  return std::nullopt;
}

tl::expected<Sound, Error> PcmReader::read_all(std::chrono::milliseconds timeout) {
  if (impl_->many)
    return tl::unexpected(
        internal::local_error("invalid", "Emitters are many sounds.", "Read block after block with next().", "content"));
  const auto deadline = internal::Clock::now() + timeout;
  Sound sound;
  std::optional<std::int64_t> first = impl_->next_sample;
  std::uint64_t length = 0;
  while (!impl_->ended) {
    const auto left = std::chrono::ceil<std::chrono::milliseconds>(deadline - internal::Clock::now());
    const auto block = next(std::max(left, std::chrono::milliseconds(0)));
    if (!block) {
      if (auto there = check(); !there) return tl::unexpected(std::move(there.error()));
      return tl::unexpected(
          internal::local_error("timeout", "The stream did not end within " + std::to_string(timeout.count()) + " ms.",
                                "End the session, or allow more time."));
    }
    if (!first) first = block->first_sample - static_cast<std::int64_t>(block->missing_samples);
    if (!block->end) {
      sound.channels = block->channels;
      sound.rate_hz = block->rate_hz;
    }
    if (block->missing_samples > 0) {
      sound.gaps.push_back({length, block->missing_samples});
      length += block->missing_samples;
      sound.interleaved.resize(length * sound.channels, 0.0f);
    }
    sound.interleaved.insert(sound.interleaved.end(), block->interleaved.begin(), block->interleaved.end());
    length += block->samples;
  }
  sound.first_sample = first.value_or(0);
  return sound;
}

tl::expected<void, Error> PcmReader::check() const {
  return impl_->subscription->check();
}
bool PcmReader::is_heard() const {
  return impl_->subscription->is_heard();
}
std::weak_ptr<internal::Subscription> PcmReader::subscription() const {
  return impl_->subscription;
}

std::uint64_t PcmReader::missing_samples() const {
  return impl_->missing_samples;
}
std::uint64_t PcmReader::missing_messages() const {
  return impl_->missing_messages;
}
std::uint64_t PcmReader::unreadable_messages() const {
  return impl_->unreadable;
}

}  // namespace rustle::client
