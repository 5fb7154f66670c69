#include "server/wire/encode.h"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <cstring>

#include "rustle/v1/audio.pb.h"
#include "server/wire/fields.h"

namespace rustle::wire {
namespace {

using sheet::Vec3d;

v1::OutMessage begin(const OutHeader& header) {
  v1::OutMessage message;
  message.set_session_id(std::string(header.session_id));
  message.set_sequence(header.sequence);
  return message;
}

Conversion axes_of(session::UpAxis up_axis) {
  return {.metres_per_unit = 1, .y_up = up_axis == session::UpAxis::kY};
}

v1::ObservationSource source_of(observation::Source source) {
  return source == observation::Source::kSent ? v1::OBSERVATION_SOURCE_SENT : v1::OBSERVATION_SOURCE_DETECTED;
}

template <class Event>
void add_resonators(const std::vector<observation::Resonator>& resonators, const Conversion& axes, Event* event) {
  for (const observation::Resonator& resonator : resonators) {
    v1::Resonator* out = event->add_resonators();
    out->set_constrained(resonator.constrained);
    out->set_coarse(resonator.coarse);
    out->set_ruling_length_m(resonator.ruling_length_m);
    out->set_free_border_length_m(resonator.free_border_length_m);
    out->set_area_m2(resonator.area_m2);
    to_wire(axes.turn_back(resonator.position_m), out->mutable_position());
    to_wire(axes.turn_back(resonator.normal), out->mutable_normal());
  }
}

struct AddContent {
  v1::Pcm& pcm;
  const Conversion axes;

  void operator()(const MixContent&) const { pcm.mutable_mix(); }
  void operator()(const StemContent& stem) const {
    pcm.mutable_stem()->set_sheet_id(stem.sheet_id);
    pcm.mutable_stem()->set_kind(std::string(kind_name(stem.kind)));
  }
  void operator()(const EmitterContent& emitter) const {
    v1::Emitter* out = pcm.mutable_emitter();
    out->set_emitter_id(emitter.emitter_id);
    out->set_sheet_id(emitter.sheet_id);
    out->set_kind(std::string(kind_name(emitter.kind)));
    to_wire(axes.turn_back(emitter.position_m), out->mutable_position());
    to_wire(axes.turn_back(emitter.normal), out->mutable_normal());
    out->set_last(emitter.last);
  }
};

/// All of a message but its samples.
v1::OutMessage begin_pcm(const OutHeader& header, const PcmHeader& pcm, session::UpAxis up_axis) {
  v1::OutMessage message = begin(header);
  v1::Pcm& out = *message.mutable_pcm();
  out.set_first_sample(pcm.first_sample);
  out.set_rate_hz(pcm.rate_hz);
  out.set_channels(pcm.channels);
  out.set_missing_samples(pcm.missing_samples);
  out.set_time_s(pcm.time_s);
  std::visit(AddContent{out, axes_of(up_axis)}, pcm.content);
  return message;
}

}  // namespace

std::int16_t to_s16(float sample) {
  if (std::isnan(sample)) return 0;
  return static_cast<std::int16_t>(std::lrint(std::clamp(sample, -1.0f, 1.0f) * 32767.0f));
}

std::string encode_pcm(const OutHeader& header, const PcmHeader& pcm, std::span<const float> interleaved,
                       session::UpAxis up_axis) {
  assert(pcm.channels > 0 && interleaved.size() % pcm.channels == 0);
  assert(pcm.format != PcmFormat::kOpus);
  v1::OutMessage message = begin_pcm(header, pcm, up_axis);
  v1::Pcm& out = *message.mutable_pcm();
  out.set_samples(static_cast<std::uint32_t>(interleaved.size() / pcm.channels));
  std::string& data = *out.mutable_data();
  if (pcm.format == PcmFormat::kS16) {
    out.set_format(v1::SAMPLE_FORMAT_S16);
    data.resize(interleaved.size() * sizeof(std::int16_t));
    for (std::size_t i = 0; i < interleaved.size(); ++i) {
      const std::int16_t sample = to_s16(interleaved[i]);
      std::memcpy(data.data() + i * sizeof(sample), &sample, sizeof(sample));
    }
  } else {
    out.set_format(v1::SAMPLE_FORMAT_F32);
    data.resize(interleaved.size_bytes());
    if (!interleaved.empty()) std::memcpy(data.data(), interleaved.data(), interleaved.size_bytes());
  }
  return message.SerializeAsString();
}

std::string encode_opus(const OutHeader& header, const PcmHeader& pcm, const OpusPayload& payload, session::UpAxis up_axis) {
  assert(pcm.format == PcmFormat::kOpus);
  v1::OutMessage message = begin_pcm(header, pcm, up_axis);
  v1::Pcm& out = *message.mutable_pcm();
  out.set_format(v1::SAMPLE_FORMAT_OPUS);
  out.set_samples(payload.samples);
  out.set_skip_samples(payload.skip_samples);
  out.mutable_data()->assign(payload.packet.begin(), payload.packet.end());
  return message.SerializeAsString();
}

std::string encode_observation(const OutHeader& header, const observation::Observation& observation,
                               session::UpAxis up_axis) {
  const Conversion axes = axes_of(up_axis);
  v1::OutMessage message = begin(header);
  v1::Observation& out = *message.mutable_observation();
  out.set_sheet_id(observation.sheet);
  out.set_time_s(observation.time_s);
  for (const observation::CrumplingEvent& event : observation.crumpling) {
    v1::CrumplingEvent* added = out.add_crumpling();
    added->set_event_id(event.id);
    added->set_time_s(event.time_s);
    added->set_confirmed_s(event.confirmed_s);
    added->set_amplitude_m(event.amplitude_m);
    added->set_area_m2(event.area_m2);
    to_wire(axes.turn_back(event.position_m), added->mutable_position());
    added->set_continues_event_id(event.continues);
    added->set_direction(event.direction);
    add_resonators(event.resonators, axes, added);
  }
  for (const observation::FrictionContact& contact : observation.friction) {
    v1::FrictionContact* added = out.add_friction();
    added->set_event_id(contact.id);
    added->set_speed_m_per_s(contact.speed_m_per_s);
    added->set_area_m2(contact.area_m2);
    to_wire(axes.turn_back(contact.position_m), added->mutable_position());
    to_wire(axes.turn_back(contact.direction), added->mutable_direction());
    added->set_touched_surface(contact.touched_surface);
    added->set_normal_force_n(std::max(contact.normal_force_n, 0.0));
    added->set_source(source_of(contact.source));
    add_resonators(contact.resonators, axes, added);
  }
  for (const observation::TearEvent& tear : observation.tears) {
    v1::TearEvent* added = out.add_tears();
    added->set_event_id(tear.id);
    added->set_speed_m_per_s(tear.speed_m_per_s);
    to_wire(axes.turn_back(tear.position_m), added->mutable_position());
    to_wire(axes.turn_back(tear.direction), added->mutable_direction());
    added->set_source(source_of(tear.source));
    add_resonators(tear.resonators, axes, added);
  }
  return message.SerializeAsString();
}

std::string encode_credit(const OutHeader& header, const FlowCredit& credit) {
  v1::OutMessage message = begin(header);
  v1::FlowCredit& out = *message.mutable_credit();
  out.set_acknowledged_sequence(credit.acknowledged_sequence);
  out.set_window_messages(credit.window_messages);
  out.set_window_bytes(credit.window_bytes);
  return message.SerializeAsString();
}

std::string encode_stored(const OutHeader& header, std::uint64_t stored_sequence, std::string_view file_name) {
  v1::OutMessage message = begin(header);
  message.mutable_stored()->set_sequence(stored_sequence);
  message.mutable_stored()->set_file_name(std::string(file_name));
  return message.SerializeAsString();
}

std::string encode_end(const OutHeader& header, std::int64_t samples) {
  v1::OutMessage message = begin(header);
  message.mutable_end()->set_samples(samples);
  return message.SerializeAsString();
}

Notice notice_of(const Error& error, std::uint64_t count) {
  return {.level = NoticeLevel::kError,
          .code = std::string(code_name(error.code)),
          .field = error.field,
          .message = error.message,
          .remedy = error.remedy,
          .sequence = error.sequence,
          .count = count};
}

std::string encode_notice(const OutHeader& header, const Notice& notice) {
  v1::OutMessage message = begin(header);
  v1::Notice& out = *message.mutable_notice();
  switch (notice.level) {
    case NoticeLevel::kInfo:
      out.set_level(v1::NOTICE_LEVEL_INFO);
      break;
    case NoticeLevel::kWarning:
      out.set_level(v1::NOTICE_LEVEL_WARNING);
      break;
    case NoticeLevel::kError:
      out.set_level(v1::NOTICE_LEVEL_ERROR);
      break;
  }
  out.set_code(notice.code);
  out.set_field(notice.field);
  out.set_message(notice.message);
  out.set_remedy(notice.remedy);
  out.set_sequence(notice.sequence);
  out.set_count(notice.count);
  return message.SerializeAsString();
}

}  // namespace rustle::wire
