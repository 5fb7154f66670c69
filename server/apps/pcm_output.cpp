#include "server/apps/pcm_output.h"

#include <fmt/format.h>

#include <algorithm>

namespace rustle::apps {
namespace {

wire::Notice refusal(std::string code, std::string message, std::string remedy) {
  return {wire::NoticeLevel::kError, std::move(code), "topic", std::move(message), std::move(remedy), 0, 1};
}

sheet::Vec3d vector_of(const spatial::Vec3& v) {
  return {v.x, v.y, v.z};
}

}  // namespace

std::optional<wire::Notice> PcmOutput::subscribe(const std::string& name, const wire::PcmTopic& topic) {
  if (outs_.contains(name)) return std::nullopt;
  const std::uint32_t rate_hz = session_.options().rate_hz;
  if (topic.format == wire::PcmFormat::kOpus && !sinks::OpusStream::has_rate(rate_hz)) {
    return refusal("unsupported", fmt::format("\"{}\": Opus has no rate of {} Hz.", name, rate_hz),
                   "Attach with a rate of 8000, 12000, 16000, 24000 or 48000 Hz, or listen as f32 or s16.");
  }
  if (!session_.finished() && !open(topic)) {
    const bool stem = topic.content == wire::PcmContent::kStem;
    return refusal("quota_exceeded",
                   stem
                       ? fmt::format("\"{}\" is one stem too many: {} of a session are streamed.", name, session::kMostStems)
                       : fmt::format("\"{}\" was subscribed to and left too often at once.", name),
                   stem ? "Leave a stem that is not needed, then subscribe again." : "Subscribe again.");
  }
  Out& out = outs_.emplace(name, Out{topic, 0, {}}).first->second;
  choose_steps();
  if (session_.finished()) end(out);
  return std::nullopt;
}

void PcmOutput::choose_steps() {
  step_blocks_ = most_blocks_;
  for (const auto& [name, out] : outs_) step_blocks_ = std::min(step_blocks_, out.topic.blocks);
  session_.render_in_steps_of(step_blocks_);
}

void PcmOutput::end_messages_with_steps() {
  if (step_blocks_ == 1 || session_.options().clock != session::Clock::kLive) return;
  for (auto& [name, out] : outs_) {
    const bool packets = out.topic.format == wire::PcmFormat::kOpus;
    if (packets || out.topic.blocks != step_blocks_ || out.topic.content == wire::PcmContent::kEmitter) continue;
    for (auto& [emitter, stream] : out.streams) send_samples(out, stream, stream.content, true);
  }
}

bool PcmOutput::open(const wire::PcmTopic& topic) {
  if (topic.content == wire::PcmContent::kStem) {
    Stem& stem = stems_[key_of(topic)];
    if (!stem.tap) stem.tap = session_.open_stem(topic.sheet_id, topic.kind);
    if (!stem.tap) {
      stems_.erase(key_of(topic));
      return false;
    }
    ++stem.topics;
  }
  if (topic.content == wire::PcmContent::kEmitter) {
    if (!emitters_.tap) emitters_.tap = session_.open_emitters();
    if (!emitters_.tap) return false;
    ++emitters_.topics;
  }
  return true;
}

void PcmOutput::unsubscribe(const std::string& name) {
  const auto left = outs_.find(name);
  if (left == outs_.end()) return;
  close(left->second.topic);
  outs_.erase(left);
  choose_steps();
}

void PcmOutput::close(const wire::PcmTopic& topic) {
  const auto stem = stems_.find(key_of(topic));
  if (topic.content == wire::PcmContent::kStem && stem != stems_.end() && --stem->second.topics == 0) {
    session_.close_stem(*stem->second.tap);
    stems_.erase(stem);
  }
  if (topic.content == wire::PcmContent::kEmitter && emitters_.tap && --emitters_.topics == 0) {
    session_.close_emitters(*emitters_.tap);
    emitters_.tap.reset();
  }
}

void PcmOutput::publish(const session::AudioBlock& mix) {
  if (!outs_.empty()) samples_sent_ += mix.interleaved.size() / static_cast<std::size_t>(mix.channels);
  for (auto& [name, out] : outs_) {
    if (out.topic.content != wire::PcmContent::kMix) continue;
    Stream& stream = out.streams[0];
    stream.channels = channels();
    add(out, stream, wire::MixContent{}, mix.first_sample, mix.interleaved);
    send(out, stream, wire::MixContent{}, mix.last);
  }
}

void PcmOutput::publish_beside() {
  publish_stems();
  publish_emitters();
  end_messages_with_steps();
}

void PcmOutput::publish_stems() {
  for (auto& [key, stem] : stems_) {
    samples_.resize(stem.tap->audio.available());
    stem.tap->audio.pop(samples_);
    if (samples_.empty() && !session_.finished()) continue;
    const std::int64_t first = stem.tap->first_sample.value_or(0) + stem.taken;
    stem.taken += static_cast<std::int64_t>(samples_.size() / channels());
    for (auto& [name, out] : outs_) {
      if (out.topic.content != wire::PcmContent::kStem || key_of(out.topic) != key) continue;
      const wire::StemContent content{key.first, key.second};
      Stream& stream = out.streams[0];
      stream.channels = channels();
      add(out, stream, content, first, samples_);
      send(out, stream, content, session_.finished());
    }
  }
}

void PcmOutput::publish_emitters() {
  if (!emitters_.tap) return;
  for (session::EmitterQuantum quantum; emitters_.tap->quanta.pop(quantum);) {
    for (auto& [name, out] : outs_) {
      if (out.topic.content == wire::PcmContent::kEmitter) publish(out, quantum);
    }
  }
  if (!session_.finished()) return;
  for (auto& [name, out] : outs_) {
    if (out.topic.content != wire::PcmContent::kEmitter) continue;
    for (auto& [emitter, stream] : out.streams) send(out, stream, stream.content, true);
    out.streams.clear();
  }
}

void PcmOutput::publish(Out& out, const session::EmitterQuantum& quantum) {
  const synthesis::EmitterSound& sound = quantum.sound;
  if (sound.last && !out.streams.contains(sound.id)) return;
  const wire::EmitterContent now{.emitter_id = sound.id,
                                 .sheet_id = quantum.sheet,
                                 .kind = synthesis::kind_of(sound.bus),
                                 .position_m = vector_of(sound.position_m),
                                 .normal = vector_of(sound.normal),
                                 .last = false};
  Stream& stream = out.streams[sound.id];
  if (!sound.last) add(out, stream, now, quantum.first_sample, sound.samples);
  send(out, stream, now, sound.last);
  if (sound.last) out.streams.erase(sound.id);
}

std::size_t PcmOutput::mix_samples_waiting() const {
  std::size_t most = 0;
  for (const auto& [name, out] : outs_) {
    if (out.topic.content != wire::PcmContent::kMix) continue;
    for (const auto& [emitter, stream] : out.streams) most = std::max(most, stream.waiting.size() / stream.channels);
  }
  return most;
}

void PcmOutput::publish_end() {
  for (auto& [name, out] : outs_) end(out);
}

std::size_t PcmOutput::channels() const {
  return static_cast<std::size_t>(session::channel_count(session_.options().channels));
}

void PcmOutput::end(Out& out) {
  sockets_.publish(wire::to_string(out.topic),
                   wire::encode_end({session_.id(), ++out.sequence}, session_.samples_rendered()));
}

void PcmOutput::add(Out& out, Stream& stream, const Content& now, std::int64_t first_sample,
                    std::span<const float> interleaved) {
  if (out.topic.format == wire::PcmFormat::kOpus) {
    if (!stream.opus) {
      stream.opus =
          std::make_unique<sinks::OpusStream>(session_.options().rate_hz, static_cast<int>(stream.channels), first_sample);
      stream.content = now;
    }
    stream.opus->add(interleaved);
    return;
  }
  if (stream.waiting.empty()) {
    stream.first_sample = first_sample;
    stream.content = now;
  }
  stream.waiting.insert(stream.waiting.end(), interleaved.begin(), interleaved.end());
}

void PcmOutput::send(Out& out, Stream& stream, const Content& now, bool all) {
  if (out.topic.format == wire::PcmFormat::kOpus) {
    send_packets(out, stream, now, all);
  } else {
    send_samples(out, stream, now, all);
  }
}

void PcmOutput::send_samples(Out& out, Stream& stream, const Content& now, bool all) {
  const std::size_t whole = static_cast<std::size_t>(out.topic.blocks) * session_.options().block_size * stream.channels;
  const bool emitter = out.topic.content == wire::PcmContent::kEmitter;
  std::size_t sent = 0;
  const auto send_next = [&](std::size_t count, bool last) {
    const auto samples = std::span<const float>(stream.waiting).subspan(sent, count);
    hand_over(
        out, stream,
        wire::encode_pcm({session_.id(), ++out.sequence}, header_of(out, stream, last), samples, session_.options().up_axis),
        count / stream.channels);
    sent += count;
    stream.content = now;
  };
  while (stream.waiting.size() - sent > whole || (!all && stream.waiting.size() - sent == whole)) send_next(whole, false);
  if (all && (emitter || stream.waiting.size() > sent)) send_next(stream.waiting.size() - sent, true);
  stream.waiting.erase(stream.waiting.begin(), stream.waiting.begin() + static_cast<std::ptrdiff_t>(sent));
}

void PcmOutput::send_packets(Out& out, Stream& stream, const Content& now, bool all) {
  if (!stream.opus) return;
  const auto send_next = [&](const sinks::OpusPacket& packet, bool last) {
    stream.first_sample = packet.first_sample;
    hand_over(out, stream,
              wire::encode_opus({session_.id(), ++out.sequence}, header_of(out, stream, last),
                                {packet.bytes, packet.samples, packet.skip_samples}, session_.options().up_axis),
              packet.samples);
    stream.content = now;
  };
  std::optional<sinks::OpusPacket> packet = stream.opus->next(all);
  if (all && !packet && out.topic.content == wire::PcmContent::kEmitter) packet.emplace().first_sample = stream.first_sample;
  while (packet) {
    auto following = stream.opus->next(all);
    send_next(*packet, all && !following);
    packet = std::move(following);
  }
}

wire::PcmHeader PcmOutput::header_of(const Out& out, const Stream& stream, bool last) const {
  wire::PcmHeader header;
  header.first_sample = stream.first_sample;
  header.rate_hz = session_.options().rate_hz;
  header.channels = static_cast<std::uint32_t>(stream.channels);
  header.format = out.topic.format;
  header.time_s = session_.time_of(stream.first_sample);
  header.content = stream.content;
  if (auto* emitter = std::get_if<wire::EmitterContent>(&header.content)) emitter->last = last;
  header.missing_samples = stream.missing;
  return header;
}

void PcmOutput::hand_over(const Out& out, Stream& stream, const std::string& message, std::uint64_t samples) {
  const bool taken = sockets_.publish(wire::to_string(out.topic), message);
  if (!taken && stream.missing == 0) ++gaps_;
  stream.missing = taken ? 0 : stream.missing + samples;
  if (!taken) samples_in_gaps_ += samples;
  stream.first_sample += static_cast<std::int64_t>(samples);
}

}  // namespace rustle::apps
